"""``__all__`` is sorted and complete, and every name exists."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from types import ModuleType

import public_interface
import pytest

import pinproof as pp

INTERNAL = {"__main__", "_core"}
TOP = (f"pinproof.{each.name}" for each in pkgutil.iter_modules(pp.__path__) if each.name not in INTERNAL)
PACKAGES = sorted([*TOP, "pinproof.execution.ros2"])

# fmt: off
CONTRACT = {
    "Arm", "Box", "Capsule", "Certificate", "CertificateStatus", "Clik", "CollisionChecker", "Cylinder", "DhRow",
    "DhTable", "IkBatch", "IkResult", "JointPath", "Mesh", "Obstacle", "Picks", "PinproofError", "PlanResult",
    "RrtConnect", "Scene", "Sphere", "Trajectory", "certify", "dh_to_urdf", "load_robot", "pose", "read_picks",
    "shortcut", "show", "time_parametrise", "validate_picks", "write_html", "write_urdf", "xyz_rpy",
}
# fmt: on


def in_order(names: list[str]) -> list[str]:
    """Constants, then classes, then functions, each by the alphabet: the order that ruff's RUF022 writes."""
    return sorted(set(names), key=lambda name: (not name.isupper(), not name[:1].isupper(), name))


def test_package_all_is_sorted_and_has_no_doubles() -> None:
    assert pp.__all__ == in_order(pp.__all__)


@pytest.mark.parametrize("name", pp.__all__)
def test_every_name_of_the_package_resolves(name: str) -> None:
    assert name == "__version__" or not name.startswith("_")
    value = getattr(pp, name)
    assert not isinstance(value, ModuleType)
    assert name == "__version__" or value.__name__ == name


def test_names_of_the_contract_exist() -> None:
    assert set(pp.__all__) >= CONTRACT


def test_dir_lists_what_is_exported_and_the_packages() -> None:
    assert dir(pp) == sorted([*pp.__all__, *pp._PACKAGES])
    assert {"collision", "picks"} < {name for name in dir(pp) if isinstance(getattr(pp, name), ModuleType)}


@pytest.mark.parametrize(
    ("name", "place"),
    [("Cone", "pp.collision.Cone"), ("certfy", "pp.certify"), ("telepathy", "no attribute 'telepathy'$")],
)
def test_unknown_name_leads_to_the_place_of_a_similar_one(name: str, place: str) -> None:
    with pytest.raises(AttributeError, match=place):
        getattr(pp, name)


def test_the_top_level_stays_small() -> None:
    assert len(pp.__all__) <= 77


def test_the_errors_that_users_catch_are_exported() -> None:
    errors = set(importlib.import_module("pinproof.errors").__all__)
    assert errors & set(pp.__all__) == {"FileError", "InputError", "NoAnswer", "PinproofError", "UnknownNameError"}


@pytest.mark.parametrize("package", sorted(pp._HOME))
def test_top_level_names_are_exported_by_their_package(package: str) -> None:
    assert set(pp._HOME[package].split()) <= set(importlib.import_module(package).__all__)


def test_type_checkers_see_what_is_exported() -> None:
    tree = ast.parse(Path(inspect.getfile(pp)).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname: node.module for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert seen == pp._MODULE_OF


@pytest.mark.parametrize("name", pp._PACKAGES)
def test_further_names_are_reached_through_the_package(name: str) -> None:
    assert getattr(pp, name) is importlib.import_module(f"pinproof.{name}")


def test_every_package_of_the_reference_is_imported_at_first_use() -> None:
    pages = (Path(__file__).parents[1] / "docs" / "api").glob("*.md")
    shown = {name for page in pages for name in re.findall(r"{package} pinproof\.(\w+)", page.read_text("utf-8"))}
    assert len(shown) > 10
    assert shown <= set(pp._PACKAGES)


@pytest.mark.parametrize("name", PACKAGES)
def test_all_of_a_package_is_sorted_and_resolves(name: str) -> None:
    package = importlib.import_module(name)
    exported = list(getattr(package, "__all__", []))
    assert exported == in_order(exported)
    assert [each for each in exported if not hasattr(package, each)] == []


@pytest.mark.parametrize("name", PACKAGES)
def test_all_lists_every_public_name_of_a_package(name: str) -> None:
    package = importlib.import_module(name)
    own = {
        each
        for each, value in vars(package).items()
        if not each.startswith("_")
        and (inspect.isclass(value) or inspect.isfunction(value))
        and (value.__module__ == name or (hasattr(package, "__path__") and value.__module__.startswith("pinproof.")))
    }
    assert own <= set(package.__all__)


@pytest.mark.parametrize("name", [name for name in PACKAGES if name != "pinproof.cli"])
def test_an_init_file_only_exports_names(name: str) -> None:
    package = importlib.import_module(name)
    if not hasattr(package, "__path__"):
        return  # a single module
    allowed = (ast.Import, ast.ImportFrom, ast.Expr, ast.Assign, ast.AnnAssign)
    body = ast.parse(Path(inspect.getfile(package)).read_text(encoding="utf-8")).body
    assert [f"line {each.lineno}" for each in body if not isinstance(each, allowed)] == []


def test_the_interface_is_the_stored_list() -> None:
    stored = public_interface.PAGE.read_text(encoding="utf-8").splitlines()
    found = public_interface.interface().splitlines()
    hint = "if the change is meant, state it in CHANGELOG.md and run: python scripts/public_interface.py"
    assert set(stored) ^ set(found) == set(), hint
    assert stored == found
