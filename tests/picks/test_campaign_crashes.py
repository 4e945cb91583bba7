"""Workers that die because of a pick or for another reason; campaigns that are killed."""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import pytest

import pinproof as pp
from pinproof.errors import CampaignError
from pinproof.picks.batch.campaign import KILLED
from pinproof.work import JOURNAL, Journal, executors, to_line

from ..processes import PATIENCE, WRITTEN, is_alive, started, wait_for


class Fragile(Executor):
    """One thread that works through what is handed to it; where that ends it, all that was handed to it fails.

    So it breaks as a pool of processes does, but at once, and with several chunks under suspicion.
    """

    made = 0

    def __init__(self) -> None:
        type(self).made += 1
        self._queue: queue.SimpleQueue = queue.SimpleQueue()
        self._broken = False
        threading.Thread(target=self._run, daemon=True).start()

    def submit(self, fn, /, *args, **settings) -> Future:
        if self._broken:
            raise BrokenExecutor("it broke before")
        future: Future = Future()
        self._queue.put((future, fn, args))
        return future

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            future, fn, args = job
            try:
                future.set_result(fn(*args))
            except Exception as error:  # noqa: BLE001  # as a pool does
                future.set_exception(error)
            except BaseException:  # noqa: BLE001
                self._broken = True
                time.sleep(0.02)  # more is handed over meanwhile
                failed = [future]
                while not self._queue.empty():
                    failed.append(self._queue.get()[0])
                for each in failed:
                    each.set_exception(BrokenExecutor("a worker died"))
                return

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._queue.put(None)


@pytest.fixture
def campaign(stick, many, judges, flag) -> Callable[..., pp.Campaign]:
    """Campaigns of 120 picks by the name of their judge; no executor was made yet."""
    Fragile.made = 0

    def made(judge: str, counts: tuple[int, int, int] = many.counts) -> pp.Campaign:
        return pp.Campaign(stick, pp.Scene(), replace(many, counts=counts), judge=getattr(judges, judge))

    return made


def crashed(result: pp.picks.CampaignResult) -> list[int]:
    rows = list(result.rows())
    assert [row["index"] for row in rows] == list(range(120))
    assert all(row["verdict"] == "good" for row in rows if row["verdict"] != "crashed")
    return [row["index"] for row in rows if row["verdict"] == "crashed"]


def rows_there(folder, made) -> list[int]:
    with Journal(folder, made.header()) as journal:
        return [index for index, _ in journal.rows()]


@pytest.mark.parametrize(("chunk", "in_flight"), [(1, 1), (1, 16), (8, 1), (8, 16), (120, 3), (None, 8)])
def test_only_the_faulty_picks_are_marked_as_crashed(campaign, tmp_path, chunk, in_flight) -> None:
    result = campaign("ends_on_7_and_100").run(tmp_path, executor=Fragile, chunk=chunk, in_flight=in_flight)
    assert crashed(result) == [7, 100]
    reasons = {row["reason"] for row in result.rows() if row["verdict"] == "crashed"}
    assert reasons == {KILLED}
    assert Fragile.made > 6  # each has killed three when it was alone


@pytest.mark.parametrize("in_flight", [1, 8])
def test_a_pick_whose_workers_were_killed_from_outside_is_tried_again_on_resume(
    campaign, flag, tmp_path, in_flight
) -> None:
    made = campaign("ends_six_times_on_7")
    how = {"executor": Fragile, "chunk": 2, "in_flight": in_flight}
    first = made.run(tmp_path / "out", **how)
    if in_flight == 1:
        assert crashed(first) == [7]
    while flag.stat().st_size < 6:
        first = made.run(tmp_path / "out", **how)
    again = made.run(tmp_path / "out", **how)
    assert crashed(again) == []
    assert again.resumed >= 119
    made.run(tmp_path / "whole", **how)
    assert (tmp_path / "out" / "rows.jsonl").read_bytes() == (tmp_path / "whole" / "rows.jsonl").read_bytes()


