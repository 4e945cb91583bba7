"""Print the hash of the sources of src/pinproof/viewer/core.wasm, without comments and blank lines."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

CORE = Path(__file__).parents[1] / "src" / "core"
FOLDERS = ("algebra", "closed_form", "collision", "common", "geometry", "ik", "kinematics", "web")


def hash_of_sources() -> str:
    """The hash of the files that the module is compiled from, and of the script that compiles it."""
    digest = hashlib.sha256()
    files = [CORE.parents[1] / "scripts" / "build_wasm"]
    files += [path for folder in FOLDERS for path in (CORE / folder).iterdir() if path.suffix in (".cpp", ".h")]
    for path in sorted(files):
        text = re.sub(r"\s*//[^\n]*", "", path.read_text(encoding="utf-8"))
        digest.update(f"{path.name}\n{' '.join(text.split())}\n".encode())
    return digest.hexdigest()


if __name__ == "__main__":
    print(hash_of_sources())
