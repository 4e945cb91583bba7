"""What a certificate is for, and its notes; what differs between two checkers, or a motion file and a checker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.certificates.certificate import (
    CertificateStatus,
    body_digest,
    changes_since,
    missing_since,
    setup_of,
)
from pinproof.collision.certificates.reuse import setup_differences
from pinproof.motion import MotionRecord

ARM = pp.load_robot("panda").arm(tcp="panda_hand_tcp", base="panda_link1")
BALL = pp.Obstacle("ball", pp.Sphere(0.02), pp.pose((0, 0, 0.1)))
ROD = pp.Obstacle("rod", pp.Cylinder(0.01, 0.1), pp.pose((0, 0, 0.05)))
POST = pp.Obstacle("post", pp.Sphere(0.02), pp.pose((0, 0, 5)))
WALL = pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((3, 0, 0)))
HELD = {"panda_joint1": 0.3, "panda_finger_joint1": 0.01}
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]  # the second follows the first
MARGIN = 0.004
LEVEL = pp.Upright.keeping(ARM, ARM.home, tolerance=0.1)


def checker(
    held: dict[str, float] = HELD,
    attached: tuple[pp.Obstacle, ...] = (BALL, ROD),
    obstacles: tuple[pp.Obstacle, ...] = (POST, WALL),
    margin: float = MARGIN,
) -> pp.CollisionChecker:
    return pp.CollisionChecker(ARM.with_held(held), pp.Scene(obstacles), attached=attached, allowed=[], margin=margin)


@pytest.fixture(scope="module")
def setup() -> pp.CollisionChecker:
    return checker()


@pytest.fixture(scope="module")
def record(setup: pp.CollisionChecker) -> MotionRecord:
    path = pp.JointPath([setup.arm.home, setup.arm.home + 0.01], setup.arm.joint_names)
    motion = pp.time_parametrise(path, setup.arm.limits)
    return pp.certify(motion, setup, constraints=[LEVEL]).motion_record(end=motion.duration)


CHANGES: dict[str, tuple[dict[str, object], list[str]]] = {
    # What the checker has instead, and what each sentence about it names.
    "nothing": ({}, []),
    "held joint": ({"held": HELD | {"panda_joint1": 0.301}}, ["panda_joint1"]),
    "held fingers": ({"held": HELD | {"panda_finger_joint1": 0.011}}, FINGERS),
    "held joint with the other sign": ({"held": HELD | {"panda_joint1": -0.3}}, ["panda_joint1"]),
    "held joint by little": ({"held": HELD | {"panda_joint1": 0.3 + 1e-8}}, ["panda_joint1"]),
    "rounding of a held joint": ({"held": HELD | {"panda_joint1": 0.3 + 1e-10}}, []),
    "no first body": ({"attached": (ROD,)}, ["ball"]),
    "no body": ({"attached": ()}, ["ball and rod"]),
    "more bodies": ({"attached": (BALL, ROD, replace(BALL, name="more"))}, []),
    "body elsewhere": ({"attached": (replace(BALL, pose=pp.pose((0, 0, 0.11))), ROD)}, ["ball"]),
    "body of another shape": ({"attached": (BALL, replace(ROD, shape=pp.Cylinder(0.011, 0.1)))}, ["rod"]),
    "no obstacle": ({"obstacles": ()}, ["post and wall"]),
    "fewer obstacles": ({"obstacles": (POST,)}, []),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_missing_since_a_motion_was_certified(change: str, record: MotionRecord) -> None:
    settings, named = CHANGES[change]
    missing = missing_since((record,), checker(**settings))  # type: ignore[arg-type]
    assert len(missing) == len(named)
    assert all(name in sentence for name, sentence in zip(named, missing, strict=True))


def test_what_changed_since_a_motion_was_certified(setup: pp.CollisionChecker, record: MotionRecord) -> None:
    def changes(
        records: tuple[MotionRecord, ...] = (record,), checked: pp.CollisionChecker = setup, **given: str
    ) -> list[str]:
        known = {"curve": record.curve, "setup": record.setup} | given
        return changes_since(records, checked, **known, constraints=[LEVEL])

    assert changes() == changes(records=()) == changes(checked=checker(margin=MARGIN + 0.001)) == []
    assert len(changes(curve="another")) == len(changes(setup="another")) == 1
    # A difference that is named is not counted twice.
    assert len(changes(curve="another", setup="another")) == 1
    (margin,) = changes(checked=checker(margin=MARGIN - 0.001))
    assert "4 mm" in margin
    (missing,) = changes(checked=checker(attached=(ROD,)), setup="another")
    assert "ball" in missing
    (constraint,) = changes_since((record,), setup, record.curve, record.setup)
    assert record.constraints[0] in constraint
    # Of several records only what they have in common with the checker is compared.
    assert changes(records=(record, record), curve="another", setup="another") == []
    other = replace(record, held={**record.held, "panda_joint1": 0.0})
    assert len(missing_since((record, other), setup)) == 1
    assert missing_since((), setup) == ()


def test_the_digest_of_a_body_depends_on_its_name_shape_and_pose_and_not_on_rounding(tmp_path) -> None:
    tiny = pp.pose((0, 0, 0.1))
    tiny.translation = tiny.translation - 1e-11
    minus = pp.pose((0, 0, 0.1))
    minus.rotation, minus.translation = minus.rotation - 1e-12, minus.translation * [-1, 1, 1]
    assert np.signbit(minus.homogeneous).any()
    for placed in (tiny, minus):
        assert body_digest(replace(BALL, pose=placed)) == body_digest(BALL)
    mesh = pp.Mesh.from_arrays(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    )
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    for name in ("a.obj", "b.obj", "c.obj"):
        size = 2.0 if name == "c.obj" else 1.0
        lines = [f"v {x * size} {y * size} {z * size}" for x, y, z in corners]
        faces = [f"f {k + 1} {k + 2} {k + 3}" for k in range(0, 12, 3)]
        (tmp_path / name).write_text("\n".join([*lines, *faces]) + "\n")
    a, b, c = (replace(BALL, shape=pp.Mesh(tmp_path / name)) for name in ("a.obj", "b.obj", "c.obj"))
    assert body_digest(a) == body_digest(b)
    different = [
        BALL, c, a,
        replace(BALL, name="bell"),
        replace(BALL, shape=pp.Sphere(0.021)),
        replace(BALL, pose=pp.pose((0, 0, 0.1 + 1e-8))),
        replace(BALL, shape=mesh),
        replace(a, shape=pp.Mesh(tmp_path / "a.obj", scale=2.0)),
        replace(a, shape=pp.Mesh(tmp_path / "a.obj", hull=True)),
    ]  # fmt: skip
    assert len(set(map(body_digest, different))) == len(different)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda c: c, []),
        (lambda c: checker(held=HELD | {"panda_joint1": 0.0}), ["panda_joint1"]),
        (lambda c: checker(held=HELD | {"panda_finger_joint1": 0.0}), [", ".join(FINGERS)]),
        (lambda c: checker(margin=0.0041), ["4.1 mm"]),
        (lambda c: checker(attached=(ROD,)), ["ball"]),
        (lambda c: checker(attached=(BALL, replace(ROD, shape=pp.Sphere(0.01)))), ["rod"]),
        (lambda c: checker(obstacles=()), []),
        (lambda c: other_arm(c, tcp="panda_hand", base="panda_link1"), ["panda_hand_tcp", "ball, rod"]),
        (lambda c: other_arm(c, tcp="panda_hand_tcp"), ["the arm", "other joints are held"]),
    ],
)  # fmt: skip
def test_differences_of_two_checkers_except_for_their_scenes(
    setup: pp.CollisionChecker, change: Callable[[pp.CollisionChecker], pp.CollisionChecker], named: list[str]
) -> None:
    differences = setup_differences(setup, change(setup))
    assert len(differences) == len(named)
    assert all(name in sentence for name, sentence in zip(named, differences, strict=True))


def other_arm(of: pp.CollisionChecker, **ends: str) -> pp.CollisionChecker:
    arm = pp.load_robot("panda").arm(**ends)
    arm = arm.with_held({name: value for name, value in HELD.items() if name in arm.held})
    return pp.CollisionChecker(arm, of.scene, attached=of.attached, allowed=[], margin=of.margin)


def test_notes_name_the_held_joints_and_what_is_not_checked(setup: pp.CollisionChecker) -> None:
    (held,) = [note for note in setup_of(setup).notes if "held" in note]
    assert all(f"{name} = {value}" in held for name, value in {**HELD, FINGERS[1]: 0.01}.items())
    names = [f"ball_{k}" for k in range(7)]
    cloud = pp.PointCloud([[0.0, 0.0, 9.0]], 0.1)
    for count in (6, 7):
        many = tuple(pp.Obstacle(name, cloud, pp.pose()) for name in names[:count])
        (note,) = [note for note in setup_of(checker(obstacles=many)).notes if "point cloud" in note]
        assert note.startswith(", ".join(names[:6]) + (": " if count == 6 else ", ... (7 in all): "))


@pytest.mark.parametrize("changed", range(3))
def test_each_mesh_file_that_changes_after_it_was_read_is_named(arm_from_links, path, tmp_path, changed):
    """Two meshes of links and one of an obstacle; the hash then matches no setup."""
    files = [tmp_path / f"part{k}.stl" for k in range(3)]
    for k, file in enumerate(files):
        trimesh.creation.box((0.1, 0.1, 0.1 + 0.01 * k)).export(file)
    arm = arm_from_links(
        {"root": f'<mesh filename="{files[0]}"/>@0 -3 0', "ball": f'<mesh filename="{files[1]}"/>'},
        [("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0")],
    ).arm(tcp="ball")
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("part", pp.Mesh(files[2]), pp.pose((0, 2, 0)))]))
    curve = path(arm, [0.0], [0.1])
    before = pp.certify(curve, checker)
    assert not any("changed" in note for note in before.notes)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(files[changed])
    after = pp.certify(curve, checker)
    assert next(note for note in after.notes if "changed" in note).startswith(f"part{changed}.stl: changed")
    assert after.setup != before.setup
    assert not after.matches(curve, arm, checker.scene)


def notes(path, arm, *obstacles, **settings):
    certificate = pp.certify(path(arm, arm.home), pp.CollisionChecker(arm, pp.Scene(obstacles, **settings)))
    assert all(f"\nnote: {note}" in str(certificate) for note in certificate.notes)
    return certificate.notes


def test_hulled_links_are_named_and_counted(ur5, path):
    expected, closer = notes(path, ur5)
    assert expected.startswith("base_link, shoulder_link, ")
    assert "(7 in all)" in expected
    assert "convex hull" in expected
    assert "base_link and upper_arm_link" in closer
    assert "several hulls" in closer
    assert "SRDF" in closer


def test_held_joints_are_named_with_their_values(panda, path):
    assert any("panda_finger_joint1 = 0, panda_finger_joint2 = 0" in note for note in notes(path, panda))


def test_a_mesh_that_is_not_watertight_is_named(slider, mesh_file, path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = mesh_file(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))
    sheet = pp.Obstacle("open", pp.Mesh(open_box, hull=False, hollow=True))
    (text,) = notes(path, slider, sheet)
    assert text.startswith("open: not watertight")


def test_note_on_a_point_cloud_names_resolution_and_unobserved_space(slider, path):
    (expected,) = notes(path, slider, pp.Obstacle("seen", pp.PointCloud(np.array([[0.5, 0.5, 0.5]]), 0.01)))
    assert "seen: point cloud in cells of 0.01 m" in expected
    assert "unobserved" in expected


def test_notes_of_a_scene_file_are_repeated(slider, path):
    assert notes(path, slider, notes=["a mesh of 'rack' is not watertight, so its convex hull is used"]) == (
        "a mesh of 'rack' is not watertight, so its convex hull is used",
    )


def test_links_with_visual_geometry_only_are_named(path):
    link = '<link name="{}"><visual><geometry><sphere radius="0.1"/></geometry></visual>{}</link>'
    body = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    joints = (
        '<joint name="q" type="continuous"><parent link="base"/><child link="arm"/>'
        '<limit velocity="1" effort="1"/></joint>'
        '<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/></joint>'
    )
    for solid, expected in (
        (body, "tip: visible, but without collision geometry"),
        ("", "the robot has no collision geometry"),
    ):
        parts = link.format("base", solid) + link.format("arm", solid) + link.format("tip", "")
        arm = pp.load_robot(f'<robot name="r">{parts}{joints}</robot>').arm(tcp="tip")
        (note,) = notes(path, arm)
        assert expected in note


def test_there_are_no_notes_without_assumptions(slider, path):
    certificate = pp.certify(
        path(slider, [0.0]),
        pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("b", pp.Box(1, 1, 1), pp.pose((2, 0, 0)))])),
    )
    assert certificate.notes == ()
    assert "\n" not in str(certificate)


def test_colliding_certificates_have_notes_too(path):
    arm = pp.load_robot("ur5").arm()
    certificate = pp.certify(
        path(arm, arm.home), pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("b", pp.Box(2, 2, 2), pp.pose((0, 0, 0)))]))
    )
    assert certificate.status is CertificateStatus.COLLIDING
    assert certificate.notes
