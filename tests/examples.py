"""The number of Hypothesis examples of a test, relative to the profile of the run."""

from __future__ import annotations

from typing import Any

from hypothesis import settings


def examples(count: int, **more: Any) -> settings:
    """Hypothesis settings with ``count`` examples, or a quarter of them with the profile ``quick``."""
    return settings(max_examples=max(1, count * settings.default.max_examples // 100), **more)
