"""The bodies that links get: connected, thin enough, plausible in weight, and drawn as they collide."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pinproof.description import DhRow, DhTable
from pinproof.description.dh_urdf import DENSITY, link_bodies
from pinproof.model import dh_to_urdf, load_robot

from ..examples import examples

HALF = math.pi / 2
GENERIC = DhTable.load(Path(__file__).parents[2] / "robots" / "generic_6dof" / "dh.yaml")
UR5 = DhTable(
    [
        DhRow("pan", 0, 0.089159, 0, HALF),
        DhRow("lift", 0, 0, -0.425, 0),
        DhRow("elbow", 0, 0, -0.39225, 0),
        DhRow("wrist_1", 0, 0.10915, 0, HALF),
        DhRow("wrist_2", 0, 0.09465, 0, -HALF),
        DhRow("wrist_3", 0, 0.0823, 0, 0),
    ],
    convention="standard",
    name="ur5",
)
PANDA = DhTable(
    [
        DhRow("j1", 0, 0.333, 0, 0, lower=-2.9, upper=2.9),
        DhRow("j2", 0, 0, 0, -HALF, lower=-1.76, upper=1.76),
        DhRow("j3", 0, 0.316, 0, HALF, lower=-2.9, upper=2.9),
        DhRow("j4", 0, 0, 0.0825, HALF, lower=-3.07, upper=-0.07),
        DhRow("j5", 0, 0.384, -0.0825, -HALF, lower=-2.9, upper=2.9),
        DhRow("j6", 0, 0, 0, HALF, lower=-0.018, upper=3.75),
        DhRow("j7", 0, 0.107, 0.088, HALF, lower=-2.9, upper=2.9),
    ],
    convention="modified",
    name="panda",
)
SCARA = DhTable(
    [
        DhRow("j1", 0, 0.4, 0.3, 0),
        DhRow("j2", 0, 0, 0.25, math.pi),
        DhRow("j3", 0, 0, 0, 0, "prismatic", 0.05, 0.2),
        DhRow("j4", 0, 0.05, 0, 0),
    ],
    convention="standard",
    name="scara",
)
CRANE = DhTable(
    [
        DhRow("slide", 0.7, 0.3, 0.25, 0.5, "prismatic", 0.1, 0.4),
        DhRow("swing", 0.2, 0, 0.4, -HALF, lower=-1, upper=1),
        DhRow("turn", 0, 0.15, 0, 0),
    ],
    convention="standard",
    name="crane",
)
ARMS = pytest.mark.parametrize("table", [GENERIC, UR5, PANDA, SCARA, CRANE], ids=lambda table: table.name)


def geometry(urdf: str) -> tuple[pin.Model, pin.GeometryModel]:
    model = pin.buildModelFromXML(urdf)
    return model, pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)


def free_share(table: DhTable, samples: int = 300) -> float:
    """Share of random configurations free of contact between links that are not neighbours.

    Neighbours are links next to each other in the chain once the links without geometry are taken out.
    """
    urdf = dh_to_urdf(table)
    model, geom = geometry(urdf)
    bodies = sorted({g.parentJoint for g in geom.geometryObjects})
    neighbours = {(a, a) for a in bodies} | set(pairwise(bodies))
    for i, first in enumerate(geom.geometryObjects):
        for j, second in enumerate(geom.geometryObjects[:i]):
            if tuple(sorted((first.parentJoint, second.parentJoint))) not in neighbours:
                geom.addCollisionPair(pin.CollisionPair(j, i))
    data, geom_data = model.createData(), geom.createData()
    rng = np.random.default_rng(0)
    hits = sum(
        pin.computeCollisions(model, data, geom, geom_data, rng.uniform(table.lower, table.upper), True)
        for _ in range(samples)
    )
    return 1 - hits / samples


@ARMS
def test_most_configurations_are_free_of_self_collision(table):
    assert free_share(table) > 0.6


def test_the_stretched_and_the_elbow_up_pose_of_the_generic_arm_are_free():
    for q in (np.zeros(6), [0, math.pi / 3, -2 * math.pi / 3, -math.pi / 6, HALF, 0]):
        fixed = [
            DhRow(r.name, r.theta, r.d, r.a, r.alpha, lower=x, upper=x) for r, x in zip(GENERIC.rows, q, strict=True)
        ]
        assert free_share(DhTable(fixed, convention="standard"), samples=1) == 1.0


def test_a_row_without_length_has_no_collision_geometry():
    has_shapes = [bool(body.shapes) for body in link_bodies(GENERIC)]
    assert has_shapes == [True, True, True, True, True, False, True]  # base_link (the foot), link_1 ... link_6


@ARMS
def test_the_drawn_shape_is_the_collision_shape(table):
    urdf = load_robot(dh_to_urdf(table)).urdf
    drawn = [(g.link, g.kind, g.size, g.origin.tolist()) for g in urdf.visuals]
    assert drawn == [(g.link, g.kind, g.size, g.origin.tolist()) for g in urdf.collisions]
    assert drawn
    assert all(g.rgba is not None for g in urdf.visuals)


@ARMS
def test_links_with_length_reach_from_joint_to_joint(table):
    """Every dh frame but those at the trimmed tip lies inside some body."""
    urdf = dh_to_urdf(table)
    robot = load_robot(urdf)
    arm = robot.arm(tcp="tool0")
    q = np.random.default_rng(1).uniform(table.lower, table.upper)
    frames = table.frames(q)
    placed = [(g, arm.frame_placement(q, g.link).homogeneous @ g.origin) for g in robot.urdf.collisions]
    reach = np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1).cumsum()
    for i in range(1, len(frames)):
        if reach[i - 1] == reach[-1]:
            break  # the tip, which is trimmed
        assert any(_holds(shape, origin, frames[i, :3, 3]) for shape, origin in placed), f"nothing at dh_{i}"


def _holds(shape, origin, point) -> bool:
    local = origin[:3, :3].T @ (point - origin[:3, 3])
    if shape.kind == "sphere":
        return bool(np.linalg.norm(local) <= shape.size[0] + 1e-9)
    return bool(np.hypot(*local[:2]) <= shape.size[0] + 1e-9 and abs(local[2]) <= shape.size[1] / 2 + 1e-9)


def test_the_foot_clears_a_table_top_and_the_tip_clears_the_tool_point():
    robot = load_robot(dh_to_urdf(GENERIC))
    arm = robot.arm(tcp="tool0")
    lowest = math.inf
    for g in robot.urdf.collisions:
        if g.link in ("base_link", "link_1") and g.kind == "cylinder":
            lowest = min(
                lowest, (arm.frame_placement(np.zeros(6), g.link).homogeneous @ g.origin)[2, 3] - g.size[1] / 2
            )
    assert lowest == pytest.approx(5e-3)
    tip = [g for g in robot.urdf.collisions if g.link == "link_6" and g.kind == "cylinder"]
    highest = max(g.origin[2, 3] + g.size[1] / 2 for g in tip)
    assert highest <= 0.10 - min(g.size[0] for g in tip) + 1e-12


def test_a_prismatic_rod_reaches_its_joint_at_both_ends_of_the_stroke():
    for convention in ("standard", "modified"):
        row = DhRow("p", 0, 0.2, 0, 0, "prismatic", 0.1, 0.7)
        body = link_bodies(DhTable([row, DhRow("r", 0, 0, 0.5, 0)], convention=convention))[1]
        rod = max((s for s in body.shapes if s.length), key=lambda s: s.length)
        joint = 0.0 if convention == "standard" else -row.d  # where the joint's origin is in the link at q = 0
        low, high = rod.origin[2, 3] - rod.length / 2, rod.origin[2, 3] + rod.length / 2
        for q in (row.lower, row.upper):
            assert low - 1e-12 <= joint - q <= high + 1e-12


@examples(50)
@given(
    lengths=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=6),
    convention=st.sampled_from(["standard", "modified"]),
)
def test_masses_and_inertias_are_those_of_a_rigid_body(lengths, convention):
    table = DhTable([DhRow(f"j{i}", 0, d, a, 1.0) for i, (d, a) in enumerate(lengths)], convention=convention)
    for body in link_bodies(table)[1:]:
        assert body.mass > 0
        moments = np.linalg.eigvalsh(body.inertia)
        assert moments[0] > 0
        assert moments[2] <= (moments[0] + moments[1]) * (1 + 1e-9)  # no solid breaks the triangle inequality


def test_a_straight_link_has_the_mass_of_a_solid_cylinder():
    table = DhTable([DhRow("j1", 0, 0, 1.0, 0), DhRow("j2", 0, 0, 1.0, 0)], convention="standard")
    body = link_bodies(table)[1]
    r, length = 0.08, 1.0  # 4 % of the total length of 2 m
    mass = DENSITY * math.pi * r**2 * length
    assert body.mass == pytest.approx(mass)
    np.testing.assert_allclose(body.centre, [0.5, 0, 0], atol=1e-15)
    across = mass * (3 * r**2 + length**2) / 12
    np.testing.assert_allclose(body.inertia, np.diag([mass * r**2 / 2, across, across]), atol=1e-15 * mass + 1e-14)


def test_an_arm_without_lengths_has_joints_and_masses():
    table = DhTable([DhRow("j1", 0, 0, 0, HALF), DhRow("j2", 0, 0, 0, -HALF)], convention="standard")
    urdf = dh_to_urdf(table)
    assert geometry(urdf)[1].ngeoms == 0
    assert all(inertia.mass > 0 for inertia in list(pin.buildModelFromXML(urdf).inertias)[1:])


@examples(40)
@given(data=st.data())
def test_two_links_apart_by_one_link_do_not_touch_where_they_meet_it(data):
    """The radius rule: balls at both ends of the link between them keep apart by at least 40 % of its length."""
    lengths = data.draw(st.lists(st.floats(0.05, 1.0), min_size=3, max_size=6))
    table = DhTable([DhRow(f"j{i}", 0, 0, a, 0) for i, a in enumerate(lengths)], convention="standard")
    radii = [
        max(s.radius for s in body.shapes if s.length and s.part == "arm")
        for body in link_bodies(table)[1:]
        if body.shapes
    ]
    assume(len(radii) == len(lengths))
    for before, between, after in zip(radii, lengths[1:], radii[2:], strict=False):
        assert before + after <= 0.6 * between + 1e-12


def test_the_quill_of_a_scara_is_thin_and_a_rod_at_the_base_is_not():
    quill = [shape for shape in link_bodies(SCARA)[3].shapes if shape.length is not None]
    assert [shape.radius for shape in quill] == pytest.approx([0.05 * 0.2])
    column = [shape for shape in link_bodies(CRANE)[1].shapes if shape.length is not None]
    assert min(shape.radius for shape in column) > 0.03
