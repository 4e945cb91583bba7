"""Certificates as files: every kind of arm and curve, in a form that independent code verifies."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
import pinproof.verifier
from pinproof.collision import Cone, Ellipsoid
from pinproof.errors import NotProvenFree
from pinproof.motion import CubicPath
from pinproof.verifier import load, verify

LARGEST_FILE = 5e6
"""Bytes: what a proof may take up."""

SHELF = pp.Scene(
    [
        pp.Obstacle("board", pp.Box(0.6, 0.6, 0.02), pp.pose((0.6, 0, 0.2))),
        pp.Obstacle("upper", pp.Box(0.6, 0.6, 0.02), pp.pose((0.7, 0, 0.9))),
        pp.Obstacle("side", pp.Box(0.6, 0.02, 0.8), pp.pose((0.6, 0.5, 0.5), (0, 0, 0.1))),
        pp.Obstacle("can", pp.Cylinder(0.03, 0.12), pp.pose((0.5, -0.2, 0.28))),
        pp.Obstacle("ball", pp.Sphere(0.05), pp.pose((0.3, -0.6, 0.5))),
        pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -0.3))),
    ]
)
"""A shelf as those of MotionBenchMaker's bookshelves: boards, sides, things on them."""

ROUND = pp.Scene(
    [
        pp.Obstacle("pill", pp.Capsule(0.05, 0.3), pp.pose((0.9, 0.6, 0.3), (1, 0.3, 0))),
        pp.Obstacle("tip", Cone(0.1, 0.2), pp.pose((-0.9, 0.4, 0.1), (0.5, 0, 0))),
        pp.Obstacle("egg", Ellipsoid(0.05, 0.1, 0.15), pp.pose((0.2, -1.2, 0.4), (0.3, 0.3, 0.3))),
    ]
)

PANDA_HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def line_through(arm, start, *steps):
    points = [np.asarray(start, dtype=float)]
    for step in steps:
        points.append(points[-1] + step)
    return pp.JointPath(np.array(points), arm.joint_names)


def saved(tmp_path, curve, checker, name="proof.json", **settings):
    certificate = pp.certify(curve, checker, record=True, **settings).or_raise()
    certificate.save(tmp_path / name)
    return certificate, tmp_path / name


def test_a_panda_in_a_shelf(tmp_path, panda):
    checker, curve = pp.CollisionChecker(panda, SHELF), line_through(panda, PANDA_HOME, [0.5, 0.2, 0, 0.3, 0.2, 0, 0.4])
    certificate, file = saved(tmp_path, curve, checker)
    verdict = pp.verify_proof(file, checker, curve)
    assert verdict.ok, verdict
    assert verdict.not_compared == ()
    assert verdict.clearance >= certificate.clearance - 1e-6
    assert file.stat().st_size < LARGEST_FILE
    least = min(checker.clearance(q) for q in curve(np.linspace(*curve.domain, 300)))
    assert verdict.clearance <= least
    data = load(file)
    assert {tuple(row[:2]) for row in data["excluded"]} == {pair.owners for pair in certificate.excluded}
    assert data["hashes"]["curve"] == certificate.curve
    assert data["hashes"]["setup"] == certificate.setup


def test_fingers_that_move_with_their_leader(tmp_path):
    """An arm whose q opens a finger, and the other finger mimics it."""
    arm = pp.load_robot("panda").arm(tcp="panda_leftfinger")
    assert arm.followers
    curve = line_through(arm, np.append(PANDA_HOME, 0.005), np.append([0.3, 0, 0, 0, 0, 0.2, 0.3], 0.03))
    checker = pp.CollisionChecker(arm, SHELF)
    _, file = saved(tmp_path, curve, checker)
    assert pp.verify_proof(file, checker, curve).ok
    followers = [row for row in load(file)["joints"] if row["name"] in arm.followers]
    assert [row["leader"] for row in followers] == [arm.dof - 1]


