"""``pinproof new cell``: the files of a cell from a robot and meshes of parts, and the verdicts on its picks."""

from __future__ import annotations

from dataclasses import MISSING, asdict, replace
from pathlib import Path

import pinproof as pp
from pinproof.cli.console import print_json, print_line, print_report, progress_bar, progress_status
from pinproof.cli.options import Json, Robot, RobotFileOptions, Seed, argument, option
from pinproof.cli.pick import judge_file
