"""Campaigns: equal bytes for any executor, after an interruption and a full disk; errors for folders of others."""

from __future__ import annotations

import json
import pickle
import resource
import shutil
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.common import content_hash
from pinproof.common.content_hash import describe_code
from pinproof.errors import CampaignError, FileError, InputError
from pinproof.picks.batch.campaign import RowTask, judge_row
from pinproof.picks.input.picks import PickProblem
from pinproof.work import JOURNAL, Journal

from ..pages import PROGRAM, ROOT, blocks, commands, reader_folder, run_command, run_program

PAGE = ROOT / "docs" / "campaigns.md"


@pytest.fixture(scope="module")
def threads():
    with ThreadPoolExecutor(3) as executor:
        yield executor


@pytest.fixture(scope="module")
def campaign_of(stick, many, judges) -> Callable[..., pp.Campaign]:
    def made(arm=stick, scene=(), picks=many, judge="echo", **settings) -> pp.Campaign:
        return pp.Campaign(arm, pp.Scene(scene), picks, judge=getattr(judges, judge), **settings)

    return made


@pytest.fixture(scope="module")
def campaign(campaign_of) -> pp.Campaign:
    return campaign_of()


@pytest.fixture(scope="module")
def whole(campaign, threads, tmp_path_factory) -> bytes:
    """The file of rows of the complete campaign."""
    return campaign.run(tmp_path_factory.mktemp("whole"), executor=threads).path.read_bytes()


def bytes_of(folder: Path) -> bytes:
    return (folder / "rows.jsonl").read_bytes()


def no_worker():
    pytest.fail("a worker was asked for")


@pytest.mark.slow
def test_the_bytes_are_the_same_for_any_workers_and_chunks(campaign, threads, whole, tmp_path) -> None:
    campaign.run(tmp_path / "1", workers=1)
    campaign.run(tmp_path / "2", workers=2, chunk=7)
    campaign.run(tmp_path / "3", executor=threads, chunk=1)
    assert {bytes_of(tmp_path / name) for name in ("1", "2", "3")} == {whole}
    rows = [json.loads(line) for line in whole.splitlines()[1:]]
    assert [row["index"] for row in rows] == [row["place"] for row in rows] == list(range(120))
    # Each pick has the stream that it has in a list
    streams = np.random.SeedSequence(0).spawn(120)
    assert [row["draw"] for row in rows] == [np.random.default_rng(stream).random() for stream in streams]


def test_when_it_is_done_only_the_rows_and_the_times_are_left_and_nothing_is_judged_again(
    campaign, threads, tmp_path
) -> None:
    first = campaign.run(tmp_path, executor=threads, chunk=50)
    assert {path.name for path in tmp_path.iterdir()} == {"rows.jsonl", "timings.jsonl"}
    times = [json.loads(line) for line in (tmp_path / "timings.jsonl").read_text().splitlines()]
    assert sorted((time["start"], time["stop"]) for time in times) == [(0, 50), (50, 100), (100, 120)]
    assert b"seconds" not in bytes_of(tmp_path)
    again = campaign.run(tmp_path, executor=no_worker)
    assert (first.resumed, again.resumed) == (0, 120)
    assert again.summary == first.summary == "120 of 120 picks good"


class Stop(Exception):
    pass


def stopped(campaign: pp.Campaign, folder: Path, threads: ThreadPoolExecutor, rows: int, error: type, **more) -> str:
    """Run a campaign until an error is raised after some rows: its text."""

    def stop(done: int, total: int) -> None:
        if done >= rows:
            raise error

    expected = pp.errors.RunInterrupted if error is KeyboardInterrupt else error
    with pytest.raises(expected) as raised:
        campaign.run(folder, executor=threads, chunk=5, progress=stop, **more)
    return str(raised.value)


def test_an_interrupted_campaign_is_resumed(campaign, threads, whole, tmp_path) -> None:
    stopped(campaign, tmp_path / "stopped", threads, 50, Stop, in_flight=4)
    assert not (tmp_path / "stopped" / "rows.jsonl").exists()
    with Journal(tmp_path / "stopped", campaign.header()) as journal:
        there = len(list(journal.rows()))
    assert there >= 50
    assert campaign.run(tmp_path / "stopped", executor=threads).resumed == there
    assert bytes_of(tmp_path / "stopped") == whole
    # Ctrl-C is raised with the number of judged picks
    assert "after 50 of 120 picks" in stopped(campaign, tmp_path / "ctrl", threads, 50, KeyboardInterrupt, in_flight=1)
    assert campaign.run(tmp_path / "ctrl", executor=threads).resumed == 50


