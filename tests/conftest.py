"""Settings that every test shares."""

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
"""Fixtures that start a browser or a cluster, or build or resolve packages: every test that uses one is slow."""

FAILED = pytest.StashKey[bool]()
"""Whether a test has failed, in its setup, its call or its teardown."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use a slow fixture."""
    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("slow")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Note which tests fail."""
    report = yield
    if report.failed:
        item.stash[FAILED] = True
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Collect what a failed test leaves open, before its warnings, which are errors, make another test fail.

    The frames of a failed test stay alive with its traceback, and so do the files and processes in them. What a test
    that passes leaves open is an error as before.
    """
    done = yield
    if item.stash.get(FAILED, False):
        for name in ("last_type", "last_value", "last_traceback", "last_exc"):
            if hasattr(sys, name):
                delattr(sys, name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()
    return done
