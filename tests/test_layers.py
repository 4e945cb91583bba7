"""The order of the house: who may import whom, where Pinocchio may be seen, and what must wait until it is needed.

The rules read the source with ``ast``; each is also shown to catch a small tree that breaks it.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "pinproof"

ROOMS = (
    "verifier",
    "errors",
    "spatial",
    "common",
    "kernels",
    "description",
    "model",
    "conversion",
    "motion",
    "ik",
    "collision",
    "planning",
    "viewer",
    "picks",
    "benchmarks",
    "cli",
)
SIBLINGS = ({"ik", "collision"},)
BEHIND_THE_MODEL = {"pinocchio", "coal", "hppfcl"}
MAY_TOUCH_THEM = {"spatial", "model", "collision", "viewer"}
HEAVY = {"dask", "distributed", "matplotlib", "meshcat", "numba", "scipy", "toppra", "trimesh", "typer", "yourdfpy"}
HEAVY_ALLOWED = {"cli": {"typer"}, "kernels": {"numba"}}
VERIFIER_NEEDS = {"numpy", *sys.stdlib_module_names}


@dataclass(frozen=True)
class Import:
    """One imported name: ``from pinproof.ik import Clik`` has the target ``pinproof.ik.Clik``."""

    file: Path
    line: int
    room: str
    target: str
    at_module_level: bool
    only_for_types: bool

    @property
    def top(self) -> str:
        return self.target.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.file.name}:{self.line} ({self.room}) imports {self.target}"


def source_files(package: Path) -> Iterator[tuple[Path, str]]:
    """Every module under a room, with the room; the package's own ``__init__`` belongs to none."""
    for file in sorted(package.rglob("*.py")):
        parts = file.relative_to(package).with_suffix("").parts
        if parts != ("__init__",):
            yield file, parts[0]


def imports(package: Path) -> Iterator[Import]:
    """Every import of every module, relative ones made absolute."""
    for file, room in source_files(package):
        holder = ("pinproof", *file.relative_to(package).parent.parts)

        def visit(node: ast.AST, in_function: bool, for_types: bool) -> Iterator[Import]:
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = holder[: len(holder) - node.level + 1] if node.level else ()  # noqa: B023
                prefix = ".".join([*base, *([node.module] if node.module else [])])
                targets = [f"{prefix}.{alias.name}" for alias in node.names]
            else:
                targets = []
            for target in targets:
                yield Import(file, node.lineno, room, target, not in_function, for_types)  # noqa: B023
            in_function = in_function or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            for_types = for_types or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
            for child in ast.iter_child_nodes(node):
                yield from visit(child, in_function, for_types)

        yield from visit(ast.parse(file.read_text(encoding="utf-8")), False, False)


def unknown_rooms(package: Path) -> list[str]:
    return sorted({f"{room} is not a room of the house" for _, room in source_files(package) if room not in ROOMS})


def upward_only(package: Path) -> list[str]:
    """A module imports from its own room and from rooms above it, never from below, never from a sibling."""
    found = []
    for each in imports(package):
        if each.top != "pinproof" or each.room not in ROOMS or each.target == "pinproof.__version__":
            continue
        target = each.target.split(".")[1] if "." in each.target else ""
        if target not in ROOMS:  # `import pinproof`, `from pinproof import Clik`: that is the whole house
            allowed = each.room == "cli"
        else:
            allowed = ROOMS.index(target) <= ROOMS.index(each.room) and {target, each.room} not in SIBLINGS
        if not allowed:
            found.append(str(each))
    return found


def pinocchio_stays_behind_the_model(package: Path) -> list[str]:
    """Others see arrays and ``pin.SE3`` values; to name that type in a signature they import it for types only."""
    return [
        str(each)
        for each in imports(package)
        if each.top in BEHIND_THE_MODEL and each.room not in MAY_TOUCH_THEM and not each.only_for_types
    ]


