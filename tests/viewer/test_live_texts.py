"""What pages that compute write as text: names for YAML files and shells, and figures of joints."""

import base64
import json
import shutil
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import pinproof as pp
from pinproof.collision import CollisionChecker, Scene, certify
from pinproof.viewer import write_html
from pinproof.viewer.picture import Picture
from pinproof.viewer.web_cell import WebCell, web_cell_of

from .conftest import POST, small_arm, swing

VIEWER = Path(__file__).parents[2] / "src" / "pinproof" / "viewer"

NAMES = ["post", "left wall", "true", "No", "null", "y", "1e5", "-rf", "a'b", 'a"b', "$(id)", "`id`", "a\\b", "a # b",
         "- x", "{x: y}", "a: b", "\u2028- {name: x}", "a\x85b", "a\x7fb", "\ufeffa", "\U0001f600", "line\nbreak", "&x",
         "*x", "!x", "%x", "@x", "~", ".inf", "0x10", "1_000", "12:30:00", "_1", "</script>"]  # fmt: skip


def in_node(call, *values):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    text = "".join((VIEWER / name).read_text(encoding="utf-8") for name in ("handle.js", "live_view.js"))
    text += f"console.log(JSON.stringify(({call})(...{json.dumps(values)})));"
    done = subprocess.run([node, "-e", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_names_are_the_same_after_yaml_and_after_a_shell():
    in_yaml, in_shell = in_node("(names) => [names.map(plain), names.map(quoted)]", NAMES)
    text = "\n".join(f"- {{name: {name}}}  # {json.dumps(name)[1:-1]}" for name in in_yaml)
    assert [row["name"] for row in yaml.safe_load(text)] == NAMES
    printed = subprocess.run(
        ["sh", "-c", f"printf '%s\\0' {' '.join(in_shell)}"], capture_output=True, check=True
    ).stdout.decode()
    assert printed.split("\0")[:-1] == NAMES


def test_poses_are_the_same_after_yaml():
    rng = np.random.default_rng(0)
    angles = [*rng.uniform(-np.pi, np.pi, (20, 3)), (0.4, np.pi / 2, 0.3), (0.4, -np.pi / 2, 0.3), (0, 0, 0)]
    poses = [pp.pose(xyz=rng.uniform(-2, 2, 3), rpy=rpy) for rpy in angles]
    values = [[*(1e3 * pose.translation), *np.degrees(pp.xyz_rpy(pose)[3:])] for pose in poses]  # as three.js returns
    texts = in_node("(all) => all.map((values) => { valuesOf = () => values; return poseText(); })", values)
    for text, expected in zip(texts, poses, strict=True):
        fields = yaml.safe_load(f"{{{text}}}")
        assert pp.pose(xyz=fields["xyz"], rpy=fields.get("rpy", (0, 0, 0))).isApprox(expected, 3e-6)


def test_a_joint_with_one_limit_is_outside_beyond_it():
    arm = pp.load_robot(ROBOT).arm("tip")
    lower, upper = np.array([-np.inf, -1.0]), np.array([1.0, np.inf])
    web = WebCell.of(pp.CollisionChecker(arm.with_limits(replace(arm.limits, lower=lower, upper=upper)))).settings
    figures = "(web, all) => all.map((q) => figuresOf(web, { manipulability: [0.25] }, q).split('. ')[0])"
    shown = ["Outside its limits: turn", "Outside its limits: bend", "Nearest limit: turn, 28.6\u00b0"]
    assert in_node(figures, web, [[2.5, 0.0], [-9.0, -1.1], [0.5, 9.0]]) == shown


def test_a_joint_at_its_limit_is_within_it_after_the_text_is_read():
    limits = [np.pi, 2.0944, 2.0943951023931953, -2 * np.pi, 0.0001234567]
    texts = in_node("(all) => all.map(short)", limits)
    assert np.allclose([float(text) for text in texts], limits, rtol=0.0, atol=6e-10)
    limit = pp.JointLimits([-limits[0]], [limits[0]], [1.0])
    assert limit.violations(limit.snap(np.array([float(texts[0])])), ["turn"]) == []


def test_joints_without_limits_are_never_outside_them():
    arm = pp.load_robot(ROBOT).arm("tip")
    web = WebCell.of(pp.CollisionChecker(arm)).settings
    figures = "(web, q) => figuresOf(web, { manipulability: [0.25] }, q)"
    assert in_node(figures, web, [4.0, 0.5]) == "Nearest limit: bend, 28.6\u00b0. Manipulability: 0.250"
    assert in_node(figures, web, [-40.0, 1.5]) == "Outside its limits: bend. Manipulability: 0.250"
    free = {**web, "joints": web["joints"][:1]}
    assert in_node(figures, free, [4.0]) == "No joint limits. Manipulability: 0.250"


ROBOT = """<robot name="turner">
<link name="base"/>
<link name="arm"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link><link name="tip"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="bend" type="revolute"><parent link="arm"/><child link="tip"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.mark.slow
def test_typescript_finds_no_fault_in_the_scripts():
    root = VIEWER.parents[2]
    done = subprocess.run([root / "scripts" / "check_javascript"], capture_output=True, text=True, check=False)
    if done.returncode == 77:
        pytest.skip("TypeScript is not available")
    assert done.returncode == 0, done.stdout


def test_a_page_of_a_recorded_proof_has_the_margins_of_single_pairs_of_its_checker(tmp_path):
    arm = small_arm()
    checker = CollisionChecker(arm, Scene([POST]), margins={("post", "upper"): 0.0123})
    certificate = certify(swing(arm, end=0.2), checker, record=True)
    assert certificate.free
    write_html(tmp_path / "page.html", arm, Scene([POST]), swing(arm, end=0.2), certificate=certificate)
    text = (tmp_path / "page.html").read_text(encoding="utf-8").split('id="cell">', 1)[1].split("<", 1)[0]
    assert 0.0123 in np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype="<f8")


@pytest.mark.parametrize("record", [True, False])
def test_a_page_without_the_checker_of_its_proof_states_that_margins_of_single_pairs_are_unknown(record):
    arm, scene, motion = small_arm(), Scene([POST]), swing(small_arm(), end=0.2)
    certificate = certify(motion, CollisionChecker(arm, scene, margins={("post", "upper"): 0.0123}), record=record)
    picture = Picture(arm, scene, motion, certificate=certificate)
    cell = web_cell_of(picture, picture.render(), True)
    assert cell.settings["knownMargins"] is record
    stated = in_node("unknownMargins", cell.settings)
    assert ("unknown" in stated) is not record
