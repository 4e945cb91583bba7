"""Campaigns: equal bytes for any executor, after an interruption and a full disk; errors for folders of others."""

from __future__ import annotations

import json
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import CampaignError, FileError, InputError
from pinproof.picks.input.picks import PickProblem
from pinproof.work import JOURNAL, Journal


@pytest.fixture
def campaign(stick, many, judges) -> pp.Campaign:
    return pp.Campaign(stick, pp.Scene(), many, judge=judges.echo)


@pytest.fixture
def threads():
    with ThreadPoolExecutor(3) as executor:
        yield executor


def bytes_of(folder: Path) -> bytes:
    return (folder / "rows.jsonl").read_bytes()


def rows_in(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_bytes().splitlines()[1:]]


@pytest.mark.slow
def test_the_bytes_are_the_same_for_any_workers_and_chunks(campaign, threads, tmp_path) -> None:
    campaign.run(tmp_path / "1", workers=1)
    campaign.run(tmp_path / "2", workers=2, chunk=7)
    campaign.run(tmp_path / "3", executor=threads, chunk=1)
    assert len({bytes_of(tmp_path / name) for name in ("1", "2", "3")}) == 1
    rows = rows_in(tmp_path / "1" / "rows.jsonl")
    assert [row["index"] for row in rows] == [row["place"] for row in rows] == list(range(120))
    assert len({row["draw"] for row in rows}) == 120


def test_each_pick_has_the_stream_it_has_in_a_list(campaign, threads, tmp_path) -> None:
    result = campaign.run(tmp_path, executor=threads)
    streams = np.random.SeedSequence(0).spawn(120)
    assert [row["draw"] for row in result.rows()] == [np.random.default_rng(s).random() for s in streams]


def test_when_it_is_done_only_the_rows_and_the_times_are_left(campaign, threads, tmp_path) -> None:
    campaign.run(tmp_path, executor=threads, chunk=50)
    assert {path.name for path in tmp_path.iterdir()} == {"rows.jsonl", "timings.jsonl"}
    times = [json.loads(line) for line in (tmp_path / "timings.jsonl").read_text().splitlines()]
    assert sorted((time["start"], time["stop"]) for time in times) == [(0, 50), (50, 100), (100, 120)]
    assert b"seconds" not in bytes_of(tmp_path)


def test_judged_picks_are_not_judged_again(campaign, threads, tmp_path) -> None:
    first = campaign.run(tmp_path, executor=threads)
    again = campaign.run(tmp_path, executor=lambda: pytest.fail("a worker was asked for"))
    assert (first.resumed, again.resumed) == (0, 120)
    assert again.summary == first.summary == "120 of 120 picks good"


class Stop(Exception):
    pass


def stopped_after(campaign: pp.Campaign, folder: Path, executor: ThreadPoolExecutor, rows: int) -> None:
    def stop(done: int, total: int) -> None:
        if done >= rows:
            raise Stop

    with pytest.raises(Stop):
        campaign.run(folder, executor=executor, chunk=5, in_flight=4, progress=stop)


def test_an_interrupted_campaign_is_resumed(campaign, threads, tmp_path) -> None:
    campaign.run(tmp_path / "whole", executor=threads)
    stopped_after(campaign, tmp_path / "stopped", threads, 50)
    assert not (tmp_path / "stopped" / "rows.jsonl").exists()
    with Journal(tmp_path / "stopped", campaign.header()) as journal:
        there = len(list(journal.rows()))
    assert there >= 50
    assert campaign.run(tmp_path / "stopped", executor=threads).resumed == there
    assert bytes_of(tmp_path / "stopped") == bytes_of(tmp_path / "whole")


