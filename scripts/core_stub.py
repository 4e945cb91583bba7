"""Write src/pinproof/_core.pyi, the types of the compiled core, from the signatures in the compiled module.

python scripts/core_stub.py            writes the stub
python scripts/core_stub.py --check    exit code 1 if the stub is not up to date
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

from generated_files import main
from nanobind.stubgen import StubGen

from pinproof import _core

STUB = Path(__file__).resolve().parents[1] / "src" / "pinproof" / "_core.pyi"
HEAD = '"""The compiled core, an extension module built from src/core. Written by scripts/core_stub.py."""\n'
ARGUMENT = re.compile(r"Annotated\[(NDArray\[numpy\.\w+\]), dict\([^()]*(?:\([^()]*\)[^()]*)*\)\]")
"""An array with its shape and memory layout, which mypy cannot check."""


def stub_text() -> str:
    """The stub without docstrings, not formatted. Results that the core declares as objects are arrays."""
    generator = StubGen(_core, include_docstrings=False)
    generator.put(_core)
    lines = [_line(ARGUMENT.sub(r"\1", line)) for line in generator.get().splitlines()]
    stated = [line for line in lines if line.startswith(("from ", "import "))]
    body = "\n".join(line for line in lines if line not in stated)
    body = re.sub(r"\bCallable\b(?!\[)", "Callable[..., Any]", body)
    return f"{HEAD}\n{_imports([*stated, 'from typing import Any'], body)}\n{body}\n"


def _imports(stated: list[str], body: str) -> str:
    """The imports of the names that occur in the body, sorted."""
    plain, names = set(), defaultdict[str, set[str]](set)
    for line in stated:
        words = line.replace(",", " ").split()
        if words[0] == "import":
            plain.add(words[1])
        else:
            names[words[1]].update(name for name in words[3:] if re.search(rf"\b{name}\b", body))
    known = {module: f"import {module}" for module in plain}
    known |= {module: f"from {module} import {', '.join(sorted(each))}" for module, each in names.items() if each}
    own = [line for module, line in sorted(known.items()) if not module.startswith("numpy")]
    own.sort(key=lambda line: line.startswith("from"))
    numpy = [line for module, line in sorted(known.items()) if module.startswith("numpy")]
    return "\n".join([*own, "", *numpy]) + "\n"


def _line(line: str) -> str:
    """The line with arrays in place of objects in the type of a result, and any elements of plain containers."""
    head, arrow, result = line.rpartition(" -> ")
    if not arrow:
        return line
    result = re.sub(r"\bobject\b", "NDArray[Any]", result)
    result = re.sub(r"\bdict\b(?!\[)", "dict[str, Any]", result)
    result = re.sub(r"\btuple\b(?!\[)", "tuple[Any, ...]", re.sub(r"\blist\b(?!\[)", "list[Any]", result))
    return f"{head}{arrow}{result}"


def formatted_stub() -> str:
    """The stub as ruff formats it."""
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(STUB), "-"]
    return subprocess.run(command, input=stub_text(), capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    main(__doc__, lambda: {STUB: formatted_stub()})
