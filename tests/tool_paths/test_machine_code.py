"""Paths of G-code: arcs on the analytic circle, modes, strokes, and refused words with their line."""

import json

import numpy as np
import pytest

from pinproof.errors import ToolPathError
from pinproof.tool_paths import read_tool_paths


def strokes_of(folder, text, name="a.gcode", **keys):
    (folder / name).write_text(text)
    (folder / "job.json").write_text(json.dumps({"robot": "ur5", "strokes": [{"file": name, **keys}]}))
    return read_tool_paths(folder / "job.json").strokes


def positions(stroke):
    return stroke.path.poses[:, :3, 3]


@pytest.mark.parametrize(
    ("text", "centre", "radius", "swept", "axes"),
    [
        ("G17 G2 X10 Y0 I10 J0 F600", (0.01, 0, 0), 0.01, None, (0, 1)),
        ("G0 X10 Y0\nG3 X0 Y10 I-10 J0", (0, 0, 0), 0.01, np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG2 X0 Y10 I-10 J0", (0, 0, 0), 0.01, 3 * np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG3 X0 Y10 R10", (0, 0, 0), 0.01, np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG3 X0 Y10 R-10", (0.01, 0.01, 0), 0.01, 3 * np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG2 X0 Y10 R10", (0.01, 0.01, 0), 0.01, np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG2 X0 Y10 R-10", (0, 0, 0), 0.01, 3 * np.pi / 2, (0, 1)),
        ("G0 X10\nG3 X10 I-10", (0, 0, 0), 0.01, 2 * np.pi, (0, 1)),
        ("G18 G0 Z10 X0\nG3 Z0 X10 K-10 I0", (0, 0, 0), 0.01, np.pi / 2, (2, 0)),
        ("G19 G0 Y10 Z0\nG3 Y0 Z10 J-10 K0", (0, 0, 0), 0.01, np.pi / 2, (1, 2)),
        ("G20 G0 X1 Y0\nG3 X0 Y1 I-1", (0, 0, 0), 0.0254, np.pi / 2, (0, 1)),
        ("G0 X10 Y0\nG91 G3 X-10 Y10 I-10", (0, 0, 0), 0.01, np.pi / 2, (0, 1)),
        ("G90.1 G0 X10 Y0\nG3 X0 Y10 I0 J0", (0, 0, 0), 0.01, np.pi / 2, (0, 1)),
    ],
)  # fmt: skip
def test_arcs_are_on_the_analytic_circle(tmp_path, text, centre, radius, swept, axes):
    if swept is None:
        text, swept = "G0 X0 Y0\n" + text.replace("X10 Y0 I10", "X20 Y0 I10"), np.pi
    (stroke,) = strokes_of(tmp_path, text)
    points = positions(stroke) - np.array(centre)
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), radius), abs=1e-12)
    # The middles of the chords are within 0.02 mm of the circle, and the chords as long as the arc
    middles = np.linalg.norm(0.5 * (points[1:] + points[:-1]), axis=1)
    assert radius - middles.min() <= 2.0001e-5
    angles = np.unwrap(np.arctan2(points[:, axes[1]], points[:, axes[0]]))
    assert abs(angles[-1] - angles[0]) == pytest.approx(swept)
    assert np.sign(angles[-1] - angles[0]) == (-1.0 if "G2 " in text else 1.0)


def test_a_helix_rises_evenly_and_has_the_feed_of_its_line(tmp_path):
    (stroke,) = strokes_of(tmp_path, "G0 X10 Y0\nG3 X10 Y0 Z6 I-10 F600")
    z, angle = positions(stroke)[:, 2], np.linspace(0, 1, len(stroke.path))
    assert z == pytest.approx(0.006 * angle)
    assert stroke.path.speed == pytest.approx(np.full(len(z) - 1, 0.01))


