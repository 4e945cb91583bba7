"""Reports on picks as files: content and schema."""

from __future__ import annotations

import csv
import io
import sys

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import remove_robot
from pinproof.picks import PickStatus, Stage, StageResult
from pinproof.picks.input.picks import PickProblem
from pinproof.picks.report.report import CSV_COLUMNS, REPORT_SUFFIXES, SCHEMA

PROBLEM = PickProblem(7, "torn, row", "xyz holds nan at index 1")


def schema() -> dict:
    return pp.formats.file_schema("report")


@pytest.fixture(scope="module")
def report(reports) -> pp.picks.PickReport:
    """Good picks, one out of reach and one that could not be read."""
    done = reports["generic_6dof"]
    far = pp.Pick('far, "away"', pp.pose(xyz=(9, 0, 0)))
    stage = StageResult(Stage.REACH, False, "out of reach")
    verdict = pp.picks.PickVerdict(far, PickStatus.NOT_FOUND, (stage,), 0)
    return pp.picks.PickReport(
        done.robot, (*done.verdicts, verdict), (PROBLEM,), done.acceleration_source, done.notes, done.setup
    )


def test_the_json_keeps_to_its_schema(report) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.validate(report.to_dict(), schema())
    jsonschema.validate(pp.picks.PickReport("none", (), (), "none").to_dict(), schema())
    # It names every verdict and the version
    assert {each.value for each in PickStatus} <= set(schema()["$defs"]["verdict"]["properties"]["verdict"]["enum"])
    assert schema()["properties"]["schema"]["const"] == SCHEMA
    # It notices what is missing, and a good pick without a proof
    assert report.to_dict()["picks"][0]["verdict"] == "good"
    for lost in ("reason", "xyz", "stages", "clearance_proven", "motions", "refuted", "member", "proof"):
        data = report.to_dict()
        if lost == "proof":
            data["picks"][0]["pairs_proven"] = None
        else:
            del data["picks"][0][lost]
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(data, schema())


def test_every_format_states_what_a_grid_of_the_scene_assumes(arms, tmp_path) -> None:
    """Also what was removed from it, and that space outside of it is free."""
    arm = arms["generic_6dof"]
    cells = np.full((20, 10, 10), 2, dtype=np.uint8)
    grid = remove_robot(pp.OccupancyGrid(cells, 0.02, (-10, -5, 0)), pp.CollisionChecker(arm), arm.home)
    cleared = grid.record[-1]
    assert int(cleared.split()[0]) > 0
    scene = pp.Scene([pp.Obstacle("camera", grid)])
    far = pp.Picks((pp.Pick("far", pp.pose(xyz=(9, 0, 0))),), ())
    done = pp.validate_picks(arm, scene, far, home=arm.home, executor=None)
    for suffix in (".json", ".md", ".html"):
        done.save(tmp_path / f"report{suffix}")
        text = (tmp_path / f"report{suffix}").read_text(encoding="utf-8")
        assert "what camera does not show" in text
        assert cleared in text
        assert "space that was not seen is an obstacle" in text


def test_a_row_has_the_motions_the_score_and_the_refuted_branches(reports) -> None:
    rows = {row["name"]: row for row in reports["ur5"].to_dict()["picks"]}
    good, bad = rows["bolt_1"], rows["bolt_3"]
    assert [motion["name"] for motion in good["motions"]] == ["pick"]
    assert good["motions"][0]["attached"] == ["picker"]
    assert good["motions"][0]["clearance_proven"] == good["clearance_proven"]
    weights = pp.picks.PickWeights()
    parts = {part: value for part, value in good["score"].items() if part != "score"}
    assert sum(getattr(weights, part) * value for part, value in parts.items()) == pytest.approx(good["score"]["score"])
    assert good["refuted"] == bad["motions"] == []
    assert len(bad["refuted"]) == bad["stages"][1]["figures"]["configurations"] >= 8
    assert all("penetrates" in why for why in bad["refuted"])


def test_the_csv_gives_the_same_numbers_as_the_json(report) -> None:
    rows = list(csv.DictReader(io.StringIO(report.to_csv())))
    picks = report.to_dict()["picks"]
    assert tuple(rows[0]) == CSV_COLUMNS
    assert [row["name"] for row in rows] == [*(pick["name"] for pick in picks), "torn, row"]
    for row, pick in zip(rows, picks, strict=False):
        assert [float(row[k]) for k in ("x", "y", "z", "roll", "pitch", "yaw")] == [*pick["xyz"], *pick["rpy"]]
        assert row["duration"] == ("" if pick["duration"] is None else repr(pick["duration"]))
        assert row["reason"] == pick["reason"]
        assert row["motions"] == " ".join(motion["name"] for motion in pick["motions"])
        assert row["score"] == ("" if not pick["score"] else repr(pick["score"]["score"]))
        assert row["refuted"].splitlines() == pick["refuted"]
    assert (rows[-1]["verdict"], rows[-1]["failed_at"], rows[-1]["x"]) == ("unreadable", "input", "")
    # The pose of a row makes the pick again
    for verdict, row in zip(report.verdicts, picks, strict=True):
        again = pp.pose(xyz=row["xyz"], rpy=row["rpy"])
        assert np.allclose(again.homogeneous, verdict.pick.pose.homogeneous, atol=1e-12)


def test_the_data_frame_has_the_numbers_of_the_csv(report) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame, read = report.to_pandas(), pandas.read_csv(io.StringIO(report.to_csv()))
    assert tuple(frame.columns) == CSV_COLUMNS
    assert frame.name.tolist() == read.name.tolist()
    for column in ("x", "yaw", "duration", "clearance_proven", "score"):
        assert pandas.api.types.is_float_dtype(frame[column])
        np.testing.assert_array_equal(frame[column], read[column])


def test_a_data_frame_requires_pandas(report, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(pp.InputError, match="pip install pandas"):
        report.to_pandas()


@pytest.mark.slow
@pytest.mark.parametrize("kind", REPORT_SUFFIXES)
def test_every_kind_of_file_names_every_row(report, tmp_path, kind: str) -> None:
    path = tmp_path / f"report{kind}"
    report.save(path)
    text = path.read_text(encoding="utf-8")
    assert all(verdict.pick.name.partition(",")[0] in text for verdict in report.verdicts)
    assert "torn, row" in text


def test_a_verdict_keeps_its_own_configuration_which_cannot_be_changed() -> None:
    q = np.array([0.1, 0.2])
    verdict = pp.picks.PickVerdict(pp.Pick("p", pp.pose()), PickStatus.NOT_FOUND, (), q_grasp=q)
    q[0] = 9.0
    np.testing.assert_array_equal(verdict.q_grasp, [0.1, 0.2])
    with pytest.raises(ValueError, match="read-only"):
        verdict.q_grasp[0] = 9.0
