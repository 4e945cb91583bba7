"""Put deliberate mistakes into sources, one at a time, and report those that no test notices.

Called by scripts/test --mutants FILE... A sample of the mistakes in each file is drawn. For each mistake, a process is
forked that has imported the libraries but nothing of this project; it loads the changed source and runs the tests that
reach the changed lines, those of the file's own package first, until one fails. Mistakes in C++ files are compiled
together into a copy of the core, and switched on one at a time.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import difflib
import hashlib
import importlib
import importlib.machinery
import json
import os
import random
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import mutants_cpp
import mutants_python
import yaml

FOLDERS = "core collision verifier motion planning execution ik picks"
"""The folders of tests that are run besides that of the file's own package."""
COLUMNS = ("noticed", "stopped", "survived", "accepted")
FAILED = 70
"""Exit status of a process in which this script failed."""
MOST_MEMORY = 8 * 1024**3
"""Limit of the address space of a run [bytes]: a mistake may make a list grow without end."""
LARGEST_BASELINE = 900
"""Limit of the CPU time of one file of tests without mistakes [s]."""


@dataclass
class Mutant:
    """One mistake: in Python a changed source, in C++ the number of a switch."""

    file: Path
    line: int
    last_line: int
    diff: str
    changed: bytes = b""
    switch: int = 0
    tests: list[str] = field(default_factory=list)
    seconds: float = 0.0
    left_out: int = 0

    @property
    def key(self) -> str:
        """The removed and added lines, which stay the same when the file changes elsewhere."""
        return essence(self.diff.splitlines()[2:])


def essence(diff: Iterable[str]) -> str:
    """The removed and added lines of a difference, without indentation."""
    return "\n".join(f"{line[0]} {line[1:].strip()}" for line in diff if line[:1] in ("+", "-"))


# Processes.


def fork(task: Callable[[], int], log: Path, seconds: float) -> int:
    """Start a task in a process of its own with a limit of CPU time."""
    sys.stdout.flush()
    if pid := os.fork():
        return pid
    status = FAILED
    try:
        os.setsid()
        output = os.open(log, os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
        os.dup2(output, 1)
        os.dup2(output, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 10))
        status = task()
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
    finally:
        os._exit(status)


def run_all(
    tasks: Iterable[tuple[Any, Callable[[], int], float]], workers: int, log: Path
) -> Iterator[tuple[Any, int, float]]:
    """Run tasks in processes; yields the name of each, its status (or minus a signal) and its CPU time [s]."""
    running: dict[int, tuple[Any, float, Path]] = {}
    waiting = enumerate(tasks)
    more = True
    try:
        while more or running:
            while more and len(running) < workers:
                if (entry := next(waiting, None)) is None:
                    more = False
                    break
                k, (name, task, seconds) = entry
                output = log.with_suffix(f".{k}.log")
                running[fork(task, output, seconds)] = (name, time.monotonic() + 20 * seconds, output)
            for pid, (name, deadline, output) in list(running.items()):
                done, status, usage = os.wait4(pid, os.WNOHANG)
                if done:
                    del running[pid]
                    kill(pid)
                    if os.waitstatus_to_exitcode(status) != FAILED:
                        output.unlink()
                    yield name, os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime
                elif time.monotonic() > deadline:
                    kill(pid)
            time.sleep(0.01)
    finally:
        for pid in running:
            kill(pid)


