"""Input that crashes the interpreter inside other libraries: a separate process must survive all of it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

CHILD = """
import json
import sys
import numpy as np
import pinproof as pp
from pinproof.model import load_robot
for text in json.load(sys.stdin):
    try:
        robot = load_robot(text)
        arm = robot.arm(robot.urdf.links[-1])
        assert np.isfinite(arm.forward_kinematics(arm.home).homogeneous).all()
        assert np.isfinite(arm.jacobian(arm.home)).all()
        robot.info(arm).to_dict()
        pp.CollisionChecker(arm).check(arm.home)
        print("works", flush=True)
    except pp.PinproofError as error:
        print("refused", flush=True)
"""


def chain(count, body="", fork=False):
    links = [f'<link name="l{i}">{body}</link>' for i in range(count + 1)]
    joints = [
        f'<joint name="j{i}" type="revolute"><parent link="l{0 if fork else i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 0.01"/><axis xyz="0 {i % 2} {1 - i % 2}"/><limit lower="-1" upper="1"/></joint>'
        for i in range(count)
    ]
    return f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>'


def shape(text):
    return f"<collision><geometry>{text}</geometry></collision>"


CASES = [
    (chain(200), "works"),
    (chain(900), "refused"),
    (chain(5000), "refused"),
    (chain(900, fork=True), "works"),
    (chain(1, shape('<sphere radius="1e-9"/>')), "refused"),
    (chain(1, shape('<box size="1e-8 1 1"/>')), "refused"),
    (chain(1).replace('xyz="0 0 1"', 'xyz="0 0 0"'), "refused"),
    (chain(2).replace('child link="l2"', 'child link="l1"'), "refused"),
    (chain(2).replace('child link="l2"', 'child link="l0"'), "refused"),
    (chain(2).replace('name="j1"', 'name="j0"'), "refused"),
    (chain(1).replace("l1", "é" * 50_000), "works"),
    ("<robot>" + "<link>" * 100_000, "refused"),
    ('<robot name="r">' + '<link name="' + "x" * 20_000_000 + '"/></robot>', "refused"),
]


@pytest.mark.slow
def test_interpreter_survives():
    texts = json.dumps([text for text, _ in CASES]).encode()
    done = subprocess.run([sys.executable, "-c", CHILD], input=texts, capture_output=True, check=False)
    assert done.stdout.decode().split() == [outcome for _, outcome in CASES], done.stderr.decode()[-2000:]
    assert done.returncode == 0
