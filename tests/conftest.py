"""Settings and hooks of the whole test suite."""

from __future__ import annotations

import gc
import os
import sys
import warnings
from collections.abc import Iterator

import pytest
from hypothesis import settings

# No deadline: the first call of a test may load libraries or meshes. In CI the examples are the same on every run.
settings.register_profile("pinproof", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("pinproof")

SLOW_FIXTURES = {"browser", "client", "cluster", "demo", "index", "site", "wheel"}
"""Fixtures that start a browser or a cluster, or build or resolve packages. Every test that uses one is slow."""

FAILED = pytest.StashKey[bool]()
"""Whether a test has failed in its setup, call or teardown."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use a slow fixture."""
    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("slow")


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
    passing test leaves open remain an error.
    """
    result = yield
    if item.stash.get(FAILED, False):
        for name in ("last_type", "last_value", "last_traceback", "last_exc"):
            if hasattr(sys, name):
                delattr(sys, name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()
    return result
