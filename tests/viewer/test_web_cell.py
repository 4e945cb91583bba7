"""The core as WebAssembly against the core in Python: contacts, distances, inverse kinematics, and what was moved."""

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import CollisionChecker
from pinproof.viewer.web_cell import WebCell

ROOT = Path(__file__).parents[2]
VIEWER = ROOT / "src" / "pinproof" / "viewer"

DRIVER = """
const fs = require("fs"), [folder, viewer] = process.argv.slice(1);
const CellModel = new Function(fs.readFileSync(viewer + "/compute.js", "utf8") + "; return CellModel;")();
const read = (name) => new Float64Array(new Uint8Array(fs.readFileSync(folder + "/" + name)).buffer);
const { arms, ask } = JSON.parse(fs.readFileSync(folder + "/ask.json", "utf8"));
CellModel.load(fs.readFileSync(viewer + "/core.wasm"), read("cell"), arms).then((model) => {
  const configurations = read("q"), n = model.dof, out = [];
  for (const [first, last, ...pose] of ask.moved) if (!model.move(first, last, pose)) throw new Error("not moved");
  for (let k = 0; k < configurations.length; k += n) {
    const at = model.check(configurations.subarray(k, k + n));
    const pairs = at.contacts.map((pair) => [pair.a, pair.b]);
    out.push([at.lower, at.closest?.points ?? null, pairs, at.manipulability, at.poses.map((pose) => [...pose])]);
  }
  const solved = ask.targets.map(([arm, target, q]) => [model.solve(arm, target, q), model.branches(arm, target, q)]);
  fs.writeFileSync(folder + "/out.json", JSON.stringify({ out, solved }));
});
"""


