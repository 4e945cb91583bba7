"""Pages and their captions and plots, pages of several arms, and pictures, without a browser or with one of our own."""

import json
import re
import stat
import subprocess
import sys
from base64 import b64decode
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import pinproof
import pinproof as pp
import pinproof.viewer.panels as panels_module
from pinproof import Trajectory
from pinproof.collision import CertificateStatus, CollisionChecker, LookAt, Scene, Upright, certify
from pinproof.errors import InputError, UnknownNameError, ViewerError
from pinproof.model import JointLimits
from pinproof.viewer import Commands, PlotLimits, Surface, node_path, png, write_html, write_png
from pinproof.viewer.page import HEIGHT, WIDTH, plots_html, render_page
from pinproof.viewer.picture import Picture, caption_of, proven_millimetres
from pinproof.viewer.wire import script_json

from ..processes import is_alive, wait_for
from .browser import find_browser
from .conftest import POST, certified, small_arm, swing, turn

MEGABYTE = 1e6


def embedded(text, name):
    found = re.search(rf'<script type="[^"]+" id="{name}">(.*?)</script>', text, re.DOTALL)
    assert found
    return found[1]


@pytest.mark.slow
def test_the_page_of_the_ur5_is_small(ur5, cell, tmp_path):
    write_html(tmp_path / "pick.html", ur5, cell, turn(ur5))
    assert (tmp_path / "pick.html").stat().st_size < 5 * MEGABYTE


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes():
    arm = small_arm()
    assert render_page(Picture(arm, None, swing(arm))).text == render_page(Picture(arm, None, swing(arm))).text


def test_the_page_names_no_address_outside_its_licences_and_its_viewer():
    arm = small_arm()
    text = render_page(Picture(arm, None, swing(arm))).text
    bundle, _ = panels_module._viewer_bundle()
    own = text.replace(bundle, "").replace(embedded(text, "licences"), "")
    assert "://" not in own
    assert set(re.findall(r'https?://[^"\'\s]+', bundle)) == {"http://www.w3.org/1999/xhtml"}  # a name, not a place
    assert "connect-src 'none'" in own


def test_the_licence_of_the_viewer_travels_with_it():
    text = render_page(Picture(small_arm(), None, None)).text
    assert "Copyright (c) 2018 Robin Deits" in text
    assert "Three.js Authors" in text


def test_names_cannot_become_markup():
    arm = small_arm(name="&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;")
    text = render_page(Picture(arm, None, None, title="<title>{{buffers}}")).text
    assert "alert(1)</script>" not in text
    assert "<h1>&lt;title&gt;{{buffers}}</h1>" in text


def test_a_page_that_fails_leaves_the_old_one_alone(tmp_path):
    old = tmp_path / "pick.html"
    old.write_text("old")
    arm = small_arm()
    for trajectory, q in ((swing(arm), [0.0, 0.0]), (None, [0.0])):
        with pytest.raises(InputError):
            write_html(old, arm, None, trajectory, q=q)
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_a_missing_folder_or_viewer_is_named(tmp_path, monkeypatch):
    with pytest.raises(ViewerError, match="gone"):
        write_html(tmp_path / "gone" / "pick.html", small_arm())
    monkeypatch.setattr(panels_module, "find_spec", lambda name: None)
    with pytest.raises(ViewerError, match="meshcat is not installed"):
        render_page(Picture(small_arm(), None, None))


def test_arrays_come_back_from_the_blob_as_they_went_in():
    commands = Commands()
    integers = [np.arange(count, dtype=kind) for kind, count in ((np.int8, 5), (np.uint16, 3), (np.uint32, 2))]
    arrays = [integers[0], np.arange(3, dtype=np.float32) / 7, *integers[1:]]
    arrays += [np.zeros(4, np.int8), np.zeros(1, np.uint32)]  # of equal bytes
    references = [commands.array(a)["$buffer"] for a in arrays]
    blob = b64decode(commands.base64())
    for (kind, offset, count), array in zip(references, arrays, strict=True):
        assert offset % 4 == 0
        assert kind.lower().removesuffix("array") == array.dtype.name
        assert np.array_equal(np.frombuffer(blob, array.dtype.newbyteorder("<"), count, offset), array)