def kill(group: int) -> None:
    """End a task and the processes that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def run_pytest(arguments: list[str], plugin: object) -> int:
    """Run pytest in this process, with the same random examples every time, and failures that are not made smaller."""
    import pytest
    from hypothesis import Phase, settings

    class Examples:
        @staticmethod
        @pytest.hookimpl(trylast=True)
        def pytest_configure() -> None:
            phases = (Phase.explicit, Phase.generate)
            settings.register_profile("mutants", settings.default, derandomize=True, database=None, phases=phases)
            settings.load_profile("mutants")

    options = ["-q", "--tb=line", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
    return int(pytest.main([*options, *arguments], plugins=[plugin, Examples()]))


# What each test reaches.


@dataclass
class Baseline:
    """The run of one file of tests without a mistake: CPU time of each test that passes, and what it reaches."""

    module: str
    store: Path
    seconds: dict[str, float]
    sources: dict[str, str]
    libraries: list[str]
    switches: dict[str, list[int]]

    @classmethod
    def read(cls, store: Path, module: str, text: str, sources: Iterable[Path]) -> Baseline | None:
        """The stored run, if neither the tests nor those of the sources changed that they reach."""
        try:
            values = json.loads(store.with_suffix(".json").read_text())
        except (OSError, ValueError):
            return None
        if values.pop("text") != text:
            return None
        baseline = cls(module, store, **values)
        current = all(baseline.sources.get(str(each), digest(each)) == digest(each) for each in sources)
        return baseline if current else None

    def tests_of_lines(self, file: Path, first: int, last: int) -> list[str]:
        """The tests that run one of the lines; all that run any line of the file, if the lines run at its import."""
        import coverage

        if str(file) not in self.sources:
            return []
        data = coverage.CoverageData(str(self.store))
        data.read()
        contexts = data.contexts_by_lineno(str(file))
        found = {name for line in range(first, last + 1) for name in contexts.get(line, ())}
        if "setup" in found:
            return list(self.seconds)
        if not found - {""} and "" in found:
            found = {name for names in contexts.values() for name in names}
        return [name for name in found if name in self.seconds]

    def tests_of_switch(self, number: int) -> list[str]:
        """The tests that reach a mistake in C++."""
        reached = [name for name, numbers in self.switches.items() if number in numbers]
        return list(self.seconds) if "setup" in reached else reached


def is_own(module: object, root: Path) -> bool:
    """Whether a module belongs to the project, or has no file."""
    file = getattr(module, "__file__", None)
    return file is None or (Path(file).is_relative_to(root) and "site-packages" not in Path(file).parts)


def digest(*files: Path) -> str:
    """The hash of files."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def digest_of_tests(file: Path) -> str:
    """The hash of a file of tests and of what it shares with the others in its folder."""
    shared = [each for each in file.parent.glob("*.py") if not each.name.startswith("test_")]
    return digest(file, *sorted(shared))


def measure(root: Path, source: Path, module: str, store: Path, options: list[str], text: str, compiled: bool) -> int:
    """Run one file of tests and store what each test reaches."""
    import coverage
    import pytest

    switches = None
    if compiled:
        library = next((source / "pinproof").glob("_core.*.so"))
        import pinproof._core  # noqa: F401

        switches = (ctypes.c_ubyte * 4096).in_dll(ctypes.CDLL(str(library)), "pinproof_reached")
    store.parent.mkdir(parents=True, exist_ok=True)
    store.unlink(missing_ok=True)
    cover = (
        coverage.Coverage(data_file=str(store), include=[f"{source}/*"], config_file=False) if not compiled else None
    )
    seconds: dict[str, float] = {}
    failed: set[str] = set()
    reached: dict[str, set[int]] = defaultdict(set)

    def enter(context: str, previous: str) -> None:
        if cover:
            cover.switch_context(context)
        elif switches is not None:
            reached[previous] |= {i for i, value in enumerate(bytes(switches)) if value}
            ctypes.memset(switches, 0, len(switches))

    class Plugin:
        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
            before = time.process_time()
            result = yield
            seconds[item.nodeid] = time.process_time() - before
            return result

        @pytest.hookimpl(tryfirst=True)
        def pytest_runtest_setup(self) -> None:
            enter("setup", "")

        @pytest.hookimpl(tryfirst=True)
        def pytest_runtest_call(self, item: pytest.Item) -> None:
            enter(item.nodeid, "setup")

        @pytest.hookimpl(tryfirst=True)
        def pytest_runtest_teardown(self, item: pytest.Item) -> None:
            enter("", item.nodeid)

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if not report.passed:
                failed.add(report.nodeid)

    if cover:
        cover.start()
    status = run_pytest([module, *options], Plugin())
    measured: dict[str, str] = {}
    if cover:
        cover.stop()
        cover.save()
        measured = {file: digest(Path(file)) for file in cover.get_data().measured_files()}
    libraries = [name for name, module in sys.modules.items() if not is_own(module, root) and "conftest" not in name]
    values = {
        "text": digest_of_tests(root / module) + text,
        "seconds": {name: used for name, used in seconds.items() if name not in failed},
        "sources": measured,
        "libraries": libraries,
        "switches": {name: sorted(numbers) for name, numbers in reached.items() if name},
    }
    if status not in (0, 1, 5):  # passed, some failed, none selected
        return status
    store.with_suffix(".json").write_text(json.dumps(values))
    return 0