@pytest.mark.parametrize("name", ["generic_6dof", "stanford", "scara", "ur5"])
@pytest.mark.slow
def test_other_arms_among_round_things_in_a_tube(tmp_path, name):
    arm = pp.load_robot(name).arm()
    rng, proven = np.random.default_rng(1), 0
    lower, upper = arm.limits.sampling_range()
    while proven < 2:
        start = rng.uniform(lower, upper)
        curve = line_through(arm, start, 0.15 * rng.uniform(-1, 1, (1, arm.dof))[0])
        checker = pp.CollisionChecker(arm, ROUND, margin=0.001)
        certificate = pp.certify(curve, checker, joint_tolerance=1e-3, obstacle_tolerance=2e-3, record=True)
        if not certificate.free:
            continue
        proven += 1
        certificate.save(tmp_path / "proof.json.gz")
        verdict = pp.verify_proof(tmp_path / "proof.json.gz", checker, curve)
        assert verdict.ok, verdict
        assert verdict.clearance >= certificate.clearance - 1e-6
        assert verdict.joint_tolerance == (1e-3,) * arm.dof
        assert verdict.obstacle_tolerance == 2e-3


def test_curves_of_every_kind(tmp_path, generic_6dof):
    path = line_through(generic_6dof, generic_6dof.home, [0.3, 0.1, 0, 0, 0.2, 0], [0.2, -0.1, 0.1, 0, 0, 0.3])
    checker = pp.CollisionChecker(generic_6dof, ROUND)
    cubic = CubicPath(path.q, [[0.4, 0, 0, 0, 0, 0], [0, 0.4, 0, 0, 0, 0], [0.3] * 6], [0, 1, 3], path.joint_names)
    still = pp.JointPath(path.q[:1], generic_6dof.joint_names)
    for curve in (path, cubic, pp.time_parametrise(path, generic_6dof.limits), still):
        _, file = saved(tmp_path, curve, checker)
        assert pp.verify_proof(file, checker, curve).ok


def test_an_arm_with_nothing_to_touch(tmp_path, slider, path):
    """No pair: no clearance to speak of, and a proof all the same."""
    checker = pp.CollisionChecker(slider)
    certificate, file = saved(tmp_path, path(slider, [0.0], [0.1]), checker)
    assert certificate.pairs == 0
    verdict = pp.verify_proof(file, checker)
    assert verdict.ok
    assert verdict.clearance == np.inf


def test_a_value_that_is_no_curve_is_refused(tmp_path, slider, path):
    checker = pp.CollisionChecker(slider)
    _, file = saved(tmp_path, path(slider, [0.0], [0.1]), checker)
    with pytest.raises(pp.InputError, match="must be a curve"):
        pp.verify_proof(file, checker, "motion.json")


def test_the_same_certificate_is_the_same_file(tmp_path, generic_6dof):
    curve = line_through(generic_6dof, generic_6dof.home, [0.3, 0.1, 0, 0, 0.2, 0])
    for name in ("a.json", "b.json", "a.json.gz", "b.json.gz"):
        saved(tmp_path, curve, pp.CollisionChecker(generic_6dof, ROUND), name)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert (tmp_path / "a.json.gz").read_bytes() == (tmp_path / "b.json.gz").read_bytes()
    assert load(tmp_path / "a.json") == load(tmp_path / "a.json.gz")


@pytest.mark.slow
def test_a_copy_of_the_verifier_runs_without_the_rest(tmp_path, generic_6dof):
    curve = line_through(generic_6dof, generic_6dof.home, [0.3, 0.1, 0, 0, 0.2, 0])
    _, file = saved(tmp_path, curve, pp.CollisionChecker(generic_6dof, ROUND))
    shutil.copytree(Path(pinproof.verifier.__file__).parent, tmp_path / "verifier")
    watch = (
        "import runpy, sys\n"
        f"sys.argv = ['verifier', {file.name!r}]\n"
        "try:\n    runpy.run_module('verifier', run_name='__main__')\n"
        "except SystemExit as ended:\n    print('code', ended.code)\n"
        "print(sorted({'pinproof', 'pinocchio', 'coal', 'scipy'} & set(sys.modules)))"
    )
    words = [sys.executable, "-c", watch]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("HOLDS")
    assert done.stdout.splitlines()[-2:] == ["code 0", "[]"]


