"""Settings that every test shares."""

from __future__ import annotations

import os

from hypothesis import settings

# No deadline: the first call of a test may load libraries or meshes. In CI the examples are the same on every run.
settings.register_profile("pinproof", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("pinproof")