def test_a_pick_that_ran_out_of_memory_is_tried_again_on_resume(campaign, tmp_path) -> None:
    made = campaign("memory_error_on_7")
    assert crashed(made.run(tmp_path / "out", executor=Fragile)) == [7]
    assert crashed(made.run(tmp_path / "out", executor=Fragile)) == []


def test_a_pick_that_kills_workers_each_time_is_tried_once_a_run_with_the_same_bytes(campaign, tmp_path) -> None:
    made = campaign("ends_on_7_and_100")
    made.run(tmp_path, executor=Fragile)
    rows = (tmp_path / "rows.jsonl").read_bytes()
    again = made.run(tmp_path, executor=Fragile)
    assert crashed(again) == [7, 100]
    assert again.resumed == 118
    assert (tmp_path / "rows.jsonl").read_bytes() == rows


def test_a_crashed_row_in_a_journal_is_replaced_by_a_later_run(campaign, tmp_path) -> None:
    made = campaign("ends_six_times_on_7")
    made.run(tmp_path, executor=Fragile, chunk=2, in_flight=1)
    rows = list(pp.picks.CampaignResult.open(tmp_path).rows())
    (tmp_path / "rows.jsonl").unlink()
    with Journal(tmp_path, made.header()) as journal:
        journal.append(0, [to_line(row) for row in rows])
        assert rows[7]["retry"]
    again = made.run(tmp_path, executor=Fragile)
    assert crashed(again) == []
    assert again.resumed == 119


def test_no_pick_is_blamed_for_an_executor_that_breaks_of_itself(campaign, tmp_path) -> None:
    class Tired(Fragile):
        """Breaks after nine chunks."""

        left = 9

        def submit(self, fn, /, *args, **settings):
            if args[-1] is not None:
                self.left -= 1
            return super().submit(_end if self.left < 0 else fn, *args)

    made = campaign("echo")
    assert crashed(made.run(tmp_path, executor=Tired, chunk=1, in_flight=4)) == []
    assert Tired.made > 5


def _end(*args) -> None:
    raise KeyboardInterrupt


def test_an_executor_that_cannot_be_replaced_ends_the_run_and_another_resumes(campaign, tmp_path) -> None:
    made = campaign("ends_on_7_and_100")
    with pytest.raises(CampaignError, match=r"executor broke \(BrokenExecutor: .*pass a function that creates"):
        made.run(tmp_path, executor=Fragile(), chunk=5, in_flight=1)
    result = made.run(tmp_path, executor=Fragile, chunk=5)
    assert crashed(result) == [7, 100]
    assert result.resumed == 5


def test_workers_that_never_start_are_an_error_and_no_pick_is_blamed(campaign, tmp_path) -> None:
    class Dead(Fragile):
        def submit(self, fn, /, *args, **settings):
            return super().submit(_end)

    made = campaign("echo")
    with pytest.raises(CampaignError, match=r"no worker starts .* if __name__ == '__main__'"):
        made.run(tmp_path, executor=Dead)
    assert Dead.made == 3
    assert rows_there(tmp_path, made) == []


@pytest.mark.slow
def test_workers_that_always_die_are_an_error_and_no_pick_is_blamed(campaign, tmp_path) -> None:
    made = campaign("ends_always")
    with pytest.raises(CampaignError, match=r"every worker process died on each of the first 10 picks.* enough memory"):
        made.run(tmp_path, executor=Fragile)
    assert rows_there(tmp_path, made) == []
    few = campaign("ends_always", (3, 1, 1))
    assert few.run(tmp_path / "few", executor=Fragile).verdicts == {"crashed": 3}