def journal_of(campaign: pp.Campaign, folder: Path, lines: list[bytes]) -> None:
    """A journal with rows as they are, whatever their checksums."""
    with Journal(folder, campaign.header()):
        pass
    with closing(sqlite3.connect(folder / JOURNAL)) as file, file:
        file.executemany("INSERT INTO rows VALUES ('', ?, ?)", list(enumerate(lines)))


def test_the_file_of_rows_is_written_from_a_complete_journal(campaign, whole, tmp_path) -> None:
    # Killed after the last row, while the rows were put in order; then when both exist, before the journal was removed
    for _ in range(2):
        journal_of(campaign, tmp_path, whole.splitlines(keepends=True)[1:])
        campaign.run(tmp_path, executor=no_worker)
        assert bytes_of(tmp_path) == whole
    assert not (tmp_path / JOURNAL).exists()


def test_another_campaign_in_the_folder_is_refused_with_the_difference(
    campaign_of, stick, many, threads, whole, tmp_path, monkeypatch
) -> None:
    stopped(campaign_of(), tmp_path / "begun", threads, 10, Stop)
    (tmp_path / "done").mkdir()
    (tmp_path / "done" / "rows.jsonl").write_bytes(whole)
    shifted = pp.picks.PickGrid(many.first, many.counts, (0.01, 0.02, 0.031))
    rock = pp.Obstacle("rock", pp.Sphere(0.1), pp.pose((3, 0, 0)))
    limits = stick.limits
    faster = stick.with_limits(pp.JointLimits(limits.lower, limits.upper, limits.velocity * 2, limits.acceleration))
    for folder in (tmp_path / "begun", tmp_path / "done"):
        before = {path: path.read_bytes() for path in folder.iterdir()}
        for other, named in (
            ({"rng": 1}, r"differs in seed \(0 there, 1 here\)\."),
            ({"scene": [rock]}, r"scene \(0 obstacles \w+ there, 1 obstacles"),
            ({"picks": shifted}, r"differs in picks \(120 picks \w+ there, 120 picks \w+ here\)\."),
            ({"home": [0.5]}, r"differs in home \(\[0.0\] there, \[0.5\] here\)\."),
            ({"judge": "slow"}, r"differs in judge \(\S*echo \w+ there, \S*slow \w+ here\)\."),
            ({"arm": faster}, "differs in limits"),
        ):
            with pytest.raises(CampaignError, match=named):
                campaign_of(**other).run(folder, executor=threads)
        with monkeypatch.context() as patch:
            patch.setattr("pinproof.picks.batch.campaign.code_here", lambda: "0.1.0 otherwise")
            with pytest.raises(CampaignError, match=r"differs in pinproof \(0.1.0 .* there, 0.1.0 otherwise here\)"):
                campaign_of().run(folder, executor=threads)
        assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_file_of_another_program_is_not_changed(campaign, threads, tmp_path) -> None:
    journal = tmp_path / JOURNAL
    with closing(sqlite3.connect(journal)) as file, file:
        file.execute("CREATE TABLE notes (line)")
    for content in (journal.read_bytes(), b"my own notes", b"my own notes\n", b'{"a": 1}\n', b"[1]\nx"):
        journal.write_bytes(content)
        with pytest.raises(CampaignError, match=r"journal\.sqlite: does not belong to a campaign"):
            campaign.run(tmp_path, executor=threads)
        assert journal.read_bytes() == content
    journal.write_bytes(b"")
    assert campaign.run(tmp_path, executor=threads).ok


DAMAGE: dict[str, Callable[[bytes, bytes], bytes]] = {
    "text": lambda row, _: b'"good"\n',
    "index alone": lambda row, _: b'{"index": 7}\n',
    "boolean index": lambda row, _: b'{"index": true}\n',
    "index out of range": lambda row, _: b'{"index": 120}\n',
    "number": lambda row, _: b"7\n",
    "zeros": lambda row, _: b"\x00\x00\n",
    "another verdict": lambda row, _: row.replace(b'"verdict":"good"', b'"verdict":"not found"'),
    "another index": lambda row, _: row.replace(b'"index":7,', b'"index":8,'),
    "another figure": lambda row, _: row.replace(b'"place":7', b'"place":70'),
    "no checksum": lambda row, _: row[: row.index(b',"checksum"')] + b"}\n",
    "invalid UTF-8": lambda row, _: row.replace(b"good", b"g\xff\xfed"),
    "spaces": lambda row, _: row.replace(b",", b", "),
    "nested too deeply": lambda row, _: b"[" * 100_000 + b"\n",
    "row twice": lambda row, _: row + row,
    "row deleted": lambda row, _: b"",
    "checksum of another row": lambda row, other: row.partition(b',"checksum"')[0] + other[other.index(b',"checks') :],
}
"""What becomes of row 7, given the next one too."""


