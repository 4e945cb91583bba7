"""The wheel, built from the source distribution, works in a clean environment.

The wheel contains the compiled core of the checkout. That the distribution would compile to the same core is shown
without compiling it again: its files are those of the checkout, CMake accepts them, and the core states their hash. The
clean environment has links to the installed dependencies; that they can be installed is shown below.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterator
from email import message_from_bytes
from filecmp import cmp
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import Distribution, distribution
from pathlib import Path
from struct import pack
from threading import Thread
from typing import Any

import pytest
import yaml
from check_macos_core import faults, read_macho
from packaging.requirements import Requirement

import pinproof as pp
from pinproof import _core
from pinproof.core_import import source_hash

from .pages import ROOT, blocks, commands
from .processes import PATIENCE

SMOKE = ROOT / "tests" / "smoke.py"

UV = sys.executable, "-m", "uv"


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command without the PYTHON* variables of this environment, and return its output."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    core = f"cmake.define.PINPROOF_COMPILED={_core.__file__}"
    run(*UV, "build", "--quiet", "--python", sys.executable, "--out-dir", out, "-C", core, ROOT, cwd=out)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def sources(wheel: Path) -> Path:
    """The unpacked source distribution."""
    (sdist,) = wheel.parent.glob("*.tar.gz")
    shutil.unpack_archive(sdist, wheel.parent, filter="data")
    return wheel.parent / sdist.name.removesuffix(".tar.gz")


def test_the_source_distribution_has_the_files_of_the_checkout(sources: Path) -> None:
    unpacked = {str(file.relative_to(sources)) for file in sources.rglob("*") if file.is_file()}
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split()
    needed = set(listed) or {str(file.relative_to(ROOT)) for file in (ROOT / "src" / "core").rglob("*.[ch]*")}
    assert len(needed) > 50
    assert {name for name in needed - unpacked if not name.startswith(".ci/")} == set()
    changed = [name for name in unpacked if not (ROOT / name).exists() or not cmp(sources / name, ROOT / name, False)]
    assert changed == ["PKG-INFO"]


def test_the_source_distribution_compiles_to_the_core_of_the_checkout(sources: Path) -> None:
    build = sources.parent / "build"
    tools = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    python = f"-DPython_EXECUTABLE={sys.executable}"
    configure = ["cmake", "-S", sources / "src" / "core", "-B", build, "-G", "Ninja", python]
    subprocess.run(configure, check=True, capture_output=True, env=environment)
    command = ["ninja", "-C", build, "-t", "commands", "all"]
    commands = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    compiled = set(re.findall(r"-c (\S+)", commands))
    assert len(compiled) > 10
    assert [file for file in compiled if not (build / file).is_file()] == []
    assert "-shared" in commands.splitlines()[-1]
    assert source_hash(sources / "src" / "core").encode() in Path(_core.__file__).read_bytes()


def test_the_wheel_contains_robots_types_and_licence(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    robots = {str(file.relative_to(ROOT)) for file in (ROOT / "robots").rglob("*") if file.is_file()}
    assert robots
    assert {f"pinproof/{name}" for name in robots} <= set(names)
    assert "pinproof/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert not [name for name in names if not name.startswith(("pinproof/", "pinproof-"))]


def required(requirements: list[str], extras: set[str], into: dict[str, Distribution]) -> None:
    """Collect the installed distributions that requirements declare, directly or through others."""
    for requirement in map(Requirement, requirements):
        if requirement.marker and not any(requirement.marker.evaluate({"extra": extra}) for extra in extras | {""}):
            continue
        key = f"{requirement.name}[{','.join(sorted(requirement.extras))}]".lower()
        if key not in into:
            into[key] = distribution(requirement.name)
            required(into[key].requires or [], requirement.extras, into)


def link_requirements(wheel: Path, site: Path) -> None:
    """Link what the wheel declares, and nothing else, into an environment, so that an undeclared import fails."""
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        declared = message_from_bytes(archive.read(metadata)).get_all("Requires-Dist") or []
    found: dict[str, Distribution] = {}
    required(declared, set(), found)
    assert len(found) > 5
    for package in found.values():
        for top in {file.parts[0] for file in package.files or []} - {"..", "__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(Path(str(package.locate_file(top))))


@pytest.fixture
def local_index(wheel: Path, tmp_path: Path) -> Iterator[str]:
    """The address of a package index on this computer, which has the wheel and nothing else."""
    folder = tmp_path / "index" / "pinproof"  # the listing of this folder is the page of the package
    folder.mkdir(parents=True)
    (folder / wheel.name).symlink_to(wheel)

    class Silent(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Silent, directory=str(folder.parent))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.mark.slow
def test_the_first_commands_of_the_readme_work_in_a_clean_environment_without_a_compiler(
    wheel: Path, local_index: str, tmp_path: Path
) -> None:
    home, folder = tmp_path / "clean", tmp_path / "reader"
    venv.create(home, with_pip=True)
    folder.mkdir()
    (site,) = home.glob("lib/python*/site-packages")
    link_requirements(wheel, site)
    first = blocks(ROOT / "README.md", "sh")[0]
    assert [words for words, _ in commands(first)] == [["pip", "install", "pinproof"], ["pinproof", "demo"]]
    # Nothing but the environment is on the path, and the index has no other package and no sources
    environment = {
        "PATH": str(home / "bin"),
        "PIP_INDEX_URL": local_index,
        "HOME": str(tmp_path),
        "PIP_NO_CACHE_DIR": "1",
    }
    for words, _ in commands(first):
        done = subprocess.run(
            [str(home / "bin" / words[0]), *words[1:]],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
        )
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    assert (folder / "pick.html").stat().st_size > 0
    python = home / "bin" / "python"
    assert wheel.name.split("-")[1] in run(python, "-I", SMOKE, cwd=folder)
    run(python, "-m", "pip", "check", cwd=folder)
    report = json.loads(run(home / "bin" / "pinproof", "demo", "--html", "again.html", "--json", cwd=folder))
    assert sum(pick["verdict"] == "good" for pick in report["picks"]) == 4
    assert report["written"] == ["again.html", "pick.json"]


# For every supported Python, all requirements are available as wheels, so that no compiler is needed.


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = ("dask", "plot", "sensor", "xacro")
REQUIRED = [*PROJECT["dependencies"], *(one for extra in EXTRAS for one in PROJECT["optional-dependencies"][extra])]


def resolve(requirements: list[str], *words: str, **settings: str) -> subprocess.CompletedProcess[str]:
    """Let uv resolve requirements from wheels only, whatever is installed, and print one line for each package."""
    command = [
        sys.executable,
        "-m",
        "uv",
        "pip",
        "compile",
        "--only-binary",
        ":all:",
        "--no-header",
        "--no-annotate",
        "-",
    ]
    environment = {**os.environ, "UV_PYTHON_DOWNLOADS": "never", **settings}
    listed = "\n".join(requirements)
    return subprocess.run(
        [*command, *words], input=listed, capture_output=True, text=True, check=False, env=environment
    )


@pytest.fixture(scope="module")
def index() -> None:
    """Skip unless the package index is reachable."""
    if resolve(["typer"], "--no-deps", "--refresh", UV_HTTP_RETRIES="0", UV_HTTP_TIMEOUT="15").returncode:
        pytest.skip("the package index is not reachable")


SYSTEMS = ("x86_64-manylinux_2_28", "aarch64-manylinux_2_28", "aarch64-apple-darwin", "x86_64-apple-darwin")


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13", "3.14"])
def test_all_requirements_have_wheels(python: str, system: str, index: None) -> None:
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    done = resolve(REQUIRED, "--python-version", python, "--python-platform", system)
    assert done.returncode == 0, done.stderr
    assert {"pin", "coal", "numpy", "distributed"} <= {line.partition("==")[0] for line in done.stdout.splitlines()}


def test_a_requirement_without_a_wheel_is_noticed(index: None) -> None:
    done = resolve(["pin==2.6.3"], "--python-version", "3.13")
    assert done.returncode != 0
    assert "no wheels" in done.stderr


def test_workflows_run_scripts_that_exist_with_versions_of_python_that_are_stated() -> None:
    folder = ROOT / ".github" / "workflows"
    texts = {file.name: file.read_text(encoding="utf-8") for file in folder.glob("*.yml")}
    assert set(texts) == {"release.yml", "tests.yml"}
    for text in texts.values():
        for job in yaml.safe_load(text)["jobs"].values():
            assert {"runs-on", "steps"} <= set(job)
        assert all((ROOT / script).is_file() for script in re.findall(r"\./(scripts/\w+)", text))
    pythons = yaml.safe_load(texts["tests.yml"])["jobs"]["test"]["strategy"]["matrix"]["python"]
    assert {f"Programming Language :: Python :: {python}" for python in pythons} <= set(PROJECT["classifiers"])


def test_each_requirement_has_a_lowest_version() -> None:
    assert [one for one in REQUIRED if ">=" not in one] == []


# The chapter on the installation agrees with pyproject.toml, and ``python -m pinproof`` is the command line.


PAGE = ROOT / "docs" / "installation.md"


def project_text() -> str:
    return (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_page_names_the_versions_of_python_that_the_package_names() -> None:
    stated = re.findall(r"Python :: (3\.\d+)", project_text())
    (row,) = re.findall(r"^\| Python \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert re.findall(r"3\.\d+", row) == stated
    assert f'requires-python = ">={stated[0]}"' in project_text()


def test_the_page_names_every_extra_and_no_other() -> None:
    section = project_text().partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    named = re.findall(r"^\| `(\w+)` \| `pip install '\.\[(\w+)\]'`", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {extra for extra, _ in named} == set(re.findall(r"^(\w+) = \[", section, re.MULTILINE))
    assert all(extra == installed for extra, installed in named)


def test_the_commands_of_the_page_exist(tmp_path: Path) -> None:
    for block in blocks(PAGE, "sh"):
        for script in re.findall(r"^\./(scripts/\w+)", block.text, re.MULTILINE):
            assert (ROOT / script).is_file()


def test_the_dockerfile_of_the_page_has_known_instructions_and_starts_the_command() -> None:
    (dockerfile,) = blocks(PAGE, "dockerfile")
    assert dockerfile.text == (ROOT / "packaging" / "Dockerfile").read_text(encoding="utf-8")
    lines = dockerfile.text.replace("\\\n", " ").splitlines()
    assert [line.split()[0] for line in lines] == ["FROM", "RUN", "COPY", "RUN", "WORKDIR", "ENTRYPOINT"]
    version = re.match(r"FROM python:(3\.\d+)-slim", lines[0])
    assert version is not None
    assert f"Python :: {version[1]}" in project_text()
    assert re.search(r'^pinproof = "pinproof\.cli', project_text(), re.MULTILINE)


def test_the_conda_recipe_has_the_requirements_of_the_package() -> None:
    recipe = yaml.safe_load((ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"] == {"name": PROJECT["name"], "version": PROJECT["version"]}
    names = {"pinocchio-python": "pin", "coal-python": "coal", "meshcat-python": "meshcat"}
    stated = dict(line.split() for line in recipe["requirements"]["run"])
    assert stated.pop("python") == PROJECT["requires-python"]
    needed = {one.name: str(one.specifier) for one in map(Requirement, PROJECT["dependencies"])}
    assert needed.pop("ruckig")  # the recipe states that it comes from pip
    assert {names.get(name, name): version for name, version in stated.items()} == needed
    built = set(recipe["requirements"]["host"]) - {"python", "pip"}
    assert {line.replace(" ", "") for line in built} == set(tomllib.loads(project_text())["build-system"]["requires"])


# A core for macOS is compiled by scripts/cross_compile on Linux, and what it asks of macOS is checked after linking.


def mach_object(
    names: dict[str, int], *, minimum: int = 11 << 16, libraries: tuple[str, ...] = (), signed: bool = True
) -> bytes:
    """A Mach-O bundle for arm64 that binds symbols, each with the ordinal of its library."""
    code = b"".join(
        bytes([0x40]) + name.encode() + b"\0" + bytes([(0x10 if ordinal >= 0 else 0x30) | ordinal & 0xF, 0x72, 8, 0x90])
        for name, ordinal in names.items()
    )
    loads = [pack("<6I", 0x32, 24, 1, minimum, minimum, 0)]
    for library in libraries:
        text = library.encode() + b"\0" * (8 - len(library) % 8)
        loads.append(pack("<6I", 0xC, 24 + len(text), 24, 0, 0, 0) + text)
    if signed:
        loads.append(pack("<4I", 0x1D, 16, 0, 0))
    at = 32 + sum(map(len, loads)) + 48
    loads.append(pack("<12I", 0x80000022, 48, 0, 0, at, len(code), 0, 0, 0, 0, 0, 0))
    return pack("<8I", 0xFEEDFACF, 0x0100000C, 0, 8, len(loads), sum(map(len, loads)), 0, 0) + b"".join(loads) + code


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({}, None),
        ({"symbols": {"_cblas_dgemm": -2}}, "_cblas_dgemm is neither"),
        ({"symbols": {"_PyNoSuchFunction": -2}}, "_PyNoSuchFunction is neither"),
        ({"symbols": {"_PyList_New": 1}}, "_PyList_New is looked up in /usr/lib"),
        ({"symbols": {"_malloc": 0}}, "_malloc is looked up in library 0"),
        ({"signed": False}, "it has no signature"),
        ({"minimum": 14 << 16}, "it asks for macOS"),
        ({"libraries": ("/usr/lib/libSystem.B.dylib", "/opt/homebrew/lib/libomp.dylib")}, "it links against /opt"),
    ],
)
def test_a_core_for_macos_that_asks_for_more_than_the_system_and_python_is_refused(
    change: dict[str, Any], fault: str | None
) -> None:
    symbols = {"_PyModuleDef_Init": -2, "_free": 1, **change.get("symbols", {})}
    settings = {"libraries": ("/usr/lib/libSystem.B.dylib",), **change, "symbols": symbols}
    core = read_macho(mach_object(settings.pop("symbols"), **settings))
    assert core.undefined["_free"] == "/usr/lib/libSystem.B.dylib"
    found = faults(core, "arm64", (11, 0))
    assert (len(found), bool(found) and found[0].startswith(str(fault))) == ((0, False) if fault is None else (1, True))
    assert faults(core, "x86_64", (11, 0))[0] == "it is for arm64, not x86_64"


@pytest.mark.slow
def test_the_package_runs_as_a_module(tmp_path: Path) -> None:
    def run_package(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "pinproof", *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=PATIENCE)

    assert run_package("--version").stdout == f"pinproof {pp.__version__}\n"
    wrong = run_package("fk", "ur55")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith("pinproof: unknown robot 'ur55'")