def test_mutant(mutant: Mutant, failures: Path, first: bool) -> int:
    """Run the chosen tests with a mistake, until the first fails; failed tests are written to a file."""
    import pytest

    if any(str(getattr(module, "__file__", None)).startswith(f"{sys.path[0]}/") for module in sys.modules.values()):
        raise RuntimeError("the sources were imported before the mistake was made")
    os.environ["PINPROOF_MUTANT"] = str(mutant.switch)
    order = {name: k for k, name in enumerate(mutant.tests)}
    load = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: importlib.machinery.SourceFileLoader, name: str) -> Any:
        path = self.get_filename(name)
        return compile(mutant.changed, path, "exec") if Path(path) == mutant.file else load(self, name)

    if mutant.changed:
        importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]

    class Plugin:
        @pytest.hookimpl(trylast=True)
        def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
            items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed:
                with failures.open("a") as file:
                    file.write(report.nodeid + "\n")

    modules = dict.fromkeys(name.partition("::")[0] for name in mutant.tests)
    status = run_pytest([*(["-x"] if first else []), *modules], Plugin())
    return 0 if status == 5 else status  # no test failed if none has the expected name


# The mistakes.


def difference(root: Path, file: Path, source: bytes, start: int, end: int, text: bytes) -> str:
    """The unified difference of a source and the one with a piece replaced."""
    name = file.relative_to(root).as_posix()
    lines = [each.decode().splitlines() for each in (source, source[:start] + text + source[end:])]
    return "\n".join(difflib.unified_diff(*lines, name, name, n=1, lineterm=""))


def draw(root: Path, file: Path, count: int, seed: int) -> list[Mutant]:
    """A random sample of the mistakes in a Python file, with one in each line before any line has two."""
    source = file.read_bytes()
    candidates = mutants_python.edits(source)
    candidates = random.Random(f"{seed} {file.name}").sample(candidates, len(candidates))
    earlier: dict[int, int] = defaultdict(int)
    ranked = []
    for edit in candidates:
        line = source.count(b"\n", 0, edit[0]) + 1
        ranked.append((earlier[line], len(ranked), line, edit))
        earlier[line] += 1
    drawn: list[Mutant] = []
    for _, _, line, (start, end, text) in sorted(ranked):
        changed = source[:start] + text + source[end:]
        if len(drawn) < count and mutants_python.is_mistake(source, changed):
            last = source.count(b"\n", 0, end) + 1
            drawn.append(Mutant(file, line, last, difference(root, file, source, start, end, text), changed))
    return sorted(drawn, key=lambda mutant: mutant.line)


def choose_tests(mutant: Mutant, baselines: Iterable[Baseline], own: str, seconds: float) -> None:
    """Choose the tests that reach a mistake, the own package's and the fastest first, within a limit of CPU time."""
    used: dict[str, float] = {}
    for baseline in baselines:
        names = (
            baseline.tests_of_switch(mutant.switch)
            if mutant.switch
            else baseline.tests_of_lines(mutant.file, mutant.line, mutant.last_line)
        )
        used.update((name, baseline.seconds[name]) for name in names)
    ranked = sorted(used, key=lambda name: (not name.startswith(own), used[name]))
    total = 0.0
    chosen: dict[str, list[str]] = defaultdict(list)
    for name in ranked:
        total += used[name]
        if total <= seconds or not chosen:
            chosen[name.partition("::")[0]].append(name)
    # Tests of a file run together, because they share what is prepared for them.
    files = sorted(chosen, key=lambda file: (not file.startswith(own), sum(used[name] for name in chosen[file])))
    mutant.tests = [name for file in files for name in chosen[file]]
    mutant.seconds = sum(used[name] for name in mutant.tests)
    mutant.left_out = len(ranked) - len(mutant.tests)


