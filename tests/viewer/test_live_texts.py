"""What pages that compute write as text: names for YAML files and shells, and figures of joints."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

import pinproof as pp
from pinproof.viewer.web_cell import WebCell

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