def the_verifier_stands_alone(package: Path) -> list[str]:
    """It re-checks what the rest of the house proves, so it may share no code with it, and runs where only NumPy is."""
    own = "pinproof.verifier"
    return [
        str(each)
        for each in imports(package)
        if each.room == "verifier" and each.top not in VERIFIER_NEEDS and not f"{each.target}.".startswith(f"{own}.")
    ]


def heavy_libraries_wait(package: Path) -> list[str]:
    """What is slow to import is imported by the function that needs it."""
    return [
        str(each)
        for each in imports(package)
        if each.top in HEAVY - HEAVY_ALLOWED.get(each.room, set()) and each.at_module_level and not each.only_for_types
    ]


def only_the_command_line_prints(package: Path) -> list[str]:
    return [
        f"{file.name}:{node.lineno} ({room}) prints"
        for file, room in source_files(package)
        if room != "cli"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]


Rule = Callable[[Path], list[str]]
RULES: list[Rule] = [
    unknown_rooms,
    upward_only,
    pinocchio_stays_behind_the_model,
    the_verifier_stands_alone,
    heavy_libraries_wait,
    only_the_command_line_prints,
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_package_keeps_the_rule(rule: Rule) -> None:
    assert list(source_files(PACKAGE)), f"no source found in {PACKAGE}"
    assert rule(PACKAGE) == []


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (unknown_rooms, "helpers/misc.py", ""),
        (upward_only, "model/arm.py", "from pinproof.planning import RrtConnect"),
        (upward_only, "model/arm.py", "def f():\n    import pinproof.cli.main"),
        (upward_only, "model/arm.py", "from ..picks import Pick"),
        (upward_only, "model/arm.py", "from pinproof import picks"),
        (upward_only, "model/arm.py", "import pinproof as pp"),
        (upward_only, "model/arm.py", "from pinproof import Clik"),
        (upward_only, "ik/clik.py", "from pinproof.collision import CollisionChecker"),
        (upward_only, "collision/checker.py", "from pinproof.ik import Clik"),
        (upward_only, "spatial.py", "from .model import Robot"),
        (pinocchio_stays_behind_the_model, "planning/rrt.py", "import pinocchio as pin"),
        (pinocchio_stays_behind_the_model, "picks/stages.py", "def f():\n    from coal import Box"),
        (the_verifier_stands_alone, "verifier/proof.py", "from pinproof.errors import InputError"),
        (the_verifier_stands_alone, "verifier/proof.py", "def f():\n    import scipy"),
        (heavy_libraries_wait, "motion/timing.py", "import toppra.algorithm"),
        (heavy_libraries_wait, "ik/clik.py", "try:\n    from scipy.linalg import solve\nexcept ImportError:\n    pass"),
        (heavy_libraries_wait, "viewer/page.py", "class Page:\n    import meshcat"),
        (only_the_command_line_prints, "ik/clik.py", "def f(x):\n    print(x)"),
    ],
)
def test_rule_catches_a_breach(rule: Rule, module: str, source: str, tmp_path: Path) -> None:
    write(tmp_path, module, source)
    assert len(rule(tmp_path)) == 1


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("__init__.py", "from pinproof.cli import main"),
        ("planning/rrt.py", "from pinproof.collision import CollisionChecker\nfrom .tree import Tree"),
        ("verifier/proof.py", "import json\nimport numpy as np\nfrom .reading import load"),
        ("planning/__init__.py", "from . import rrt\nfrom pinproof import __version__, spatial"),
        ("ik/clik.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pinocchio as pin"),
        ("model/robot.py", "import pinocchio as pin\nimport numpy as np"),
        ("motion/timing.py", "def time_parametrise(path):\n    import toppra"),
        ("cli/main.py", "import typer\nimport pinproof as pp\nprint(pp.__version__)"),
        ("ik/clik.py", '"""Never call print() or import toppra here."""'),
    ],
)
def test_rule_lets_the_allowed_pass(rule: Rule, module: str, source: str, tmp_path: Path) -> None:
    write(tmp_path, module, source)
    assert rule(tmp_path) == []


def write(package: Path, module: str, source: str) -> None:
    file = package / module
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(source, encoding="utf-8")
