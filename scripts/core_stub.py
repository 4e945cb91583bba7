"""Write src/pinproof/_core.pyi, the types of the compiled core, from the signatures in the compiled module.

python scripts/core_stub.py            writes the stub
python scripts/core_stub.py --check    exit code 1 if the stub is not up to date
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

from nanobind.stubgen import StubGen

from pinproof import _core

STUB = Path(__file__).resolve().parents[1] / "src" / "pinproof" / "_core.pyi"
HEAD = '"""The compiled core, an extension module built from src/core. Written by scripts/core_stub.py."""\n'
IMPORTS = """import enum
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy
from numpy.typing import NDArray
"""
ARGUMENT = re.compile(r"Annotated\[(NDArray\[numpy\.\w+\]), dict\([^()]*(?:\([^()]*\)[^()]*)*\)\]")
"""An array with its shape and memory layout, which mypy cannot check."""


def stub_text() -> str:
    """The stub without docstrings, not formatted. Results that the core declares as objects are arrays."""
    generator = StubGen(_core, include_docstrings=False)
    generator.put(_core)
    lines = [_line(ARGUMENT.sub(r"\1", line)) for line in generator.get().splitlines()]
    body = [line for line in lines if not line.startswith(("from ", "import "))]
    return f"{HEAD}\n{IMPORTS}\n" + "\n".join(body) + "\n"


def _line(line: str) -> str:
    """The line with arrays in place of objects in the type of a result, and any elements of plain containers."""
    line = re.sub(r"\bCallable\b(?!\[)", "Callable[..., Any]", line)
    head, arrow, result = line.rpartition(" -> ")
    if not arrow:
        return line
    result = re.sub(r"\bobject\b", "NDArray[Any]", result)
    result = re.sub(r"\btuple\b(?!\[)", "tuple[Any, ...]", re.sub(r"\blist\b(?!\[)", "list[Any]", result))
    result = re.sub(r"\bdict\b(?!\[)", "dict[str, Any]", result)
    return f"{head}{arrow}{result}"


def main() -> int:
    """Write or check the stub."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(STUB), "-"]
    text = subprocess.run(command, input=stub_text(), capture_output=True, text=True, check=True).stdout
    if check:
        return int(STUB.read_text(encoding="utf-8") != text)
    STUB.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