def read_accepted(file: Path) -> dict[tuple[str, str], str]:
    """The mistakes that need not be noticed: their file and lines, and the reason."""
    entries = yaml.safe_load(file.read_text(encoding="utf-8")) if file.is_file() else None
    return {(entry["file"], essence(entry["diff"].splitlines())): entry["reason"] for entry in entries or ()}


def exists(file: Path, diff: str) -> bool:
    """Whether a file has all lines that an accepted mistake removes."""
    lines = {line.strip() for line in file.read_text(encoding="utf-8").splitlines()} if file.is_file() else set()
    return {line[2:] for line in diff.splitlines() if line[0] == "-"} <= lines


def record(
    root: Path, modules: list[str], sources: list[Path], compiled: bool, options: argparse.Namespace
) -> list[Baseline]:
    """What the tests reach of sources. Only files of tests that changed, or that reach a source that did, are run."""
    store = root / "build" / "mutants"
    place = store / ("reached_core" if compiled else "reached")
    folder = (store / "core" if compiled else root) / "src"
    text = digest(*(folder / file.relative_to(root / "src") for file in sources)) if compiled else ""
    suffix, marks = (".slow", []) if options.slow else ("", ["-m", "not slow"])
    stores = {module: place / (module.replace("/", ".") + suffix) for module in modules}

    def read(module: str) -> Baseline | None:
        version = digest_of_tests(root / module) + text
        return Baseline.read(stores[module], module, version, [] if compiled else sources)

    def start(module: str) -> int:
        sys.path.insert(0, str(folder))
        return measure(root, folder, module, stores[module], marks, text, compiled)

    new = [module for module in modules if read(module) is None]
    tasks = ((module, lambda module=module: start(module), LARGEST_BASELINE) for module in new)
    for k, (module, status, used) in enumerate(run_all(tasks, options.workers, store / f"baseline{os.getpid()}"), 1):
        problem = f", not used: status {status}" if status else ""
        print(f"lines that tests reach: {k}/{len(new)} {module} {used:.1f} s{problem}", flush=True)
    return [found for module in modules if (found := read(module))]


def package_of(name: str) -> str:
    """The folder of tests of a source: src/pinproof/motion/timing.py has tests/motion."""
    parts = name.split("/")
    if parts[1] == "core":
        return {"certificate": "collision", "reach": "ik", "closed_form": "ik", "timing": "motion"}.get(
            parts[2], parts[2]
        )
    return parts[2] if len(parts) > 3 else ""


def warm() -> None:
    """Import the slow libraries, so that no run of tests has to; without threads, which would not survive a fork."""
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # The finder of an editable installation would import the sources of the checkout before those of the copy.
    sys.meta_path[:] = [finder for finder in sys.meta_path if not type(finder).__module__.startswith("_editable")]
    warnings.simplefilter("ignore", DeprecationWarning)
    for library in ("pytest", "hypothesis", "numpy", "pinocchio", "coal", "scipy", "coverage", "lxml.etree"):
        with contextlib.suppress(ImportError):
            importlib.import_module(library)