def test_a_task_that_workers_cannot_load_is_an_error(campaign, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(executors, "_known", {})

    class Foreign(Fragile):
        def submit(self, fn, /, key, package, start, part):
            return super().submit(fn, key, package and package[:50], start, part)

    made = campaign("echo")
    with pytest.raises(CampaignError, match="the workers cannot load the task: UnpicklingError: "):
        made.run(tmp_path, executor=Foreign)


def test_workers_that_join_receive_the_task_once(campaign, tmp_path, monkeypatch) -> None:
    class Joined(Fragile):
        """Chunks without the task reach workers that do not know it, until every worker has received it."""

        def submit(self, fn, /, *args, **settings):
            packed.append(args[1] is not None)
            new = 2 <= len(packed) < 12 and not packed[-1]
            return super().submit(_as_stranger if new else fn, *args)

    packed: list[bool] = []
    made = campaign("echo")
    assert crashed(made.run(tmp_path, executor=Joined, chunk=4, in_flight=10)) == []
    assert sum(packed) == 2  # the first of all, and the first that the stranger returned


def _as_stranger(*args):
    return executors.Answer(known=False, worker="stranger:1")


@pytest.mark.slow
def test_a_process_that_a_pick_kills(campaign, flag, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(executors, "MAX_DEATHS", 2)
    made = campaign("dies_on_7")
    assert crashed(made.run(tmp_path / "out", workers=1, chunk=2)) == [7]
    assert len(flag.read_text()) == 4  # twice with its neighbour, twice alone


@pytest.mark.slow
def test_a_process_that_dies_once_costs_nothing(campaign, flag, tmp_path) -> None:
    made = campaign("dies_once_on_7")
    assert crashed(made.run(tmp_path / "out", workers=1, chunk=10)) == []
    assert flag.exists()


RUN = """
import sys, campaign_judges, pinproof as pp
from pinproof.model import load_robot
if __name__ == "__main__":
    arm = load_robot(sys.argv[2]).arm(tcp="b")
    many = pp.picks.PickGrid(pp.Pick("p", pp.pose(xyz=(0.1, 0.2, 0.3))), (4, 5, 6), (0.01, 0.02, 0.03))
    pp.Campaign(arm, pp.Scene(), many, judge=campaign_judges.waits_for_flag).run(sys.argv[1], workers=2, chunk=4)
"""


@pytest.mark.slow
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_campaign_leaves_no_process_and_resumes_with_the_same_bytes(
    campaign, stick_urdf, flag, tmp_path, by
) -> None:
    folder, program = tmp_path / "out", tmp_path / "program.py"
    program.write_text(RUN)
    # A session of its own: Ctrl-C goes to all processes of it.
    with started([sys.executable, str(program), str(folder), stick_urdf]) as running:
        log = folder / f"{JOURNAL}-wal"
        wait_for(lambda: log.exists() and log.stat().st_size > WRITTEN, by=running)
        os.killpg(running.pid, by) if by == signal.SIGINT else running.kill()
        assert running.communicate(timeout=PATIENCE)[1].count("Traceback") <= 1  # of the program, not of its workers
        assert running.returncode != 0
    made = campaign("waits_for_flag")
    with Journal(folder, made.header()) as journal:
        there = len(list(journal.rows()))
        workers = {int(time["worker"].rpartition(":")[2]) for time in journal.timings()}
    assert 4 <= there < 120
    assert os.getpid() not in workers
    wait_for(lambda: not any(map(is_alive, workers)))  # by themselves: nothing has ended them yet

    flag.touch()
    with ThreadPoolExecutor(3) as threads:
        assert made.run(folder, executor=threads).resumed == there
        made.run(tmp_path / "whole", executor=threads)
    assert (folder / "rows.jsonl").read_bytes() == (tmp_path / "whole" / "rows.jsonl").read_bytes()


@pytest.mark.slow
def test_a_broken_pool_of_processes_is_replaced(campaign, flag, tmp_path) -> None:
    def pool() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, mp_context=get_context("spawn"))

    made = campaign("dies_once_on_7")
    assert crashed(made.run(tmp_path / "out", executor=pool, chunk=4, in_flight=4)) == []
    assert flag.exists()
