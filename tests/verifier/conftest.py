"""Proofs for the tests, and an oracle that samples the content of a proof file."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.model import load_robot
from pinproof.verifier import body_digest, curve_digest

from ..collision.conftest import urdf_of

CRANE = [
    ("turn", "revolute", "base", "bar", "0 0 0", "0 0 1"),
    ("out", "prismatic", "bar", "slide", "0.4 0 0", "1 0 0"),
    ("twist", "revolute", "slide", "hand", "0.3 0 0.2", "0 0.6 0.8"),
    ("grip", "prismatic", "hand", "finger", "0.2 0 0", "0 0 1", '<mimic joint="out" multiplier="-0.5"/>'),
]
"""The joints of a bar that turns, one that slides out of it, a turning hand across it, a finger that follows it."""


@pytest.fixture(scope="session")
def crane():
    links = {
        "base": '<box size="0.1 0.1 0.1"/>@0 0 -0.2',
        "bar": '<box size="0.5 0.04 0.04"/>@0.25 0 0',
        "slide": '<box size="0.3 0.03 0.03"/>@0.15 0 0.1',
        "hand": '<box size="0.05 0.2 0.05"/>@0.1 0 0',
        "finger": '<box size="0.02 0.02 0.1"/>@0 0 -0.06',
    }
    return load_robot(urdf_of(links, CRANE, name="crane")).arm(tcp="finger")


@pytest.fixture(scope="session")
def cell():
    """What the crane passes by."""
    return pp.Scene(
        [
            pp.Obstacle("post", pp.Box(0.06, 0.06, 0.6), pp.pose((0.62, 0.56, 0.0), (0, 0, 0.3))),
            pp.Obstacle("ball", pp.Sphere(0.05), pp.pose((0.3, 0.1, 0.2))),
            pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -0.4))),
        ]
    )


WAYPOINTS = np.array([[-0.6, 0.0, 0.0], [0.3, 0.15, 0.8], [0.5, 0.05, 1.2]])


@pytest.fixture(scope="session")
def proof(crane, cell):
    """A proof with a tube and margins, as a file holds it."""
    checker = pp.CollisionChecker(crane, cell, margin=0.002, margins={("hand", "post"): 0.004})
    path = pp.JointPath(WAYPOINTS, crane.joint_names)
    certificate = pp.certify(path, checker, joint_tolerance=1e-3, obstacle_tolerance=1e-3, record=True)
    return proof_document(certificate.or_raise(), path, checker)


@pytest.fixture
def tampered(proof):
    """The same, to be changed."""
    return copy.deepcopy(proof)


@pytest.fixture(scope="session")
def rehashed():
    """Recomputes the hashes of a changed proof, as a forger would."""

    def right(document):
        for body in document["bodies"]:
            body["sha256"] = body_digest(body)
        c = document["curve"]
        names = tuple(c["joint_names"])
        document["hashes"]["curve"] = curve_digest(names, np.array(c["knots"]), np.array(c["control"], dtype=float))
        return document

    return right
