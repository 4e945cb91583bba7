"""Settings, hooks and the browser of the test suite."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from .viewer.browser import Browser

# No test fails because the machine is busy: there is neither a deadline nor a limit on the time to generate examples.
# In CI the examples are the same on every run.
settings.register_profile(
    "full",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=bool(os.environ.get("CI")),
)
settings.register_profile("quick", settings.get_profile("full"), max_examples=25)  # see tests/examples.py
settings.load_profile("full")

SLOW_FIXTURES = {"browser", "client", "cluster", "index", "reports", "site", "wheel"}
"""Fixtures that start a browser or a cluster, build or resolve packages, or judge the picks of all shipped cells.

Every test that uses one is slow.
"""

FAILED = pytest.StashKey[bool]()
"""Whether a test has failed in its setup, call or teardown."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use a slow fixture, and run the files with slow tests first, so that workers end together."""
    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("slow")
    slow_files = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow_files)


def pytest_collection_finish() -> None:
    """Let the garbage collector run less, and not search the modules and tests, which exist until the end.

    With the default settings it takes a tenth of the time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)  # new objects; the default is 700


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test that starts a Python process and is not marked slow. Small programs such as git are allowed."""
    if item.get_closest_marker("slow"):
        return (yield)

    def refuse(*args: object, **settings: object) -> None:
        raise RuntimeError(f"{item.name} starts a Python process; mark it with @pytest.mark.slow")

    def start(self: subprocess.Popen[Any], command: Any, *args: Any, **settings: Any) -> None:
        if not isinstance(command, (str, bytes)) and command and os.fspath(command[0]) == sys.executable:
            refuse()
        popen(self, command, *args, **settings)

    popen = subprocess.Popen.__init__
    with mock.patch.object(subprocess.Popen, "__init__", start), mock.patch.object(BaseProcess, "start", refuse):
        return (yield)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The headless browser of this worker."""
    from .viewer.browser import Browser, find_browser

    executable = find_browser()
    if executable is None:
        pytest.skip("no Chromium: none of chromium, chromium-browser, google-chrome is on PATH and CHROMIUM is not set")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        started = Browser(executable, Path(profile))
        try:
            yield started
        finally:
            started.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Record which tests fail."""
    report = yield
    if report.failed:
        item.stash[FAILED] = True
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Release the open files and processes of a failed test, so that their warnings do not make another test fail.

    The traceback of a failed test keeps its frames alive, and with them its open files and processes. Resources that a
    passing test leaves open remain an error, unless it states that a library leaves them to the garbage collector.
    """
    result = yield
    if item.stash.get(FAILED, False) or item.get_closest_marker("filterwarnings"):
        for name in ("last_type", "last_value", "last_traceback", "last_exc"):
            if hasattr(sys, name):
                delattr(sys, name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()
    return result