@pytest.mark.parametrize("how", DAMAGE)
def test_damaged_and_edited_rows_are_refused_and_judged_again(campaign, threads, whole, tmp_path, how: str) -> None:
    header, *rows = whole.splitlines(keepends=True)
    rows[7] = DAMAGE[how](rows[7], rows[8])
    (tmp_path / "rows.jsonl").write_bytes(header + b"".join(rows))
    with pytest.raises(FileError, match=r"rows.jsonl.*run the campaign again"):
        pp.picks.CampaignResult.open(tmp_path)
    assert campaign.run(tmp_path, executor=threads).ok
    assert bytes_of(tmp_path) == whole
    assert not (tmp_path / JOURNAL).exists()
    if "row " not in how:  # also in the journal of an unfinished campaign
        journal_of(campaign, tmp_path / "edited", rows[:50])
        result = campaign.run(tmp_path / "edited", executor=threads)
        assert (result.resumed, result.damaged) == (49, 1)
        assert bytes_of(tmp_path / "edited") == whole


def test_a_row_of_another_campaign_is_judged_again(campaign, campaign_of, threads, whole, tmp_path) -> None:
    campaign_of(rng=1).run(tmp_path / "other", executor=threads)
    (_, *rows), (_, *others) = (each.splitlines(keepends=True) for each in (whole, bytes_of(tmp_path / "other")))
    journal_of(campaign, tmp_path / "mixed", [*rows[:7], others[7], *rows[8:]])
    assert campaign.run(tmp_path / "mixed", executor=threads).resumed == 119
    assert bytes_of(tmp_path / "mixed") == whole


def test_two_campaigns_cannot_write_to_one_folder(campaign, threads, tmp_path) -> None:
    with (
        Journal(tmp_path, campaign.header()),
        pytest.raises(FileError, match=r"journal\.sqlite: is in use by another process"),
    ):
        campaign.run(tmp_path, executor=threads)