def main(arguments: list[str] | None = None) -> int:
    """Try the mistakes; 1 if any is not noticed."""
    parser = argparse.ArgumentParser(prog="scripts/test --mutants", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="source in Python or C++, or a folder of them"
    )
    parser.add_argument(
        "--per-file", type=int, default=16, metavar="N", help="mistakes drawn in each file (default: 16)"
    )
    parser.add_argument("--seed", type=int, default=0, help="another seed draws other mistakes (default: 0)")
    parser.add_argument("--seconds", type=float, default=30, help="CPU time of the tests of a mistake (default: 30)")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes (default: as many as cores)"
    )
    parser.add_argument(
        "--tests", nargs="+", help=f"files or folders of tests (default: those of the package, and {FOLDERS})"
    )
    parser.add_argument("--slow", action="store_true", help="also run the tests marked slow")
    parser.add_argument(
        "--again", action="store_true", help="try only the mistakes that were not noticed in the last run"
    )
    parser.add_argument(
        "--all", action="store_true", help="also print the mistakes that were noticed, each with the test"
    )
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    root = options.root.resolve()
    os.chdir(root)
    store = root / "build" / "mutants"
    reports = store / f"run{os.getpid()}"
    reports.mkdir(parents=True, exist_ok=True)

    # The mistakes; those that the last run noticed are left out with --again.
    files = sorted(
        found.resolve()
        for given in options.files
        for found in (given.rglob("*") if given.is_dir() else [given])
        if found.suffix in (".py", ".cpp", ".h") and found.name != "__init__.py"
    )
    if missing := [str(file) for file in files if not file.is_file()]:
        parser.error(f"no such file: {', '.join(missing)}")
    mutants: list[Mutant] = []
    sites: dict[Path, dict[int, mutants_cpp.Site]] = {}
    for file in files:
        if file.suffix == ".py":
            mutants += draw(root, file, options.per_file, options.seed)
            continue
        source = file.read_text(encoding="utf-8")
        for site in mutants_cpp.draw(source, options.per_file, f"{options.seed} {file.name}"):
            number = sum(map(len, sites.values())) + 1
            sites.setdefault(file, {})[number] = site
            line = source.count("\n", 0, site.start) + 1
            diff = difference(root, file, source.encode(), *site.bytes_in(source))
            mutants.append(Mutant(file, line, line, diff, switch=number))
    accepted = read_accepted(root / "tests" / "mutants" / "accepted.yaml")
    stale = [f"{name}: {diff}" for name, diff in accepted if not exists(root / name, diff)]
    results = store / "results.json"
    last = json.loads(results.read_text()) if results.is_file() else {}
    name_of = {file: file.relative_to(root).as_posix() for file in files}
    passed_over = [m for m in mutants if (name_of[m.file], m.key) in accepted]
    mutants = [m for m in mutants if (name_of[m.file], m.key) not in accepted]
    if options.again:
        mutants = [m for m in mutants if last.get(f"{name_of[m.file]}\n{m.key}") == "survived"]

    # The core with all drawn mistakes, each switched off.
    core = store / "core"
    if sites:
        print(f"compiling {sum(map(len, sites.values()))} mistakes in C++ ...", flush=True)
        refused = mutants_cpp.build(root, core, sites, sys.executable)
        mutants = [m for m in mutants if m.switch not in refused]

    # What each test reaches. Only files of tests that changed, or reach a source that did, run again.
    folders = {package_of(name) for name in name_of.values()} - {""} | set(FOLDERS.split())
    given = options.tests or sorted(f"tests/{folder}" for folder in folders)
    paths = [root / each for each in given if (root / each).exists()] or [root / "tests"]
    modules = sorted(
        {f.relative_to(root).as_posix() for p in paths for f in ([p] if p.is_file() else p.rglob("test_*.py"))}
    )
    warm()
    baselines = {
        compiled: record(root, modules, [f for f in files if (f.suffix != ".py") == compiled], compiled, options)
        for compiled in {bool(mutant.switch) for mutant in mutants}
    }
    for library in sorted({name for found in baselines.values() for baseline in found for name in baseline.libraries}):
        with contextlib.suppress(Exception):  # an optional part of a library
            importlib.import_module(library)

    # Each test also runs once without a mistake, after only some others: a test that then fails decides nothing.
    for mutant in mutants:
        choose_tests(
            mutant, baselines[bool(mutant.switch)], f"tests/{package_of(name_of[mutant.file])}", options.seconds
        )
    controls: list[Mutant] = []
    covered: dict[bool, set[str]] = {True: set(), False: set()}  # with the copy of the core and without it
    for m in sorted(mutants, key=lambda mutant: len(mutant.tests), reverse=True):
        if new := [name for name in m.tests if name not in covered[bool(m.switch)]]:
            controls.append(Mutant(m.file, 0, 0, "", switch=-1 if m.switch else 0, tests=new, seconds=m.seconds))
            covered[bool(m.switch)].update(new)
    print(f"{len(mutants)} mistakes in {len(files)} files; {len(controls)} runs without a mistake ...", flush=True)
    unfit: set[str] = set()

    def run(k: int, mutant: Mutant, first: bool) -> tuple[tuple[int, Mutant], Callable[[], int], float]:
        def start() -> int:
            sys.path.insert(0, str((core if mutant.switch else root) / "src"))
            return test_mutant(mutant, reports / str(k), first)

        (reports / str(k)).unlink(missing_ok=True)
        return (k, mutant), start, 3 * mutant.seconds + 20

    for (k, control), status, _ in run_all(
        (run(k, m, False) for k, m in enumerate(controls)), options.workers, reports / "control"
    ):
        if status not in (0, 1):  # not even the tests could be run, which would look like a mistake that is noticed
            raise SystemExit(f"the tests of {name_of[control.file]} do not run without a mistake: status {status}")
        if (reports / str(k)).is_file():
            unfit.update((reports / str(k)).read_text().splitlines())
    for name in sorted(unfit):
        print(f"not used, because it fails without a mistake after only some of the tests before it: {name}")
    for mutant in mutants:
        mutant.tests = [name for name in mutant.tests if name not in unfit]

    # The mistakes, each in a process of its own. One that makes the tests run without end is noticed too.
    started, total = time.monotonic(), 0.0
    states: dict[str, str] = {}
    table: dict[str, dict[str, int]] = {name: defaultdict(int) for name in name_of.values()}
    tasks = (run(k, mutant, True) for k, mutant in enumerate(mutants) if mutant.tests)
    unreached = (((len(mutants), mutant), 0, 0.0) for mutant in mutants if not mutant.tests)
    outcomes = chain(unreached, run_all(tasks, options.workers, reports / "mutant"))
    for tried, ((k, mutant), status, used) in enumerate(outcomes, 1):
        if status == FAILED:
            raise SystemExit(f"a run of tests ended with an error of this script; see {reports}/mutant.*.log")
        total += used
        ended = status in (-signal.SIGXCPU, -signal.SIGKILL)
        state = "stopped" if ended else "noticed" if status else "survived"
        states[f"{name_of[mutant.file]}\n{mutant.key}"] = state
        table[name_of[mutant.file]][state] += 1
        if state == "survived":
            tests = (
                f"{len(mutant.tests)} tests run, {mutant.left_out} left out" if mutant.tests else "no test reaches it"
            )
            print(f"\n{mutant.diff}\n  not noticed: {tests}", flush=True)
        # Another run may have written meanwhile.
        last = json.loads(results.read_text()) if results.is_file() else {}
        partial = results.with_suffix(f".{os.getpid()}")
        partial.write_text(json.dumps({**last, **states}, indent=1))
        partial.replace(results)
        if state != "survived" and options.all:
            by = (reports / str(k)).read_text() if (reports / str(k)).is_file() else f"status {status}"
            print(f"\n{mutant.diff}\n  {state} by {by.strip()}", flush=True)
        if tried % 50 == 0:
            print(f"\n{tried} of {len(mutants)} tried, {total / tried:.1f} s of CPU time each", flush=True)
    shutil.rmtree(reports)
    for mutant in passed_over:
        table[name_of[mutant.file]]["accepted"] += 1

    # The table.
    print(f"\n{'file':60} mistakes noticed of these stopped accepted share")
    rows = [*table.items(), ("all", {state: sum(row[state] for row in table.values()) for state in COLUMNS})]
    for name, row in rows:
        noticed, count = row["noticed"] + row["stopped"], row["noticed"] + row["stopped"] + row["survived"]
        share = f"{100 * noticed / count:4.0f} %" if count else ""
        print(f"{name:60} {count:8} {noticed:7} {row['stopped']:16} {row['accepted']:8} {share}")
    limits = (
        f"at most {options.seconds:.0f} s of tests for each mistake, {'with' if options.slow else 'without'} slow ones"
    )
    print(f"{total:.0f} s of CPU time in {time.monotonic() - started:.0f} s; {limits}; seed {options.seed}")
    for entry in stale:
        print(f"accepted.yaml names lines that do not exist: {entry}")
    return int(bool(stale) or "survived" in states.values())


if __name__ == "__main__":
    sys.exit(main())