def test_commands_are_safe_inside_a_script_and_mean_the_same():
    commands = Commands()
    commands.set_property("/</script>", "name", "<!--")
    text = script_json(commands.items)
    assert "<" not in text
    assert json.loads(text) == commands.items


def test_a_slash_in_a_name_makes_no_new_level():
    assert node_path("robot", "left/arm").count("/") == 2


def test_a_large_surface_gets_wide_indices():
    count = 70_000
    points = np.zeros((count, 3))
    commands = Commands()
    commands.set_surface("/big", Surface(points, points, np.array([[0, 1, count - 1]]), (1, 1, 1, 1)))
    index = commands.items[0]["object"]["geometries"][0]["data"]["index"]
    assert index["type"] == "Uint32Array"
    assert index["itemSize"] == 1


@pytest.mark.slow
def test_neither_meshcat_nor_trimesh_is_loaded_before_it_is_needed():
    script = (
        "import sys, pinproof.viewer; "
        "print(sorted({'meshcat', 'trimesh', 'scipy', 'zmq', 'IPython'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_colours_and_fonts_are_stated_only_in_the_theme():
    root = Path(pinproof.__file__).parent
    sources = [path for suffix in ("py", "js", "css", "html") for path in root.rglob(f"*.{suffix}")]
    stated = re.compile(
        r"""["':\s]#[0-9a-fA-F]{3}(?:[0-9a-fA-F]{3}){0,1}\b(?!\))|0x[0-9a-fA-F]{6}\b|sans-serif|monospace"""
    )
    white = {"0xffffff", "0xFFFFFF"}  # of lights, and of what has its colour from elsewhere
    found = {
        path.relative_to(root).as_posix(): set(stated.findall(path.read_text("utf-8"))) - white for path in sources
    }
    assert {name for name, colours in found.items() if colours} == {"common/theme.py"}


# -- captions ----------------------------------------------------------------------------------------------------------

ARM, SCENE = small_arm(), Scene([POST])
MOTION = swing(ARM, 0.0, 0.8)


@pytest.fixture(scope="module")
def certificate():
    return certified(ARM, SCENE, MOTION)


def assert_not_validated(shown, tone, *reasons):
    assert (shown.headline, shown.tone) == ("NOT VALIDATED", tone)
    assert [reason for reason in reasons if reason not in shown.reason] == []


def test_free_states_the_clearance_and_the_duration(certificate):
    shown = caption_of(ARM, SCENE, MOTION, certificate)
    assert (shown.headline, shown.tone) == ("FREE", "free")
    figures = dict(shown.figures)
    assert figures["Duration"] == "2.00 s"
    assert 0 < float(figures["Proven clearance"].removesuffix(" mm")) <= certificate.clearance * 1e3
    # no scene and an empty scene are the same
    assert caption_of(ARM, None, MOTION, certified(ARM, Scene(), MOTION)).headline == "FREE"


def test_pairs_excluded_from_the_proof_are_listed():
    scene = Scene([POST], allowed=[("upper", "post")])
    certificate = certified(ARM, scene, MOTION)
    ((_, excluded),) = caption_of(ARM, scene, MOTION, certificate).lists
    assert len(excluded) == len(certificate.excluded) > 0
    assert any("upper" in text and "post" in text for text in excluded)


def test_constraints_are_stated_with_their_bound_or_their_violation():
    checker = CollisionChecker(ARM, SCENE)
    vertical = Upright.keeping(ARM, MOTION.start, tolerance=0.1)
    kept = caption_of(ARM, SCENE, MOTION, certify(MOTION, checker, constraints=[vertical]))
    level = LookAt(point=ARM.forward_kinematics(MOTION.start).act(np.array([0.3, 0.0, 1.0])), tolerance=1e-3)
    lost = caption_of(ARM, SCENE, MOTION, certify(MOTION, checker, constraints=[level]))
    assert (kept.headline, "upright" in dict(kept.figures)["Constraint"].lower()) == ("FREE", True)
    assert_not_validated(lost, "open", "too much")


def test_a_configuration_has_the_headline_of_its_check(certificate):
    checker = CollisionChecker(ARM, SCENE)
    for check, headline in ((None, "CONFIGURATION"), ([0.0, 0.0], "NO CONTACT"), ([1.5, 0.0], "IN CONTACT")):
        checked = None if check is None else checker.check(check)
        assert caption_of(ARM, SCENE, None, None, check=checked).headline == headline


def test_what_is_not_proven_free_is_not_validated(certificate):
    assert_not_validated(caption_of(ARM, SCENE, swing(ARM), None), "open", "no certificate")
    assert certificate.status is CertificateStatus.FREE
    for curve, who, scene in (
        (swing(ARM, 0.0, np.nextafter(0.8, 1.0)), ARM, SCENE),
        (MOTION, ARM, SCENE.remove("post")),
        (MOTION, small_arm().robot.arm("hand"), SCENE),
        (MOTION, ARM, None),
    ):
        shown = caption_of(who, scene, curve, certificate)
        assert_not_validated(shown, "open", "another motion, arm, scene or tool")
    touching, long = swing(ARM, 0.0, 1.5), swing(ARM, -1.8, 0.8)
    contact = certified(ARM, SCENE, touching)
    time = f"at {contact.first_contact.time:.3f} s"
    assert_not_validated(caption_of(ARM, SCENE, touching, contact), "colliding", "upper", "post", time)
    undecided = certified(ARM, SCENE, long, max_intervals=1)
    assert undecided.status is CertificateStatus.UNDECIDED
    assert_not_validated(caption_of(ARM, SCENE, long, undecided), "open", "Undecided")


def test_every_text_is_escaped():
    html = caption_of(small_arm(name="&lt;img src=x&gt;"), None, None, None).html(["<b>note</b>"])
    assert [text in html for text in ("<img", "&lt;img src=x&gt;", "&lt;b&gt;note")] == [False, True, True]


@given(st.floats(0, 10))
def test_a_clearance_is_never_rounded_up(clearance):
    shown = float(proven_millimetres(clearance).removesuffix(" mm"))
    assert shown <= clearance * 1e3 + 1e-9
    assert shown == pytest.approx(clearance * 1e3, abs=0.1001)


def test_a_motion_outside_its_limits_is_not_validated_with_the_joint():
    fast, checker = swing(ARM, -2.0, 0.8), CollisionChecker(ARM, Scene())
    slow, faster = fast.slowed(9.0), JointLimits(ARM.limits.lower, ARM.limits.upper, 9 * ARM.limits.velocity)
    assert_not_validated(caption_of(ARM, Scene(), fast, certify(fast, checker)), "open", "turn reaches a velocity of")
    for curve, settings, words in (
        (fast, {"limits": None}, "not compared; turn reaches a velocity of"),
        (fast, {"limits": faster}, "not those of the arm; turn reaches a velocity of"),
        (slow, {}, "within the limits of position"),
    ):
        shown = caption_of(ARM, Scene(), curve, certify(curve, checker, **settings))
        assert shown.headline == "FREE"
        assert dict(shown.figures)["Joint limits"].startswith(words)


# -- plots -------------------------------------------------------------------------------------------------------------

RATES = SimpleNamespace(velocity=np.array([1.5, 1.0]), acceleration=np.array([3.0, np.inf]))


class Twice:
    """A constraint with one component, the doubled speed of the first joint."""

    name = "torque"

    def coefficients(self, q, slope, curvature):
        value = 2.0 * slope[:, :1]
        return np.zeros_like(value), value, np.zeros_like(value), np.full_like(value, 4.0)

    def excess(self, trajectory):
        return np.ones(len(trajectory.times) - 1)


def polylines(text):
    """The points (N, 2) of each line."""
    found = re.findall(r'<polyline [^>]*points="([^"]+)"', text)
    return [np.array([pair.split(",") for pair in points.split()], dtype=float) for points in found]


def share(y):
    """The share of the limit at heights in a panel, with the limit lines of the panel at 100 % (-100 %)."""
    return 1.12 * (1.0 - 2.0 * y / HEIGHT)


def test_lines_are_shares_of_the_limits():
    trajectory = swing(small_arm(), 0.0, 1.0, duration=2.0)  # a cubic with velocities of up to 0.75
    text = plots_html(trajectory, PlotLimits(RATES, None, [Twice()]))
    heads = re.findall(r'role="img" aria-label="([^"]+)"', text)
    assert heads == [
        "position, rad or m", "velocity, % of the limit", "acceleration, % of the limit", "jerk, rad/s³ or m/s³",
        "torque, % of the limit",
    ]  # fmt: skip
    drawn = polylines(text)
    assert len(drawn) == 2 + 2 + 1 + 2 + 1  # the second joint has no limit of acceleration
    times = 2.0 * drawn[2][:, 0] / WIDTH
    expected = trajectory.velocity(times.clip(0.0, 2.0))[:, 0] / 1.5
    assert np.abs(share(drawn[2][:, 1]) - expected).max() < 0.01
    assert share(drawn[4][:, 1]).max() == pytest.approx(1.5 / 3.0, abs=0.01)
    assert share(drawn[7][:, 1]).max() == pytest.approx(1.5 / 4.0, abs=0.01)
    assert "up to 50 % of the limit" in text


def test_an_excess_is_drawn_beyond_the_limit():
    slow = SimpleNamespace(velocity=np.array([0.25, 1.0]), acceleration=np.ones(2))
    text = plots_html(swing(small_arm(), 0.0, 1.0, duration=2.0), PlotLimits(slow))
    assert "up to 300 % of the limit" in text
    assert all((line >= 0.0).all() and (line[:, 1] <= HEIGHT).all() for line in polylines(text))


def test_a_page_without_a_motion_has_no_plots_and_one_with_a_motion_has_them():
    arm = small_arm()
    assert 'id="chart"' not in render_page(Picture(arm, None, None)).text
    assert render_page(Picture(arm, None, swing(arm))).text.count("<polyline") >= 4
    standing = Trajectory([0.0], np.zeros((1, 2)), np.zeros((1, 2)), arm.joint_names)
    assert plots_html(standing, PlotLimits()) == ""


def test_limits_of_another_length_are_refused():
    with pytest.raises(InputError, match="velocity"):
        plots_html(swing(small_arm()), PlotLimits(SimpleNamespace(velocity=np.ones(3), acceleration=np.ones(2))))


# -- several arms ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def group():
    arm = pp.load_robot("generic_6dof").arm()
    return pp.assemble({"a": (arm, np.eye(4)), "b": (arm, pp.pose((1.5, 0, 0)))})


def motion(group):
    return pp.time_parametrise(pp.JointPath(np.array([group.home, group.home + 0.4]), group.joint_names), group.limits)


@pytest.mark.slow
def test_each_arm_has_its_path_and_carries_its_object(group):
    tool = pp.Obstacle("tool", pp.Sphere(0.03), pp.pose(), arm="b")
    picture = Picture(group, None, motion(group), attached=[tool]).render()
    paths = {each.get("path") for each in picture.commands.items}
    assert {"/tcp path/0/line", "/tcp path/1/line"} <= paths
    names = [link.name for link in picture.stage.links]
    assert "b/tool0" in names  # drawn because of the tool that it carries
    assert "a/tool0" not in names
    tools = [name for name, is_tool in zip(names, picture.stage.tool, strict=True) if is_tool]
    assert {name.partition("/")[0] for name in tools} == {"a", "b"}


@pytest.mark.slow
def test_layers_name_the_nodes_of_links_with_a_prefix(group):
    picture = Picture(group, None, motion(group)).render()
    paths = {str(each.get("path")) for each in picture.commands.items}
    for layer in picture.settings["layers"]:
        for node in layer["nodes"]:
            if node[0] == "robot":
                assert any(path.startswith("/" + "/".join(node) + "/") for path in paths)


@pytest.mark.slow
def test_page_of_a_group_is_free_with_its_certificate_only(group):
    trajectory, checker = motion(group), pp.CollisionChecker(group)
    certificate = pp.certify(trajectory, checker)
    assert certificate.status is pp.CertificateStatus.FREE
    assert Picture(group, None, trajectory, certificate).render().caption.headline == "FREE"
    assert Picture(group.arms["a"], None, None, certificate).render().caption.headline != "FREE"


# -- PNG pictures ------------------------------------------------------------------------------------------------------


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Make a shell script the browser."""

    def make(body):
        script = tmp_path / "browser"
        script.write_text(f"#!/bin/sh\n{body}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PINPROOF_BROWSER", str(script))
        return script

    return make


@pytest.mark.slow
def test_a_still_picture_of_a_motion_has_its_size_its_moment_and_its_caption(tmp_path, monkeypatch):
    executable = find_browser()
    if executable is None:
        pytest.skip("no Chromium")
    monkeypatch.setenv("PINPROOF_BROWSER", executable)
    arm = small_arm()
    pictures = []
    for name, seconds in (("start", None), ("end", 2.0)):
        write_png(tmp_path / f"{name}.png", arm, None, swing(arm), time=seconds, size=(480, 360))
        pictures.append(np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int))
    assert [picture.shape for picture in pictures] == [(360, 480, 3)] * 2
    assert pictures[0][:300].std() > 10
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 30).mean() > 0.01  # another moment
    strip = pictures[0][-25:]
    assert (strip.min(axis=2) > 250).mean() > 0.6  # words on white
    assert (strip.max(axis=2) < 140).any()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["end.png", "start.png"]


def test_without_a_browser_the_error_names_the_remedy(tmp_path, monkeypatch):
    monkeypatch.delenv("PINPROOF_BROWSER", raising=False)
    monkeypatch.setattr(png, "BROWSERS", ("no-such-browser",))
    monkeypatch.setattr(png, "APPLICATIONS", ())
    with pytest.raises(ViewerError, match=r"no-such-browser.*PINPROOF_BROWSER"):
        write_png(tmp_path / "a.png", small_arm())
    assert list(tmp_path.iterdir()) == []


def test_a_missing_browser_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PINPROOF_BROWSER", "gone-browser")
    with pytest.raises(ViewerError, match="PINPROOF_BROWSER names gone-browser"):
        write_png(tmp_path / "a.png", small_arm())


@pytest.mark.parametrize("body", ["exit 1", "echo ERROR: no display >&2; exit 1", "echo pinproof: drawn >&2"])
def test_a_browser_without_a_result_leaves_no_file(tmp_path, program, body):
    program(body)
    with pytest.raises(ViewerError, match="did not produce a picture"):
        write_png(tmp_path / "a.png", small_arm())
    assert not (tmp_path / "a.png").exists()


def test_a_browser_that_hangs_is_killed_with_its_child_processes(tmp_path, program, monkeypatch):
    program(f"sleep 100000 & echo $! > {tmp_path}/starting; mv {tmp_path}/starting {tmp_path}/child; wait")
    timeout = 0.5
    while not (tmp_path / "child").exists():  # on a busy machine it is ended before it has started a child
        monkeypatch.setattr(png, "TIMEOUT", timeout)
        with pytest.raises(ViewerError, match=r"did not produce a picture within \d+ s"):
            write_png(tmp_path / "a.png", small_arm())
        timeout *= 2
    child = int((tmp_path / "child").read_text())
    wait_for(lambda: not is_alive(child))


def test_invalid_settings_are_refused_before_a_browser_starts(tmp_path):
    arm, path = small_arm(), tmp_path / "a.png"
    for settings, expected in (
        ({"time": 1.0}, "trajectory"),
        ({"trajectory": swing(arm), "time": 2.5}, "2.5 s"),
        ({"size": (10, 10)}, "64 to 4096"),
        ({"trajectory": swing(arm), "q": [0, 0]}, "trajectory and q"),
    ):
        with pytest.raises(InputError, match=expected):
            write_png(path, arm, **settings)
    with pytest.raises(UnknownNameError, match="collision"):
        write_png(path, arm, layers=["collisions"])