def test_ctrl_c_is_raised_with_the_number_of_judged_picks(campaign, threads, tmp_path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done >= 50:
            raise KeyboardInterrupt

    with pytest.raises(pp.errors.RunInterrupted, match=r"after 50 of 120 picks"):
        campaign.run(tmp_path, executor=threads, chunk=5, in_flight=1, progress=interrupt)
    assert campaign.run(tmp_path, executor=threads).resumed == 50


def journal_of(campaign: pp.Campaign, folder: Path, lines: list[bytes]) -> None:
    """A journal with rows as they are, whatever their checksums."""
    with Journal(folder, campaign.header()):
        pass
    with closing(sqlite3.connect(folder / JOURNAL)) as file, file:
        file.executemany("INSERT INTO rows VALUES ('', ?, ?)", list(enumerate(lines)))


def test_the_file_of_rows_is_written_from_a_complete_journal(campaign, threads, tmp_path) -> None:
    # Killed after the last row, while the rows were put in order.
    campaign.run(tmp_path / "whole", executor=threads)
    _, *rows = bytes_of(tmp_path / "whole").splitlines(keepends=True)
    journal_of(campaign, tmp_path / "late", rows)
    campaign.run(tmp_path / "late", executor=lambda: pytest.fail("a worker was asked for"))
    assert bytes_of(tmp_path / "late") == bytes_of(tmp_path / "whole")
    # Killed when both exist: the rows were written, and the journal was not yet removed.
    journal_of(campaign, tmp_path / "late", rows)
    campaign.run(tmp_path / "late", executor=lambda: pytest.fail("a worker was asked for"))
    assert bytes_of(tmp_path / "late") == bytes_of(tmp_path / "whole")
    assert not (tmp_path / "late" / JOURNAL).exists()


def test_another_campaign_in_the_folder_is_refused_with_the_difference(stick, many, judges, threads, tmp_path) -> None:
    def made(scene=(), picks=many, judge=judges.echo, **settings) -> pp.Campaign:
        return pp.Campaign(stick, pp.Scene(scene), picks, judge=judge, **settings)

    stopped_after(made(), tmp_path / "begun", threads, 10)
    made().run(tmp_path / "done", executor=threads)
    shifted = pp.picks.PickGrid(many.first, many.counts, (0.01, 0.02, 0.031))
    rock = pp.Obstacle("rock", pp.Sphere(0.1), pp.pose((3, 0, 0)))
    for folder in (tmp_path / "begun", tmp_path / "done"):
        before = {path: path.read_bytes() for path in folder.iterdir()}
        for other, named in (
            (made(rng=1), r"differs in seed \(0 there, 1 here\)\."),
            (made(scene=[rock]), r"scene \(0 obstacles \w+ there, 1 obstacles"),
            (made(picks=shifted), r"differs in picks \(120 picks \w+ there, 120 picks \w+ here\)\."),
            (made(home=[0.5]), r"differs in home \(\[0.0\] there, \[0.5\] here\)\."),
            (made(judge=judges.slow), r"differs in judge \(\S*echo \w+ there, \S*slow \w+ here\)\."),
        ):
            with pytest.raises(CampaignError, match=named):
                other.run(folder, executor=threads)
        assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_robot_with_other_limits_is_another_campaign(stick, many, judges, threads, tmp_path) -> None:
    pp.Campaign(stick, pp.Scene(), many, judge=judges.echo).run(tmp_path, executor=threads)
    limits = stick.limits
    faster = stick.with_limits(pp.JointLimits(limits.lower, limits.upper, limits.velocity * 2, limits.acceleration))
    with pytest.raises(CampaignError, match="differs in limits"):
        pp.Campaign(faster, pp.Scene(), many, judge=judges.echo).run(tmp_path, executor=threads)


@pytest.mark.parametrize("content", [b"", b"my own notes", b"my own notes\n", b'{"a": 1}\n', b"[1]\nx"])
def test_a_file_of_another_program_is_not_changed(campaign, threads, tmp_path, content: bytes) -> None:
    (tmp_path / JOURNAL).write_bytes(content)
    if content:
        with pytest.raises(CampaignError, match=r"journal\.sqlite: does not belong to a campaign"):
            campaign.run(tmp_path, executor=threads)
        assert (tmp_path / JOURNAL).read_bytes() == content
    else:
        assert campaign.run(tmp_path, executor=threads).ok


def test_a_database_of_another_program_is_not_changed(campaign, threads, tmp_path) -> None:
    with closing(sqlite3.connect(tmp_path / JOURNAL)) as file, file:
        file.execute("CREATE TABLE notes (line)")
    before = (tmp_path / JOURNAL).read_bytes()
    with pytest.raises(CampaignError, match="does not belong to a campaign"):
        campaign.run(tmp_path, executor=threads)
    assert (tmp_path / JOURNAL).read_bytes() == before


def damaged(header: bytes, rows: list[bytes], how: str) -> bytes:
    """A journal in which row 7 was damaged or edited by hand."""
    row = rows[7]
    rows[7] = {
        "text": b'"good"\n',
        "index alone": b'{"index": 7}\n',
        "boolean index": b'{"index": true}\n',
        "index out of range": b'{"index": 120}\n',
        "number": b"7\n",
        "zeros": b"\x00\x00\n",
        "another verdict": row.replace(b'"verdict":"good"', b'"verdict":"not found"'),
        "another index": row.replace(b'"index":7,', b'"index":8,'),
        "another figure": row.replace(b'"place":7', b'"place":70'),
        "no checksum": row[: row.index(b',"checksum"')] + b"}\n",
        "invalid UTF-8": row.replace(b"good", b"g\xff\xfed"),
        "spaces": row.replace(b",", b", "),
        "nested too deeply": b"[" * 100_000 + b"\n",
        "row twice": row + row,
        "row deleted": b"",
        "checksum of another row": row[: row.index(b',"checksum"')] + rows[8][rows[8].index(b',"checksum"') :],
    }[how]
    return header + b"".join(rows)


DAMAGE = (
    "text", "index alone", "boolean index", "index out of range", "number", "zeros", "another verdict", "another index",
    "another figure", "no checksum", "invalid UTF-8", "spaces", "nested too deeply", "row twice", "row deleted",
    "checksum of another row",
)  # fmt: skip


@pytest.mark.parametrize("how", [how for how in DAMAGE if "row " not in how])
def test_damaged_and_edited_rows_are_judged_again(campaign, threads, tmp_path, how: str) -> None:
    campaign.run(tmp_path / "whole", executor=threads)
    header, *rows = bytes_of(tmp_path / "whole").splitlines(keepends=True)
    rows = damaged(header, rows[:50], how).splitlines(keepends=True)[1:]
    journal_of(campaign, tmp_path / "edited", rows)
    result = campaign.run(tmp_path / "edited", executor=threads)
    assert (result.resumed, result.damaged) == (49, 1)
    assert bytes_of(tmp_path / "edited") == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("how", DAMAGE)
def test_a_finished_file_with_damaged_rows_is_refused_and_repaired_by_another_run(
    campaign, threads, tmp_path, how: str
) -> None:
    campaign.run(tmp_path, executor=threads)
    complete = bytes_of(tmp_path)
    header, *rows = complete.splitlines(keepends=True)
    (tmp_path / "rows.jsonl").write_bytes(damaged(header, rows, how))
    with pytest.raises(FileError, match=r"rows.jsonl.*run the campaign again"):
        pp.picks.CampaignResult.open(tmp_path)
    assert campaign.run(tmp_path, executor=threads).ok
    assert bytes_of(tmp_path) == complete
    assert not (tmp_path / JOURNAL).exists()


def test_a_row_of_another_campaign_is_judged_again(stick, many, judges, threads, tmp_path) -> None:
    made = pp.Campaign(stick, pp.Scene(), many, judge=judges.echo)
    made.run(tmp_path / "whole", executor=threads)
    pp.Campaign(stick, pp.Scene(), many, judge=judges.echo, rng=1).run(tmp_path / "other", executor=threads)
    _, *rows = bytes_of(tmp_path / "whole").splitlines(keepends=True)
    _, *others = bytes_of(tmp_path / "other").splitlines(keepends=True)
    journal_of(made, tmp_path / "mixed", [*rows[:7], others[7], *rows[8:]])
    assert made.run(tmp_path / "mixed", executor=threads).resumed == 119
    assert bytes_of(tmp_path / "mixed") == bytes_of(tmp_path / "whole")


def test_two_campaigns_cannot_write_to_one_folder(campaign, threads, tmp_path) -> None:
    with (
        Journal(tmp_path, campaign.header()),
        pytest.raises(FileError, match=r"journal\.sqlite: is in use by another process"),
    ):
        campaign.run(tmp_path, executor=threads)


def test_an_unreadable_row_is_a_row_of_the_result(stick, judges, threads, tmp_path) -> None:
    picks = pp.Picks((pp.Pick("a", pp.pose()),), (PickProblem(2, "b", "xyz is far"),))
    result = pp.Campaign(stick, pp.Scene(), picks, judge=judges.echo).run(tmp_path, executor=threads)
    assert list(result.rows())[1] == {
        "index": 1,
        "name": "b",
        "row": 2,
        "verdict": "unreadable",
        "failed_at": "input",
        "reason": "xyz is far",
    }
    assert not result.ok
    assert result.summary == "1 of 2 picks good; failed: 1 at input"


@pytest.mark.parametrize(("name", "text"), [("raises_on_7", "ZeroDivisionError: "), ("nan_on_7", "ValueError: ")])
def test_a_pick_on_which_the_judge_fails_is_a_row(stick, many, judges, threads, tmp_path, name: str, text: str) -> None:
    result = pp.Campaign(stick, pp.Scene(), many, judge=getattr(judges, name)).run(tmp_path, executor=threads)
    rows = list(result.rows())
    assert rows[7]["verdict"] == "crashed"
    assert rows[7]["reason"].startswith(f"the judge failed: {text}")
    assert [row["verdict"] for row in rows].count("good") == 119
    assert result.summary == "119 of 120 picks good; failed: 1 at no stage (crashed)"


def test_the_result_counts_verdicts_and_stages(stick, many, judges, threads, tmp_path) -> None:
    seen = []
    made = pp.Campaign(stick, pp.Scene(), many, judge=judges.no_to_thirds)
    result = made.run(tmp_path, executor=threads, chunk=60, progress=lambda *at: seen.append(at))
    assert seen == [(0, 120), (60, 120), (120, 120)]
    assert (result.verdicts, result.failed_at) == ({"not found": 40, "good": 80}, {"reach": 40})
    assert result.summary == "80 of 120 picks good; failed: 40 at reach"
    assert not result.ok
    assert pp.picks.CampaignResult.open(tmp_path) == result
    data = json.loads(json.dumps(result.to_dict()))
    assert (data["total"], data["ok"], data["failed_at"]) == (120, False, {"reach": 40})


def test_a_campaign_without_picks_is_not_ok(stick, judges, tmp_path) -> None:
    result = pp.Campaign(stick, pp.Scene(), pp.Picks(()), judge=judges.echo).run(tmp_path)
    assert (result.total, result.ok) == (0, False)


def test_a_folder_without_a_result_is_refused(tmp_path) -> None:
    with pytest.raises(CampaignError, match="no rows"):
        pp.picks.CampaignResult.open(tmp_path)
    (tmp_path / JOURNAL).touch()
    with pytest.raises(CampaignError, match="not finished; run it again"):
        pp.picks.CampaignResult.open(tmp_path)


def test_a_folder_that_cannot_be_made_is_one_clear_error(campaign, threads, tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match=r"file/deep: cannot be created: Not a directory"):
        campaign.run(tmp_path / "file" / "deep", executor=threads)


def test_a_full_disk_is_one_clear_error_and_what_was_done_is_kept(campaign, threads, tmp_path, monkeypatch) -> None:
    import resource

    campaign.run(tmp_path / "whole", executor=threads)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))  # no file may grow beyond that
        with pytest.raises(FileError, match=r"journal.sqlite: cannot be written: "):
            campaign.run(tmp_path / "full", executor=threads, chunk=5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert campaign.run(tmp_path / "full", executor=threads).resumed > 0
    assert bytes_of(tmp_path / "full") == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"workers": 0}, "workers must be"),
        ({"chunk": 0}, "chunk must be"),
        ({"in_flight": 0}, "in_flight must be"),
        ({"workers": 2, "executor": ThreadPoolExecutor}, "workers.*executor"),
    ],
)
def test_settings_that_make_no_sense_are_refused(campaign, tmp_path, settings, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        campaign.run(tmp_path, **settings)


def test_a_judge_that_cannot_be_sent_is_refused(stick, many, tmp_path) -> None:
    made = pp.Campaign(stick, pp.Scene(), many, judge=lambda setup, index, pick: {})
    with pytest.raises(InputError, match="importable by name"):
        made.run(tmp_path)