def ask(folder, checker, Q, targets=(), moved=(), links=()):
    """The answers of the module for configurations Q and targets (arm, root_from_target, q)."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    web = WebCell.of(checker, links)
    (folder / "cell").write_bytes(web.block.tobytes())
    (folder / "q").write_bytes(np.ascontiguousarray(Q).tobytes())
    asked = {"targets": [[a, np.ravel(t).tolist(), list(q)] for a, t, q in targets], "moved": list(moved)}
    text = json.dumps({"arms": len(checker.group.arms), "ask": asked})
    (folder / "ask.json").write_text(text, encoding="utf-8")
    done = subprocess.run([node, "-e", DRIVER, folder, VIEWER], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "out.json").read_text(encoding="utf-8"))


def scene():
    shapes = {
        "table": (pp.Box(1.2, 1.6, 0.05), (0.35, 0.0, -0.1)),
        "post": (pp.Cylinder(radius=0.05, length=1.0), (0.3, 0.4, 0.5)),
        "ball": (pp.Sphere(radius=0.1), (0.5, -0.4, 0.4)),
    }
    return pp.Scene([pp.Obstacle(name, shape, pp.pose(xyz=xyz)) for name, (shape, xyz) in shapes.items()])


@pytest.fixture(scope="module")
def checkers():
    left, right = pp.load_robot("ur5").arm(tcp="tool0"), pp.load_robot("panda").arm()
    two = pp.assemble({"left": (left, pp.pose(xyz=(0, 0.45, 0))), "right": (right, pp.pose(xyz=(0, -0.45, 0)))})
    arms = {"ur5": left, "panda": right, "two": two}
    return {name: CollisionChecker(arm, scene()) for name, arm in arms.items()}


def sample(group, count, seed=0):
    lower, upper = group.limits.sampling_range()
    return np.random.default_rng(seed).uniform(lower, upper, (count, group.dof))


def agree(checker, Q, answers):
    """The contacts and the smallest distances of all configurations are those of Python."""
    free, both = checker.is_free_batch(Q), 0
    for q, (lower, points, contacts, manipulability, _), is_free in zip(Q, answers, free, strict=True):
        assert sorted(map(tuple, contacts)) == sorted(checker.indices_of(k) for k in checker.pairs_in_contact(q))
        assert (not contacts) == is_free
        both += is_free
        if is_free:
            assert lower == pytest.approx(checker.clearance(q), abs=2e-9)
            apart = np.linalg.norm(np.subtract(*points))
            assert apart == pytest.approx(checker.clearance(q), abs=1e-6)
        for (name, arm), value in zip(checker.group.arms.items(), manipulability, strict=True):
            own = arm.chain.manipulability_batch(q[checker.group.indices(name)][None])[0]
            assert value == pytest.approx(own, rel=1e-9, abs=1e-12)
    assert 0.02 < both / len(Q) < 0.98


@pytest.mark.parametrize("name", ["ur5", "panda", "two"])
def test_contacts_and_distances_are_those_of_python(checkers, tmp_path, name):
    checker, links = checkers[name], tuple(checkers[name].group.robot.urdf.links)
    Q = sample(checker.group, 1500)
    answers = ask(tmp_path, checker, Q, links=links)["out"]
    agree(checker, Q, answers)
    for q, answer in zip(Q[:20], answers, strict=False):
        for link, columns in zip(links, answer[4], strict=False):
            pose = np.reshape(columns, (4, 4)).T
            assert np.allclose(pose, checker.group.root_from_frame(q, link).homogeneous, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5", "panda", "two"])
def test_inverse_kinematics_is_that_of_python(checkers, tmp_path, name):
    group, clik, analytic = checkers[name].group, pp.Clik(), pp.AnalyticIk()
    starts, goals, asked, expected = sample(group, 300, 1), sample(group, 300, 2), [], []
    for number, (q0, goal) in enumerate(zip(starts, goals, strict=True)):
        index = number % len(group.arms)
        label, arm = list(group.arms.items())[index]
        own = group.indices(label)
        target = arm.forward_kinematics(goal[own]).homogeneous.copy()
        target[:3, 3] *= 1.6 if number % 10 == 0 else 1.0  # some are out of reach
        redundant = analytic.redundant_joints(arm)
        values = {"redundant_values": [q0[own][redundant[0]]]} if redundant else {}
        expected.append((own, clik.solve(arm, target, q0[own]), analytic.solve_all(arm, target, q0[own], **values)))
        asked.append((index, arm.root_from_base.homogeneous @ target, q0))
    reached = same = apart = 0
    solved = ask(tmp_path, checkers[name], starts[:1], asked)["solved"]
    for (own, result, branches), (found, every), (_, _, q0) in zip(expected, solved, asked, strict=True):
        assert found["reached"] == result.ok
        assert np.delete(found["q"], own).tolist() == np.delete(q0, own).tolist()
        if result.ok:  # the core in Python fuses products, so that a long search may differ
            same += found["iterations"] == result.iterations
            apart += not np.allclose(np.take(found["q"], own), result.q, atol=1e-6)
        assert len(every["q"]) == len(branches.branches)
        got = np.array(every["q"]).reshape(-1, group.dof)[:, own]
        for branch in branches.branches:
            assert np.abs(got - branch).max(axis=1).min() < 1e-7
        reached += result.ok
    assert 200 < reached < 300
    assert same > 0.98 * reached
    assert apart < 0.01 * reached


def test_moved_obstacles_and_a_moved_robot_are_those_of_another_scene(checkers, tmp_path):
    checker, shift = checkers["ur5"], pp.pose(xyz=(0.1, -0.2, 0.15), rpy=(0.1, 0.2, 0.7))
    Q, post = sample(checker.group, 400, 3), 1
    moved = [[post, post + 1, *shift.homogeneous.ravel().tolist()]]
    things = checker.scene.obstacles
    other = [pp.Obstacle(t.name, t.shape, shift * t.pose if t.name == "post" else t.pose) for t in things]
    agree(checker.with_scene(pp.Scene(other)), Q, ask(tmp_path, checker, Q, moved=moved)["out"])
    # Seen from a robot that moves, its surroundings move in the opposite direction
    moved = [[-1, -1, *shift.homogeneous.ravel().tolist()]]
    other = [pp.Obstacle(t.name, t.shape, shift.inverse() * t.pose) for t in things]
    agree(checker.with_scene(pp.Scene(other)), Q, ask(tmp_path, checker, Q, moved=moved)["out"])


def test_the_committed_module_is_that_of_its_sources():
    spec = importlib.util.spec_from_file_location("wasm_sources", ROOT / "scripts" / "wasm_sources.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    stored = (VIEWER / "core.wasm.sources").read_text(encoding="utf-8").strip()
    assert stored == module.hash_of_sources(), "scripts/build_wasm compiles the module again"


def test_a_block_of_other_numbers_is_refused(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    checker = CollisionChecker(pp.load_robot("ur5").arm(tcp="tool0"), scene())
    block = WebCell.of(checker).block.copy()
    rng, hostile = np.random.default_rng(0), []
    for number in range(200):
        other = block.copy()
        other[rng.integers(0, len(block) if number % 2 else 400)] = rng.choice(
            [np.nan, np.inf, -1.0, 1e300, 2**31, 0.5]
        )
        hostile.append(other)
    hostile += [block[:-1], block[:0], np.append(block, 1.0), np.full(50, np.inf)]
    (tmp_path / "cell").write_bytes(np.concatenate(hostile).tobytes())
    lengths = json.dumps([len(each) for each in hostile])
    driver = DRIVER.split("const { arms")[0] + (
        f"const numbers = read('cell'); let at = 0, module = fs.readFileSync(viewer + '/core.wasm');(async () => {{"
        f"for (const length of {lengths}) {{ const block = numbers.subarray(at, at += length); let words = 'refused';"
        "try { const model = await CellModel.load(module, block, 1); model.check([0, 0, 0, 0, 0, 0]); words = 'read'; }"
        " catch {} console.log(words); } })();"
    )
    done = subprocess.run(
        [node, "-e", driver, tmp_path, VIEWER], capture_output=True, text=True, timeout=300, check=False
    )
    words = done.stdout.split()
    assert len(words) == len(hostile), done.stderr
    assert words[-4:] == ["refused"] * 4
    assert words.count("refused") > 4
