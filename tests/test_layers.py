"""The structure of the package: which packages import which, no import cycles, lazy imports of slow libraries.

The rules read the source with ``ast``. Each rule is also tested on a small source tree that violates it.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "pinproof"

PACKAGES = (
    "verifier",
    "errors",
    "core_import",
    "_core",
    "units",
    "spatial",
    "common",
    "work",
    "description",
    "model",
    "motion",
    "ik",
    "collision",
    "viewer",
    "planning",
    "execution",
    "picks",
    "cell",
    "tool_paths",
    "formats",
    "cli",
)
SIBLINGS = ({"ik", "collision"},)
BEHIND_THE_MODEL = {"pinocchio", "coal", "hppfcl"}
MAY_TOUCH_THEM = {"spatial", "model", "collision", "viewer"}
MAY_ALSO_TOUCH = {("description", "coal")}  # the second reading of mesh files
HEAVY = {"dask", "distributed", "matplotlib", "meshcat", "scipy", "toppra", "trimesh", "typer"}
HEAVY_ALLOWED = {"cli": {"typer"}}
FACES = {
    "verifier",
    "description",
    "model",
    "motion",
    "ik",
    "collision",
    "planning",
    "tool_paths",
    "execution",
    "viewer",
}
FACES |= {"picks", "cell"}
"""Packages that others import by their public names only: ``from pinproof.ik import Clik``, never an inner module."""
NAMESPACES = {
    "pinproof.description.meshes",
    "pinproof.viewer.panels",
}
"""Modules of these packages whose functions are used with the name of the module, such as ``panels.Bar``."""
VERIFIER_NEEDS = {"numpy", *sys.stdlib_module_names}


@dataclass(frozen=True)
class Import:
    """One imported name: ``from pinproof.ik import Clik`` has the target ``pinproof.ik.Clik``."""

    file: Path
    line: int
    package: str
    target: str
    at_module_level: bool
    only_for_types: bool

    @property
    def top(self) -> str:
        return self.target.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.file.name}:{self.line} ({self.package}) imports {self.target}"


def source_files(package: Path) -> Iterator[tuple[Path, str]]:
    """Every module of the source tree with its package; the top-level ``__init__`` and ``__main__`` are left out."""
    for file in sorted(package.rglob("*.py")):
        parts = file.relative_to(package).with_suffix("").parts
        if parts not in (("__init__",), ("__main__",)):
            yield file, parts[0]


@cache
def imports(package: Path) -> tuple[Import, ...]:
    """Every import of every module, relative ones made absolute."""
    return tuple(read_imports(package))


def read_imports(package: Path) -> Iterator[Import]:
    for file, name in source_files(package):
        parent = ("pinproof", *file.relative_to(package).parent.parts)

        def visit(node: ast.AST, in_function: bool, for_types: bool) -> Iterator[Import]:
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = parent[: len(parent) - node.level + 1] if node.level else ()  # noqa: B023
                prefix = ".".join([*base, *([node.module] if node.module else [])])
                targets = [f"{prefix}.{alias.name}" for alias in node.names]
            else:
                targets = []
            for target in targets:
                yield Import(file, node.lineno, name, target, not in_function, for_types)  # noqa: B023
            in_function = in_function or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            for_types = for_types or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
            for child in ast.iter_child_nodes(node):
                yield from visit(child, in_function, for_types)

        yield from visit(ast.parse(file.read_text(encoding="utf-8")), False, False)


def unknown_packages(package: Path) -> list[str]:
    return sorted({f"{name} is not a known package" for _, name in source_files(package) if name not in PACKAGES})


def upward_only(package: Path) -> list[str]:
    """A module imports from its own package and from packages before it in PACKAGES, never from a sibling."""
    found = []
    for each in imports(package):
        if each.top != "pinproof" or each.package not in PACKAGES or each.target == "pinproof.__version__":
            continue
        target = each.target.split(".")[1] if "." in each.target else ""
        if target not in PACKAGES:  # `import pinproof`, `from pinproof import Clik`: imports everything
            allowed = each.package == "cli"
        else:
            allowed = PACKAGES.index(target) <= PACKAGES.index(each.package) and {target, each.package} not in SIBLINGS
        if not allowed:
            found.append(str(each))
    return found


def packages_are_imported_by_their_names(package: Path) -> list[str]:
    """A package uses what another exports; what it needs and cannot import is missing in the public interface."""
    modules = set(import_graph(package)) - NAMESPACES
    return [
        str(one)
        for one in imports(package)
        for parts in [one.target.split(".")]
        if parts[0] == "pinproof" and len(parts) > 2 and parts[1] in FACES - {one.package}
        if len(parts) > 3 or one.target in modules
    ]


def pinocchio_is_imported_by_few_packages(package: Path) -> list[str]:
    """Other packages use arrays and ``pin.SE3`` values and import Pinocchio for type annotations only."""
    return [
        str(each)
        for each in imports(package)
        if each.top in BEHIND_THE_MODEL
        and each.package not in MAY_TOUCH_THEM
        and (each.package, each.top) not in MAY_ALSO_TOUCH
        and not each.only_for_types
    ]


def verifier_is_independent(package: Path) -> list[str]:
    """The verifier shares no code with the prover that it checks, and requires NumPy only."""
    own = "pinproof.verifier"
    return [
        str(each)
        for each in imports(package)
        if each.package == "verifier" and each.top not in VERIFIER_NEEDS and not f"{each.target}.".startswith(f"{own}.")
    ]


def slow_imports_are_lazy(package: Path) -> list[str]:
    """Libraries that are slow to import are imported inside the function that needs them."""
    return [
        str(each)
        for each in imports(package)
        if each.top in HEAVY - HEAVY_ALLOWED.get(each.package, set())
        and each.at_module_level
        and not each.only_for_types
    ]


def only_the_command_line_prints(package: Path) -> list[str]:
    return [
        f"{file.name}:{node.lineno} ({name}) prints"
        for file, name in source_files(package)
        if name != "cli"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]


def import_graph(package: Path) -> dict[str, set[str]]:
    """The modules of the package that each module imports, imports for type annotations included."""
    modules = {}
    for file in package.rglob("*.py"):
        parts = ("pinproof", *file.relative_to(package).with_suffix("").parts)
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    graph: dict[str, set[str]] = {name: set() for name in modules}
    names = {file: name for name, file in modules.items()}
    for each in imports(package):
        target = each.target
        while target and target not in modules:  # from the imported name to the module that contains it
            target = target.rpartition(".")[0]
        if target and target != names[each.file]:
            graph[names[each.file]].add(target)
    return graph


def strongly_connected(graph: dict[str, set[str]]) -> list[list[str]]:
    """The strongly connected components with more than one node (Tarjan 1972)."""
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = lowest[node] = len(index)
        stack.append(node)
        for target in sorted(graph[node]):
            if target not in index:
                visit(target)
            if target in stack:
                lowest[node] = min(lowest[node], lowest[target])
        if lowest[node] == index[node]:
            position = stack.index(node)
            component = stack[position:]
            del stack[position:]
            if len(component) > 1:
                found.append(sorted(component))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


PACKAGES_WITH_CYCLES: tuple[str, ...] = ()
"""Packages whose import cycles are known and still to be removed."""


def no_import_cycles(package: Path) -> list[str]:
    """No module imports, directly or through others, a module that imports it."""
    return [
        f"import cycle: {', '.join(cycle)}"
        for cycle in strongly_connected(import_graph(package))
        if not any(f"pinproof.{name}" in module for name in PACKAGES_WITH_CYCLES for module in cycle)
    ]


Rule = Callable[[Path], list[str]]
RULES: list[Rule] = [
    unknown_packages,
    upward_only,
    packages_are_imported_by_their_names,
    pinocchio_is_imported_by_few_packages,
    verifier_is_independent,
    slow_imports_are_lazy,
    only_the_command_line_prints,
    no_import_cycles,
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
@pytest.mark.slow
def test_package_follows_the_rule(rule: Rule) -> None:
    assert list(source_files(PACKAGE)), f"no source found in {PACKAGE}"
    assert rule(PACKAGE) == []


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (unknown_packages, "helpers/misc.py", ""),
        (upward_only, "model/arm.py", "from pinproof.planning import RrtConnect"),
        (upward_only, "model/arm.py", "def f():\n    import pinproof.cli.main"),
        (upward_only, "model/arm.py", "from ..picks import Pick"),
        (upward_only, "model/arm.py", "from pinproof import picks"),
        (upward_only, "model/arm.py", "import pinproof as pp"),
        (upward_only, "model/arm.py", "from pinproof import Clik"),
        (upward_only, "ik/clik.py", "from pinproof.collision import CollisionChecker"),
        (upward_only, "collision/checking/checker.py", "from pinproof.ik import Clik"),
        (upward_only, "spatial.py", "from .model import Robot"),
        (packages_are_imported_by_their_names, "picks/stages.py", "from pinproof.ik.clik import Clik"),
        (packages_are_imported_by_their_names, "cli/main.py", "def f():\n    import pinproof.collision.checking.audit"),
        (pinocchio_is_imported_by_few_packages, "planning/rrt.py", "import pinocchio as pin"),
        (pinocchio_is_imported_by_few_packages, "description/urdf.py", "import pinocchio as pin"),
        (pinocchio_is_imported_by_few_packages, "picks/stages.py", "def f():\n    from coal import Box"),
        (verifier_is_independent, "verifier/proof.py", "from pinproof.errors import InputError"),
        (verifier_is_independent, "verifier/proof.py", "def f():\n    import scipy"),
        (slow_imports_are_lazy, "motion/timing.py", "import toppra.algorithm"),
        (
            slow_imports_are_lazy,
            "ik/clik.py",
            "try:\n    from scipy.linalg import solve\nexcept ImportError:\n    pass",
        ),
        (slow_imports_are_lazy, "viewer/page.py", "class Page:\n    import meshcat"),
        (only_the_command_line_prints, "ik/clik.py", "def f(x):\n    print(x)"),
    ],
)
def test_rule_detects_a_violation(rule: Rule, module: str, source: str, tmp_path: Path) -> None:
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
def test_rule_accepts_allowed_imports(rule: Rule, module: str, source: str, tmp_path: Path) -> None:
    write(tmp_path, module, source)
    assert rule(tmp_path) == []


def test_import_cycle_through_an_annotation_is_detected(tmp_path: Path) -> None:
    write(tmp_path, "ik/a.py", "from pinproof.ik.b import B")
    write(tmp_path, "ik/b.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .c import C")
    write(tmp_path, "ik/c.py", "def f():\n    import pinproof.ik.a")
    assert no_import_cycles(tmp_path) == ["import cycle: pinproof.ik.a, pinproof.ik.b, pinproof.ik.c"]


def write(package: Path, module: str, source: str) -> None:
    file = package / module
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(source, encoding="utf-8")
