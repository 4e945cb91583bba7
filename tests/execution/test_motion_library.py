"""The library of motions: lookup, changes of the scene, repair and files."""

from __future__ import annotations

import json

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import FileError, InputError, NotProvenFree, UnknownNameError

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
    ],
)
def test_file_for_another_setup_is_refused(library, checker, tmp_path, other, named) -> None:
    library.save(tmp_path / "library.json")
    with pytest.raises(FileError, match=named):
        pp.MotionLibrary.load(tmp_path / "library.json", other(checker))


def test_file_with_one_changed_number_is_refused(library, checker, tmp_path) -> None:
    file = tmp_path / "library.json"
    library.save(file)
    data = json.loads(file.read_text())
    data["motions"][1]["motion"]["points"][1]["positions"][2] += 1e-12
    file.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"motions\[1\].*'lift' was changed"):
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
