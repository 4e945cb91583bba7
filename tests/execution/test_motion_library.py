"""The library of motions: lookup, changes of the scene, repair and files."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import FileError, InputError, NotProvenFree, UnknownNameError
from pinproof.model import load_robot

from ..collision.conftest import urdf_of
from .conftest import HIGH, LOW, OTHER, timed


@pytest.fixture(scope="module")
def library(checker, swing):
    lift = timed(checker, LOW, HIGH)
    return pp.MotionLibrary(checker).add("swing", swing).add("lift", lift)


@pytest.fixture(scope="module")
def blocked(checker, swing):
    """A scene with a ball in the last part of the swing."""
    ball = pp.Obstacle("ball", pp.Sphere(0.03), pp.pose(checker.arm.forward_kinematics(swing(1.9)).translation))
    return checker.scene.add(ball)


def test_lookup_by_configurations_and_poses(checker, library) -> None:
    fk = checker.arm.forward_kinematics
    assert [m.name for m in library.find(start=LOW)] == ["lift"]
    assert [m.name for m in library.find(goal=OTHER + 5e-4)] == ["swing"]
    assert [m.name for m in library.find(start=fk(LOW), goal=HIGH)] == ["lift"]
    assert library.find(start=LOW + 2e-3) == ()
    assert [m.name for m in library.find(start=LOW + 2e-3, joints=5e-3)] == ["lift"]
    turned = fk(OTHER) * pp.pose((0, 0, 0), (0, 0, 0.02))
    assert library.find(goal=turned) == ()
    assert [m.name for m in library.find(goal=turned, angle=0.03)] == ["swing"]


def test_only_motions_that_are_proven_free_are_added(checker, library, blocked, swing) -> None:
    with pytest.raises(NotProvenFree):
        pp.MotionLibrary(checker.with_scene(blocked)).add("swing", swing)
    with pytest.raises(InputError, match="'swing' already"):
        library.add("swing", swing)
    with pytest.raises(UnknownNameError, match="valid: swing, lift"):
        library["swings"]


def test_changed_scene_changes_the_verdicts_and_back(library, checker, blocked) -> None:
    now = library.with_scene(blocked)
    assert {m.name: m.free for m in now} == {"swing": False, "lift": True}
    assert now.find(goal=OTHER) == ()
    assert len(now.find(goal=OTHER, free=False)) == 1
    for motion in now:
        assert motion.certificate.status is pp.certify(motion.trajectory, now.checker).status
        assert motion.certificate.matches(motion.trajectory, checker.arm, blocked)
    assert all(motion.free for motion in now.with_scene(checker.scene))
    assert all(motion.free for motion in library), "a library is immutable"
    with pytest.raises(InputError, match="margin"):
        library.with_checker(checker.with_margin(0.01))


def test_repair_replaces_the_broken_part_only(library, blocked, swing) -> None:
    result = library.with_scene(blocked).repair("swing", clearance=0.002)
    assert result.ok
    assert result.library["swing"].free
    first, last = result.replaced
    assert 0.0 < first < last
    fixed = result.motion.trajectory
    kept = np.linspace(0.0, first, 50)
    assert np.array_equal(fixed(kept), swing(kept))
    assert np.array_equal(fixed.end, swing.end)
    assert pp.certify(fixed, result.library.checker).free
    assert not pp.audit(fixed, result.library.checker, step=0.02).contacts


def slider(radii: tuple[float, float, float] = (0.05, 0.01, 0.01)) -> pp.Arm:
    """A ball in the square [-1, 1]^2; the ball, the base and the slide are spheres of these radii, far apart."""
    ball, base, slide = (f'<sphere radius="{radius}"/>' for radius in radii)
    links = {"base": f"{base}@9 0 0", "slide": f"{slide}@9 0 1", "ball": ball}
    joints = [
        ("x", "prismatic", "base", "slide", "0 0 0", "1 0 0"),
        ("y", "prismatic", "slide", "ball", "0 0 0", "0 1 0"),
    ]
    text = urdf_of(links, joints, name="slider").replace('lower="-7" upper="7"', 'lower="-1" upper="1"')
    return load_robot(text).arm(tcp="ball")


STOPS = (-0.9, -0.5, -0.2, 0.2, 0.5, 0.9)


def line(arm: pp.Arm, jerk: float | None = None) -> pp.Trajectory:
    """A motion along y = 0 with a rest at each of the stops."""
    edges = [pp.JointPath([[a, 0.0], [b, 0.0]], arm.joint_names) for a, b in pairwise(STOPS)]
    return pp.Trajectory.join(*(pp.time_parametrise(edge, arm.limits, jerk=jerk) for edge in edges))


def wall(x: float, low: float = -0.2, high: float = 0.2) -> pp.Obstacle:
    return pp.Obstacle(f"wall {x}", pp.Box(0.02, high - low, 0.5), pp.pose((x, 0.5 * (low + high), 0)))


REPAIRS = {
    "between two stops": ((1, 2), [wall(-0.35)], {}),
    "between two others": ((3, 4), [wall(0.35)], {}),
    "over a stop": ((2, 4), [wall(0.0), wall(0.35)], {}),
    "over two stops": ((1, 4), [wall(-0.35), wall(0.35)], {}),
    "over three stops": ((1, 5), [wall(-0.35), wall(0.7)], {}),
    "at a stop": ((1, 3), [wall(-0.2)], {}),
    "between two samples": ((3, 4), [pp.Obstacle("needle", pp.Sphere(0.01), pp.pose((0.351, 0.06 - 1e-6, 0)))], {}),
    # The stops between start and end are 0.03 m from a shelf, so that only the complete motion can be replaced.
    "beside a shelf": (
        (0, 5),
        [wall(0.0, -0.2, 0.08), pp.Obstacle("shelf", pp.Box(1.3, 0.02, 0.5), pp.pose((0, 0.09, 0)))],
        {"clearance": 0.05},
    ),
}


@pytest.mark.parametrize(("part", "added", "settings"), REPAIRS.values(), ids=REPAIRS)
def test_the_shortest_part_between_rests_that_contains_all_contacts_is_replaced(part, added, settings) -> None:
    arm = slider()
    motion, checker = line(arm), pp.CollisionChecker(arm, pp.Scene([wall(5.0)]))
    rests = np.append(motion.times[[np.abs(motion.q[:, 0] - x).argmin() for x in STOPS[:-1]]], motion.duration)
    library = pp.MotionLibrary(checker).add("line", motion).with_scene(checker.scene.add(*added))
    assert not library["line"].free
    first, last = rests[list(part)]
    fixed = library.repair("line", **settings).or_raise()
    assert fixed.replaced == pytest.approx((first, last))
    after = fixed.motion.trajectory
    rest_of = motion.duration - last
    for kept, same in (
        (np.linspace(0.0, first, 50), np.linspace(0.0, first, 50)),
        (np.linspace(after.duration - rest_of, after.duration, 50), np.linspace(last, motion.duration, 50)),
    ):
        np.testing.assert_allclose(after(kept.clip(0, after.duration)), motion(same), atol=1e-8)
    assert library.checker.is_free_batch(after(np.linspace(0.0, after.duration, 2000))).all()
    clear = library.checker.padded(settings.get("clearance", 0.0))
    inside = np.linspace(first + 0.01, after.duration - rest_of - 0.01, 500)
    assert clear.is_free_batch(after(inside)).all()


@pytest.mark.parametrize("jerk", [None, 5.0])
def test_a_repaired_part_has_the_jerk_limit_of_the_motion_or_the_given_one(jerk) -> None:
    arm = slider()
    motion, checker = line(arm, jerk=20.0), pp.CollisionChecker(arm, pp.Scene([wall(5.0)]))
    library = pp.MotionLibrary(checker).add("line", motion).with_scene(checker.scene.add(wall(0.35)))
    fixed = library.repair("line", jerk=jerk).or_raise()
    after, (first, _) = fixed.motion.trajectory, fixed.replaced
    assert after.interpolant == "quintic"
    # Without a given limit, a joint that rested in the motion has a thousandth of the largest jerk.
    limit = np.full(2, jerk) if jerk else np.maximum(motion.max_jerk(), 1e-3 * motion.max_jerk().max())
    largest = np.abs(after.jerk(np.linspace(first, first + after.duration - motion.duration, 2000))).max(axis=0)
    assert (largest <= limit * (1 + 1e-6)).all()
    assert (largest / limit).max() > 0.9


def test_a_motion_that_is_free_is_not_repaired(library) -> None:
    result = library.repair("lift")
    assert result.ok
    assert (result.library, result.replaced, result.plan) == (library, None, None)


def test_repair_of_an_unreachable_goal_fails_with_the_reason(library, checker) -> None:
    goal = checker.arm.forward_kinematics(OTHER).translation
    result = library.with_scene(checker.scene.add(pp.Obstacle("ball", pp.Sphere(0.05), pp.pose(goal)))).repair("swing")
    assert not result.ok
    assert "ball" in result.message
    assert not result.library["swing"].free
    with pytest.raises(pp.errors.NoAnswer):
        result.or_raise()


def test_file_restores_the_motions_exactly(library, checker, tmp_path) -> None:
    library.save(tmp_path / "library.json")
    again = pp.MotionLibrary.load(tmp_path / "library.json", checker)
    assert again.names == library.names
    for motion in again:
        assert motion.trajectory.digest() == library[motion.name].trajectory.digest()
        assert motion.free
        assert motion.certificate.clearance == library[motion.name].certificate.clearance


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (lambda c: c.with_margin(0.0), "margin"),
        (lambda c: c.with_attached(pp.Obstacle("tool", pp.Sphere(0.01), pp.pose((0, 0, 0.05)))), "attached objects"),
        (lambda c: pp.CollisionChecker(pp.load_robot("ur3").arm(), margin=0.005), "kinematics"),
        (
            lambda c: pp.CollisionChecker(pp.load_robot("ur5").arm(tcp="wrist_3_link"), c.scene, margin=0.005),
            "kinematics",
        ),
    ],
)
def test_file_for_another_setup_is_refused(library, checker, tmp_path, other, named) -> None:
    library.save(tmp_path / "library.json")
    with pytest.raises(FileError, match=named):
        pp.MotionLibrary.load(tmp_path / "library.json", other(checker))


def test_file_is_refused_if_any_body_of_the_robot_differs_and_not_for_another_scene(tmp_path) -> None:
    file, tool = tmp_path / "library.json", pp.Obstacle("tool", pp.Sphere(0.01), pp.pose((0, 0, 0.05)))
    checker = pp.CollisionChecker(slider(), pp.Scene([wall(5.0)]), attached=[tool])
    pp.MotionLibrary(checker).add("line", line(checker.arm)).save(file)
    for scene in (pp.Scene(), pp.Scene([wall(0.0)]), pp.Scene([wall(6.0), wall(7.0)])):
        again = pp.MotionLibrary.load(file, pp.CollisionChecker(slider(), scene, attached=[tool]))
        assert again["line"].free == ("wall 0.0" not in scene.names)
    for k in range(3):
        radii = tuple(np.array([0.05, 0.01, 0.01]) + 1e-6 * np.eye(3)[k])
        with pytest.raises(FileError, match="robot_sha256"):
            pp.MotionLibrary.load(file, pp.CollisionChecker(slider(radii), pp.Scene(), attached=[tool]))
    for attached in ([], [pp.Obstacle("tool", pp.Sphere(0.011), tool.pose)], [tool, wall(0.1)]):
        with pytest.raises(FileError, match="tool_sha256"):
            pp.MotionLibrary.load(file, pp.CollisionChecker(slider(), pp.Scene(), attached=attached))


DAMAGES = {
    "schema": ("pinproof/library/2", None, 1),
    "margin": (None, "0.005", True, [0.005]),
    "joint_tolerance": (0.0, [], [0.0] * 5, [0.0] * 7, [0.0] * 5 + [-1e-9], ["a"] * 6),
    "obstacle_tolerance": (-1e-9, "0", None, [0.0]),
    "motions": ({}, None, [{}], [3]),
    "robot_sha256": (3, ""),
    "tool_sha256": (3, ""),
    "more": (1,),
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in DAMAGES.items() for value in values])
def test_file_with_a_wrong_or_missing_value_is_refused(library, checker, tmp_path, key, value) -> None:
    file = tmp_path / "library.json"
    library.save(file)
    data = json.loads(file.read_text())
    for changed in ({**data, key: value}, {name: each for name, each in data.items() if name != key}):
        if changed == data:
            continue  # a key that the format does not have was removed
        file.write_text(json.dumps(changed))
        with pytest.raises(FileError, match=key):
            pp.MotionLibrary.load(file, checker)


def test_tolerances_hold_for_every_motion_that_is_added_loaded_repaired_or_certified_again(checker, swing, tmp_path):
    """A ball over the motion, whose distance at dense samples decides which displacements can be covered."""
    q = swing(np.linspace(0.0, swing.duration, 200))

    def with_ball(height: float) -> pp.CollisionChecker:
        return checker.with_scene(checker.scene.add(pp.Obstacle("ball", pp.Sphere(0.05), pp.pose((0.45, 0.3, height)))))

    low, high = 0.6, 0.9  # in contact, and beyond the other distances
    for _ in range(10):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if distance_of_ball(with_ball(middle), q) > 0.006 else (middle, high)
    near, rng = with_ball(low), np.random.default_rng(0)
    gap = distance_of_ball(near, q)  # beyond the margin
    assert 0.0055 < gap <= 0.0065

    covered = pp.MotionLibrary(near, obstacle_tolerance=0.9 * gap).add("swing", swing)
    for shift in rng.normal(size=(10, 3)):
        x, y, z = np.array([0.45, 0.3, low]) + 0.9 * gap * shift / np.linalg.norm(shift)
        moved = pp.Obstacle("ball", pp.Sphere(0.05), pp.pose((x, y, z)))
        assert checker.with_scene(checker.scene.add(moved)).is_free_batch(q).all()
    far = pp.MotionLibrary(with_ball(0.9), obstacle_tolerance=1.1 * gap).add("swing", swing)
    far.save(tmp_path / "far.json")
    with pytest.raises(NotProvenFree):
        pp.MotionLibrary(near, obstacle_tolerance=1.1 * gap).add("swing", swing)
    assert not far.with_checker(near)["swing"].free
    assert not pp.MotionLibrary.load(tmp_path / "far.json", near)["swing"].free
    repaired = far.with_checker(near).repair("swing", clearance=1.4 * gap).or_raise().motion.trajectory
    assert distance_of_ball(near, repaired(np.linspace(0, repaired.duration, 200))) > 1.1 * gap
    assert covered.with_checker(with_ball(0.9)).with_checker(near)["swing"].free

    assert pp.MotionLibrary(near).add("swing", swing)["swing"].free
    assert not near.is_free_batch(q + rng.choice([-0.02, 0.02], q.shape)).all()
    wide = pp.MotionLibrary(with_ball(0.9), joint_tolerance=0.02).add("swing", swing)
    wide.save(tmp_path / "wide.json")
    with pytest.raises(NotProvenFree):
        pp.MotionLibrary(near, joint_tolerance=0.02).add("swing", swing)
    assert not wide.with_checker(near)["swing"].free
    assert not pp.MotionLibrary.load(tmp_path / "wide.json", near)["swing"].free


def distance_of_ball(checker: pp.CollisionChecker, q: np.ndarray) -> float:
    """The smallest distance of the ball from the arm beyond the margin, at configurations (N, 6)."""
    rest = [k for k, pair in enumerate(checker.pairs) if all(checker.bodies[i].owner != "ball" for i in pair)]
    return float(checker.without_pairs(rest).clearance_batch(q).min() - checker.margin)


@pytest.mark.parametrize(
    ("mistake", "named"),
    [
        (lambda library: library.find(start=[1.0, 2.0]), "start or goal"),
        (lambda library: library.find(start=HIGH, joints=0.0), "joints = 0.0"),
        (lambda library: library.add("", library["lift"].trajectory), "not empty"),
        (lambda library: library.repair("swings"), "unknown motion 'swings'"),
        (lambda library: pp.MotionLibrary(library.checker, obstacle_tolerance="x"), "obstacle_tolerance = x"),
        (lambda library: pp.MotionLibrary(library.checker, joint_tolerance=-1), "joint_tolerance = -1"),
        (lambda library: pp.MotionLibrary(library.checker, joint_tolerance=[0.1, 0.2]), "joint_tolerance"),
        (lambda library: library.add("line", HIGH), "not a ndarray"),
        (lambda library: library.with_checker(None), "CollisionChecker, not None"),
        (lambda library: pp.Monitor(library.checker, HIGH), "not a ndarray"),
        (lambda library: pp.Monitor(library.checker, library["lift"].trajectory, latency="x"), "latency"),
        (lambda library: pp.Monitor(library.checker, library["lift"].trajectory, certificate=3), "type Certificate"),
    ],
)  # fmt: skip
def test_mistakes_are_named(library, mistake, named) -> None:
    with pytest.raises(InputError, match=named):
        mistake(library)
    with pytest.raises(FileError, match=r"\.json"):
        library.save("library.txt")


def test_file_with_a_repeated_or_changed_motion_is_refused(library, checker, tmp_path) -> None:
    file = tmp_path / "library.json"
    library.save(file)
    data = json.loads(file.read_text())
    again = {**data, "motions": [*data["motions"], data["motions"][0]]}
    changed = json.loads(json.dumps(data))
    changed["motions"][1]["motion"]["points"][1]["positions"][2] += 1e-12
    for wrong, words in ((again, r"motions\[2\].*'swing'"), (changed, r"motions\[1\].*'lift' was changed")):
        file.write_text(json.dumps(wrong))
        with pytest.raises(FileError, match=words):
            pp.MotionLibrary.load(file, checker)