def test_strokes_are_the_runs_of_feed_moves_and_the_process_splits_them(tmp_path):
    text = """%
    O1000 (glue)
    N10 G21 G90 G94 ; units
    N20 G0 X10 Y10
    N30 M3 S500
    N40 G1 Z-1 F300
    N50 X20
    N60 M5
    N70 X30
    N80 G0 Z5
    N90 X0 Y0 M3
    N100 G1 X0 Y5 F1200
    N110 M30
    %"""
    strokes = strokes_of(tmp_path, text, name="glue.nc")
    assert [(own.name, own.process, len(own.path)) for own in strokes] == [
        ("glue 1", True, 3), ("glue 2", False, 2), ("glue 3", True, 2),
    ]  # fmt: skip
    assert positions(strokes[0]) == pytest.approx(np.array([[10, 10, 0], [10, 10, -1], [20, 10, -1]]) * 1e-3)
    assert positions(strokes[2]) == pytest.approx(np.array([[0, 0, 5], [0, 5, 5]]) * 1e-3)
    assert strokes[0].path.speed == pytest.approx([0.005, 0.005])
    assert strokes[2].path.speed == pytest.approx([0.02])
    assert strokes[0].path.poses[0, :3, 2] == pytest.approx([0, 0, -1])
    _, tilted, _ = strokes_of(tmp_path, text, normals=[0, 1, 1], process=True, speed=0.05)
    assert tilted.path.poses[0, :3, 2] == pytest.approx(-np.array([0, 1, 1]) / np.sqrt(2))
    assert tilted.path.speed == pytest.approx([0.05])
    assert tilted.process


@pytest.mark.parametrize(
    "text", ["M83\nG1 X10 E1\nX20 E1\nE-2\nX30\nE2\nX40 E1", "M82\nG1 X10 E1\nX20 E2\nE0\nX30\nE2\nX40 E3"]
)
def test_a_printer_is_on_where_it_extrudes(tmp_path, text):
    strokes = strokes_of(tmp_path, "M104 S200\nG92 E0\n" + text)
    assert [(own.process, float(own.path.length)) for own in strokes] == [
        (True, pytest.approx(0.02)), (False, pytest.approx(0.01)), (True, pytest.approx(0.01)),
    ]  # fmt: skip


def test_the_unit_of_a_stroke_is_that_of_gcode_that_states_none(tmp_path):
    (stroke,) = strokes_of(tmp_path, "G0 X1\nG1 X2 F60", unit="in")
    assert positions(stroke)[:, 0] == pytest.approx([0.0254, 0.0508])
    assert stroke.path.speed == pytest.approx([0.0254])
    with pytest.raises(ToolPathError, match=r"line 1.*in mm, but unit is in"):
        strokes_of(tmp_path, "G21 G0 X1\nG1 X2 F60", unit="in")


@pytest.mark.parametrize("end", ["M2", "M30"])
def test_lines_behind_the_end_of_a_program_have_no_effect(tmp_path, end):
    (stroke,) = strokes_of(tmp_path, f"G0 X1\nG1 X2 F60 {end}\nG0 X5\nG1 X9\nno program")
    assert positions(stroke)[:, 0] == pytest.approx([0.001, 0.002])


def test_an_extruder_after_g91_is_read_only_if_all_controllers_read_it_alike(tmp_path):
    (stroke,) = strokes_of(tmp_path, "G91 M83\nG1 X1 E1 F60\nX1 E1\nX1 E1")
    assert (stroke.process, stroke.path.length) == (True, pytest.approx(0.003))
    first, last = strokes_of(tmp_path, "G1 X1 E9 F60\nG91\nG1 E-2\nG1 E-2 Z1\nG1 X3")
    assert (first.process, last.process) == (True, False)
    with pytest.raises(ToolPathError, match=r"line 3.*M83"):
        strokes_of(tmp_path, "G91\nG1 X1 E1 F60\nX1 E1")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G1 X1\nG1 X2 F60", "no feed"),
        ("G1 X1\nG41 D1", "line 2.*G41"),
        ("G1 X1\n\nG83 X1 Z-2 R1", "line 3.*G83"),
        ("M6 T1", "line 1.*M6"),
        ("T1", "T1"),
        ("G1 X1 A90", "A90"),
        ("G1 X1 Y#2", "line 1.*'Y#2'"),
        ("G1 Xnan", "not a word"),
        ("X1", "before one of G0"),
        ("G1 X1 X2", "states X twice"),
        ("G1 X1 I2", "without an arc"),
        ("G2 X1", "without its centre"),
        ("G2 X10 I5 R5", "by R and by its centre"),
        ("G2 X10 R4", "cannot reach"),
        ("G2 X0 R4", "cannot reach"),
        ("G2 X10 I4", "start of the arc is 4 from its centre, its end 6"),
        ("G18 G2 X10 J5", "across the plane G18"),
        ("G92 X0", "G92"),
        ("G1 X1 F0", "above 0"),
        ("G1 X1 F-5", "above 0"),
        ("G1 X500000 F100", "500"),
        ("G0 X1", "no feed move"),
        ("", "no feed move"),
    ],
)  # fmt: skip
def test_unusable_gcode_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(ToolPathError, match=words):
        strokes_of(tmp_path, text)