def test_a_full_disk_is_one_clear_error_and_what_was_done_is_kept(campaign, threads, whole, tmp_path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))  # no file may grow beyond that
        with pytest.raises(FileError, match=r"journal.sqlite: cannot be written: "):
            campaign.run(tmp_path, executor=threads, chunk=5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert campaign.run(tmp_path, executor=threads).resumed > 0
    assert bytes_of(tmp_path) == whole


# -- results and refusals ---------------------------------------------------------------------------------------------


def test_the_result_counts_verdicts_and_stages(campaign_of, threads, tmp_path) -> None:
    seen = []
    made = campaign_of(judge="no_to_thirds")
    result = made.run(tmp_path, executor=threads, chunk=60, progress=lambda *at: seen.append(at))
    assert seen == [(0, 120), (60, 120), (120, 120)]
    assert (result.verdicts, result.failed_at) == ({"not found": 40, "good": 80}, {"reach": 40})
    assert result.summary == "80 of 120 picks good; failed: 40 at reach"
    assert not result.ok
    assert pp.picks.CampaignResult.open(tmp_path) == result
    data = json.loads(json.dumps(result.to_dict()))
    assert (data["total"], data["ok"], data["failed_at"]) == (120, False, {"reach": 40})
    empty = campaign_of(picks=pp.Picks(())).run(tmp_path / "none")
    assert (empty.total, empty.ok) == (0, False)


def test_an_unreadable_row_is_a_row_of_the_result(campaign_of, threads, tmp_path) -> None:
    picks = pp.Picks((pp.Pick("a", pp.pose()),), (PickProblem(2, "b", "xyz is far"),))
    result = campaign_of(picks=picks).run(tmp_path, executor=threads)
    row = {"index": 1, "name": "b", "row": 2, "verdict": "unreadable", "failed_at": "input", "reason": "xyz is far"}
    assert list(result.rows())[1] == row
    assert (result.ok, result.summary) == (False, "1 of 2 picks good; failed: 1 at input")


@pytest.mark.parametrize(("name", "text"), [("raises_on_7", "ZeroDivisionError: "), ("nan_on_7", "ValueError: ")])
def test_a_pick_on_which_the_judge_fails_is_a_row(campaign_of, threads, tmp_path, name: str, text: str) -> None:
    result = campaign_of(judge=name).run(tmp_path, executor=threads)
    rows = list(result.rows())
    assert rows[7]["verdict"] == "crashed"
    assert rows[7]["reason"].startswith(f"the judge failed: {text}")
    assert [row["verdict"] for row in rows].count("good") == 119
    assert result.summary == "119 of 120 picks good; failed: 1 at no stage (crashed)"


def test_folders_and_settings_that_cannot_be_used_are_refused(campaign, campaign_of, stick, many, tmp_path) -> None:
    with pytest.raises(CampaignError, match="no rows"):
        pp.picks.CampaignResult.open(tmp_path)
    (tmp_path / JOURNAL).touch()
    with pytest.raises(CampaignError, match="not finished; run it again"):
        pp.picks.CampaignResult.open(tmp_path)
    with pytest.raises(FileError, match=r"deep: cannot be created: Not a directory"):
        campaign.run(tmp_path / JOURNAL / "deep", workers=1)
    for settings, named in (
        ({"workers": 0}, "workers must be"),
        ({"chunk": 0}, "chunk must be"),
        ({"in_flight": 0}, "in_flight must be"),
        ({"workers": 2, "executor": ThreadPoolExecutor}, "workers.*executor"),
    ):
        with pytest.raises(InputError, match=named):
            campaign.run(tmp_path / "out", **settings)
    made = pp.Campaign(stick, pp.Scene(), many, judge=lambda setup, index, pick: {})
    with pytest.raises(InputError, match="importable by name"):
        made.run(tmp_path / "local")


# -- all rows of a file come from the same code -----------------------------------------------------------------------


def test_any_change_of_the_judging_code_changes_its_version_and_that_of_help_texts_does_not(
    tmp_path, monkeypatch
) -> None:
    def version() -> str:
        content_hash.code_here.cache_clear()
        return content_hash.code_here()

    original, package = version(), tmp_path / "pinproof"
    assert original.startswith(f"{pp.__version__} ")
    assert "numpy " in original
    assert "unknown" not in original
    shutil.copytree(content_hash.PACKAGE, package, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    monkeypatch.setattr(content_hash, "PACKAGE", package)
    try:
        seen = [version()]
        assert seen == [original]
        for name in ("collision/certificates/certify.py", "picks/new.py", "cli/pick.py"):
            with (package / name).open("a") as file:
                file.write("\n# changed\n")
            seen.append(version())
        assert len(set(seen)) == 3
        assert seen[-1] == seen[-2]
    finally:
        monkeypatch.undo()
        content_hash.code_here.cache_clear()


def test_a_worker_with_other_code_refuses_the_task(stick, many, monkeypatch) -> None:
    setup = pp.picks.PickSetup.make(stick, pp.Scene(), many.shared, home=None, rng=0)
    package = pickle.dumps(RowTask(setup, judge_row))
    assert isinstance(pickle.loads(package), RowTask)
    monkeypatch.setattr("pinproof.picks.batch.campaign.code_here", lambda: "0.1.0 otherwise")
    mismatch = rf"a worker runs pinproof 0\.1\.0 otherwise, the campaign runs {pp.__version__} "
    with pytest.raises(CampaignError, match=mismatch):
        pickle.loads(package)


def test_a_custom_judge_is_identified_by_its_source(judges) -> None:
    assert describe_code(judge_row) == "pinproof.picks.batch.campaign.judge_row"
    echo, slow = describe_code(judges.echo), describe_code(judges.slow)
    assert echo.startswith("campaign_judges.echo ")
    assert echo.split()[1] != slow.split()[1]


# -- docs/campaigns.md ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_runs_as_printed(tmp_path) -> None:
    (program,) = blocks(PAGE, "python")
    assert PROGRAM in program.text
    with reader_folder(tmp_path):
        printed = run_program(program.text, "campaigns.md")
        assert printed == "4 of 4 picks good\n['pin_0_0_0', 'pin_0_1_0', 'pin_1_0_0', 'pin_1_1_0']\n"
        assert pp.picks.CampaignResult.open("pins").ok
        for words, _ in (each for block in blocks(PAGE, "sh") for each in commands(block)):
            if "--dask" not in words:  # there is no cluster here; test_dask.py has one
                # Two of the four picks are not good, and are meant not to be.
                assert "2 of 4 picks good" in run_command(words, 1, "campaigns.md")


def test_the_shared_part_of_a_table_is_a_picks_file(tmp_path) -> None:
    (block,) = blocks(PAGE, "yaml")
    (tmp_path / "picks.yaml").write_text(block.text)
    (tmp_path / "many.csv").write_text("name,x,y,z\nbolt,0.46,0.15,0.035\n")
    assert pp.picks.open_picks(tmp_path / "picks.yaml").shared.robot == "ur5"
    assert [pick.name for pick in pp.read_picks(tmp_path / "picks.yaml")] == ["bolt"]