# -- exact meshes --------------------------------------------------------------------------------------------------


def test_links_and_parts_as_exact_meshes(tmp_path, slider, arm_from_links, mesh_file, path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    part = pp.Mesh.from_arrays(box.vertices + np.array([0, 0.5, 0]), box.faces, hull=False)
    slide = [("slide", "prismatic", "root", "block", "0 0 0", "1 0 0")]
    arm = arm_from_links({"root": "", "block": f'<mesh filename="{mesh_file(box)}"/>'}, slide).arm(tcp="block")
    around = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((0, 1, 0))), pp.Obstacle("part", part)])
    for checker, curve in (
        (pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("part", part)])), path(slider, [0.0], [0.1])),
        (pp.CollisionChecker(arm, around, link_meshes="surface"), path(arm, [0.0], [0.1])),
    ):
        certificate, file = saved(tmp_path, curve, checker)
        verdict = pp.verify_proof(file, checker, curve)
        assert verdict.ok, verdict
        assert verdict.clearance >= certificate.clearance - 1e-6
        moved = checker.with_scene(checker.scene.move("part", pp.pose((0, 1e-6, 0))))
        assert "your part" in str(pp.verify_proof(file, moved, curve))
        solid = load(file)["bodies"][-1]["shape"]
        open_ = pp.Mesh.from_arrays(np.array(solid["vertices"]), np.array(solid["triangles"]), hull=False, hollow=True)
        other = checker.with_scene(checker.scene.remove("part").add(pp.Obstacle("part", open_)))
        assert any(".shape: differs from your part" in each for each in pp.verify_proof(file, other, curve).reasons)


def test_a_ring_that_is_carried_out_of_a_ribbed_bin(tmp_path):
    """Both are exact meshes: neither has 64 convex pieces that fit."""
    arm = pp.load_robot("ur5").arm()
    ring = trimesh.creation.torus(0.03, 0.01, 24, 12)
    wall, floor = trimesh.creation.box((0.02, 0.4, 0.15)), trimesh.creation.box((0.5, 0.4, 0.02))
    walls = [wall.copy().apply_translation((x, 0, 0.08)) for x in (-0.24, -0.08, 0.08, 0.24)]
    bin_ = trimesh.util.concatenate([floor, *walls])
    at = arm.forward_kinematics(np.array([0.3, -1.3, 1.8, -2.0, -1.57, 0.2]))
    pose = pp.pose(at.translation - [0.0, 0.0, 0.23], (0, 0, 0.3 + np.pi / 2))
    scene = pp.Scene([pp.Obstacle("bin", pp.Mesh.from_arrays(bin_.vertices, bin_.faces, hull=False), pose)])
    held = pp.Obstacle("ring", pp.Mesh.from_arrays(ring.vertices, ring.faces, hull=False), pp.pose((0, 0, 0.18)))
    checker = pp.CollisionChecker(arm, scene, margin=0.001, attached=[held])
    curve = line_through(
        arm, [0.3, -1.3, 1.8, -2.0, -1.57, 0.2], [0.02, -0.4, 0.0, 0.4, 0, 0.3], [0.3, -0.3, 0, 0, 0, 0]
    )
    certificate, file = saved(tmp_path, curve, checker, joint_tolerance=1e-4, obstacle_tolerance=5e-4)
    verdict = pp.verify_proof(file, checker, curve)
    assert verdict.ok, verdict
    assert verdict.clearance >= certificate.clearance - 1e-6
    assert verdict.clearance <= min(checker.clearance(q) for q in curve(np.linspace(*curve.domain, 100)))
    assert file.stat().st_size < LARGEST_FILE


@pytest.mark.slow
def test_motions_beside_random_meshes_are_saved_and_verified(tmp_path):
    arm, rng, proven = pp.load_robot("generic_6dof").arm(), np.random.default_rng(5), 0
    ground = pp.collision.HeightMap(0.02 * rng.random((9, 7)), 0.8, 0.6, bottom=-0.05)
    while proven < 12:
        meshes = []
        for k in range(3):
            mesh = trimesh.creation.torus(
                rng.uniform(0.1, 0.3), 0.05, int(rng.integers(4, 40)), int(rng.integers(3, 20))
            )
            mesh.faces = mesh.faces[: -5 if k == 2 else None]
            shape = pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False, hollow=k == 2)
            meshes.append(pp.Obstacle(f"m{k}", shape, pp.pose(rng.uniform(-0.9, 0.9, 3), rng.uniform(-3, 3, 3))))
        scene = pp.Scene([*meshes, pp.Obstacle("ground", ground, pp.pose((0.7, 0, -0.4)))])
        held = pp.Obstacle("held", meshes[0].shape, pp.pose((0, 0, 0.1)))
        checker = pp.CollisionChecker(arm, scene.remove("m0"), margin=0.001, attached=[held])
        curve = line_through(arm, rng.uniform(-1.5, 1.5, 6), rng.uniform(-0.3, 0.3, 6))
        certificate = pp.certify(curve, checker, record=True)
        if not certificate.free:
            continue
        proven += 1
        certificate.save(tmp_path / "proof.json.gz")
        verdict = pp.verify_proof(tmp_path / "proof.json.gz", checker, curve)
        assert verdict.ok, verdict
        assert verdict.clearance >= certificate.clearance - 1e-6


# -- what is refused -----------------------------------------------------------------------------------------------


def test_what_cannot_be_saved_as_a_proof_is_refused_with_the_remedy(tmp_path, slider, path):
    short, recorded = path(slider, [0.0], [0.1]), {"record": True}
    wall, bare = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.3, 0, 0)))]), pp.CollisionChecker(slider)
    fast = CubicPath([[0.0], [0.1]], [[0.0], [0.0]], [0.0, 1e-9], slider.joint_names)  # who rounds its times loses it
    for curve, checker, settings, name, error, words in (
        (short, bare, {}, "proof.json", pp.InputError, "record=True"),
        (path(slider, [0.0], [0.4]), pp.CollisionChecker(slider, wall), recorded, "a.json", pp.InputError, "COLLIDING"),
        *((short, bare, recorded, name, pp.InputError, r"\.json") for name in ("proof.yaml", "proof", "proof.gz")),
        (fast, bare, recorded, "a.json", NotProvenFree, r"curve\.knots"),
    ):
        with pytest.raises(error, match=words):
            pp.certify(curve, checker, **settings).save(tmp_path / name)
        assert not any(file.suffix in (".json", ".yaml", ".gz") for file in tmp_path.iterdir())


def test_shapes_of_different_kinds_do_not_match(tmp_path, slider, path):
    """The obstacle is a half-space in the proof and a box in the scene, or the other way round."""
    scenes = [
        pp.Scene([pp.Obstacle("floor", shape, pp.pose((0, 0, -1)))]) for shape in (pp.HalfSpace(), pp.Box(1, 1, 0.1))
    ]
    checkers = [pp.CollisionChecker(slider, scene) for scene in scenes]
    curve = path(slider, [0.0], [0.1])
    for k, checker in enumerate(checkers):
        _, file = saved(tmp_path, curve, checker)
        assert pp.verify_proof(file, checker, curve).ok
        assert any(".shape: differs from your floor" in each for each in pp.verify_proof(file, checkers[1 - k]).reasons)


def test_the_hash_of_the_scene_is_that_of_its_obstacles_only(tmp_path, slider, path):
    balls = [pp.Obstacle(f"ball{k}", pp.Sphere(0.1 + 0.01 * k), pp.pose((0, 1, k))) for k in range(3)]
    curve, tool = path(slider, [0.0], [0.2]), pp.Obstacle("tool", pp.Sphere(0.01), pp.pose((0, -0.1, 0)))

    def hashed(obstacles, *attached):
        checker = pp.CollisionChecker(slider, pp.Scene(obstacles), attached=attached)
        return load(saved(tmp_path, curve, checker)[1])["hashes"]["scene"]

    changed = [[*balls[:k], pp.Obstacle(f"ball{k}", pp.Sphere(0.2), balls[k].pose), *balls[k + 1 :]] for k in range(3)]
    moved = [
        [*balls[:k], pp.Obstacle(f"ball{k}", balls[k].shape, pp.pose((0, 1.5, k))), *balls[k + 1 :]] for k in range(3)
    ]
    found = [hashed(obstacles) for obstacles in (balls, balls[1:], balls[:-1], *changed, *moved)]
    assert len(set(found)) == len(found)
    assert hashed(balls, tool) == found[0]


@pytest.mark.parametrize("data", [b"", b"{", b"\x1f\x8b broken", b'{"a": 1, "a": 2}', b"\xff\xfe", b"[" * 100_000])
def test_a_file_without_json_is_an_error(tmp_path, data):
    (tmp_path / "proof.json").write_bytes(data)
    with pytest.raises(pp.FileError, match=r"proof\.json"):
        pp.verify_proof(tmp_path / "proof.json")
    with pytest.raises(pp.FileError):
        pp.verify_proof(tmp_path / "nowhere.json")


# -- whose proof it is ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def known(tmp_path_factory, generic_6dof):
    """A proof file, with its checker and curve."""
    checker = pp.CollisionChecker(generic_6dof, ROUND, margin=0.001)
    curve = line_through(generic_6dof, generic_6dof.home, [0.3, 0.1, 0, 0, 0.2, 0])
    _, file = saved(tmp_path_factory.mktemp("proof"), curve, checker)
    return file, checker, curve


def test_omitted_comparisons_are_reported(known):
    file, checker, curve = known
    assert pp.verify_proof(file).not_compared == ("the robot", "the scene", "the motion")
    assert pp.verify_proof(file, curve=curve).not_compared == ("the robot", "the scene")
    # Without the motion it is not known that it is a path, which has no rates.
    rates, motion = pp.verify_proof(file, checker).not_compared
    assert "velocity" in rates
    assert motion == "the motion"
    assert pp.verify_proof(file, checker, curve).not_compared == ()
    assert "NOT compared" in str(pp.verify_proof(file))
    less = pp.verify_proof(file, checker.with_scene(ROUND.remove("egg")), curve)
    assert less.ok
    assert less.not_compared == ("egg (not in yours)",)


@pytest.mark.parametrize(
    ("other", "place"),
    [
        (lambda c: c.with_scene(ROUND.move("egg", pp.pose((0.2, -1.2, 0.4001), (0.3, 0.3, 0.3)))), "your egg"),
        (lambda c: c.with_scene(ROUND.remove("egg").add(pp.Obstacle("egg", pp.Sphere(0.05)))), "your egg"),
        (lambda c: c.with_scene(ROUND.add(pp.Obstacle("more", pp.Sphere(0.05), pp.pose((3, 0, 0))))), "your more"),
        (lambda c: c.with_margin(0.002), "settings.margin"),
        (lambda c: pp.CollisionChecker(pp.load_robot("ur5").arm(), ROUND), "joint_names"),
        (
            lambda c: c.with_attached(pp.Obstacle("tool", pp.Sphere(0.001), pp.pose((0, 0, 0.05)))),
            "your tool is missing",
        ),
    ],
)
def test_another_robot_or_scene_does_not_match_the_proof(known, other, place):
    file, checker, curve = known
    verdict = pp.verify_proof(file, other(checker), curve)
    assert not verdict.ok
    assert place in str(verdict)


@pytest.fixture(scope="module")
def with_fingers(tmp_path_factory):
    """The proof of an arm with meshes, whose fingers are held."""
    panda = pp.load_robot("panda").arm(held={"panda_finger_joint1": 0.03})
    checker, curve = pp.CollisionChecker(panda), line_through(panda, PANDA_HOME, [0.1, 0.1, 0, 0.1, 0.1, 0, 0.1])
    _, file = saved(tmp_path_factory.mktemp("fingers"), curve, checker)
    assert pp.verify_proof(file, checker, curve).ok
    return load(file), checker, curve


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda d: d["joints"][2].update(name="panda_joint9"), "joints[2].name"),
        (lambda d: d["robot"]["held"].update(panda_finger_joint1=0.01), "robot.held"),
        (lambda d: d["robot"]["held"].clear(), "robot.held"),
        (lambda d: d["robot"]["held"].update(more=0.0), "robot.held"),
        (lambda d: d["robot"]["held"].update(panda_finger_joint1="wide"), "robot.held"),
        (lambda d: d["robot"]["held"].update(panda_finger_joint1=None), "robot.held"),
        (lambda d: d["robot"].update(held=[0.03]), "robot.held"),
        (lambda d: d.update(robot=None), "robot.held"),
        (lambda d: d.pop("robot"), "robot.held"),
        (lambda d: d["bodies"][0].update(mesh_sha256="0" * 64), "bodies[0].mesh_sha256"),
        (lambda d: d["bodies"][0].pop("mesh_sha256"), "bodies[0].mesh_sha256"),
    ],
)
def test_names_held_joints_and_mesh_files_of_the_proof_are_compared(tmp_path, with_fingers, change, place):
    """They are for readers, who would be misled: no bound depends on them."""
    document, checker, curve = with_fingers
    forged = json.loads(json.dumps(document))
    change(forged)
    (tmp_path / "forged.json").write_text(json.dumps(forged))
    assert verify(forged).ok
    reasons = pp.verify_proof(tmp_path / "forged.json", checker, curve).reasons
    assert any(reason.startswith(place) for reason in reasons), reasons


def test_pairs_disabled_by_the_srdf_are_listed(tmp_path, known):
    _, checker, curve = known
    allowed = checker.allowing(("link_6", "egg"))
    _, file = saved(tmp_path, curve, allowed)
    assert pp.verify_proof(file, allowed, curve).ok
    assert "your checker requires link_6_0 and egg" in str(pp.verify_proof(file, checker, curve))


def test_another_motion_does_not_match_the_proof(known):
    file, checker, curve = known
    nearly = pp.JointPath(curve.q + 1e-6, curve.joint_names)
    assert "curve.control[0]" in str(pp.verify_proof(file, checker, nearly))
    longer = line_through(checker.arm, curve.q[0], [0.1] * 6, [0.1] * 6)
    assert "other pieces" in str(pp.verify_proof(file, checker, longer))
    assert pp.verify_proof(file, checker, pp.JointPath(curve.q + 5e-14, curve.joint_names)).ok


@pytest.mark.parametrize("by", [1e-4, 1e-10, 2.3e-16])
def test_knots_are_compared_exactly(tmp_path, generic_6dof, by):
    q = generic_6dof.home + np.array([[0.0] * 6, [0.3, 0.1, 0, 0, 0.2, 0], [0.4, 0.1, 0.1, 0, 0.2, 0]])
    checker = pp.CollisionChecker(generic_6dof, ROUND)
    curve, other = (CubicPath(q, np.zeros((3, 6)), [0, 1 + e, 3], generic_6dof.joint_names) for e in (0.0, by))
    _, file = saved(tmp_path, curve, checker)
    assert pp.verify_proof(file, checker, curve).ok
    verdict = pp.verify_proof(file, checker, other)
    assert "curve.knots[1]" in str(verdict)
    assert np.isnan(verdict.clearance)
