#!/usr/bin/env python3
"""Check a core that was compiled for macOS.

python scripts/check_macos_core.py FILE arm64|x86_64 [VERSION]

The file must be a library for the processor, ask for no newer macOS than VERSION (11.0 by default), and link against
the system's libraries only. Its undefined symbols must come from these, or be Python's and exist in this Python.
Mach-O is described by Apple's mach-o/loader.h and mach-o/nlist.h. scripts/cross_compile calls this after linking.
"""

from __future__ import annotations

import ctypes
import struct
import sys
from dataclasses import dataclass
from pathlib import Path

MAGIC, BUNDLE = 0xFEEDFACF, (6, 8)  # 64 bits, little-endian; a dynamic library or a bundle
PROCESSORS = {0x0100000C: "arm64", 0x01000007: "x86_64"}
SYMTAB, LOAD_DYLIB, LOAD_WEAK_DYLIB, VERSION_MIN, BUILD_VERSION = 0x2, 0xC, 0x80000018, 0x24, 0x32
STABBED, KIND, EXTERNAL, UNDEFINED = 0xE0, 0x0E, 0x01, 0x00
LOOKUP = 0xFE  # the ordinal of a symbol that is looked up in all loaded images, as those of Python are
SYSTEM = ("/usr/lib/libSystem.", "/usr/lib/libc++.", "/usr/lib/libobjc.", "/System/Library/Frameworks/")


@dataclass(frozen=True)
class MachObject:
    """What the load commands of a Mach-O file state."""

    processor: str
    kind: int
    minimum: tuple[int, int] | None
    libraries: tuple[str, ...]
    undefined: dict[str, str]
    """The undefined symbols, each with the library that has it; "" if it is looked up in all loaded images."""


def read_macho(data: bytes) -> MachObject:
    """Read a Mach-O file for one 64-bit processor."""
    if len(data) < 32 or struct.unpack_from("<I", data)[0] != MAGIC:
        raise ValueError("not a 64-bit Mach-O file")
    _, processor, _, kind, commands, *_ = struct.unpack_from("<8I", data)
    minimum, libraries, symbols, at = None, [], (0, 0, 0), 32
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", data, at)
        if command in (LOAD_DYLIB, LOAD_WEAK_DYLIB):
            start = at + struct.unpack_from("<I", data, at + 8)[0]
            libraries.append(data[start : at + size].split(b"\0")[0].decode())
        elif command in (BUILD_VERSION, VERSION_MIN):
            (version,) = struct.unpack_from("<I", data, at + (12 if command == BUILD_VERSION else 8))
            minimum = version >> 16, version >> 8 & 0xFF
        elif command == SYMTAB:
            symbols = struct.unpack_from("<3I", data, at + 8)
        at += size
    first, count, strings = symbols
    undefined = {}
    for k in range(count):
        name_at, what, _, description, _ = struct.unpack_from("<IBBHQ", data, first + 16 * k)
        if what & STABBED or what & KIND != UNDEFINED or not what & EXTERNAL:
            continue
        name = data[strings + name_at : data.index(b"\0", strings + name_at)].decode()
        ordinal = description >> 8
        undefined[name] = "" if ordinal == LOOKUP else libraries[ordinal - 1]
    return MachObject(PROCESSORS.get(processor, hex(processor)), kind, minimum, tuple(libraries), undefined)


def faults(core: MachObject, processor: str, newest: tuple[int, int]) -> list[str]:
    """What is wrong with a core, one line each."""
    wrong = []
    if core.processor != processor:
        wrong.append(f"it is for {core.processor}, not {processor}")
    if core.kind not in BUNDLE:
        wrong.append(f"its file type is {core.kind}, not that of a library or a bundle")
    if core.minimum is None or core.minimum > newest:
        wrong.append(f"it asks for macOS {core.minimum}, newer than {newest}")
    wrong += [f"it links against {name}" for name in core.libraries if not name.startswith(SYSTEM)]
    for name, library in core.undefined.items():
        if not library and not (name.startswith(("_Py", "__Py")) and hasattr(ctypes.pythonapi, name[1:])):
            wrong.append(f"{name} is neither Python's nor a library's")
    if "_PyModule_Create2" not in core.undefined and "_PyModuleDef_Init" not in core.undefined:
        wrong.append("it creates no Python module")
    return wrong


def main(file: str, processor: str, newest: str = "11.0") -> int:
    """Print what a file asks for, and return 1 if that is wrong."""
    core = read_macho(Path(file).read_bytes())
    major, minor = map(int, newest.split("."))
    of_python = [name for name, library in core.undefined.items() if not library]
    print(f"{file}: {core.processor}, macOS {core.minimum} or newer, libraries {', '.join(core.libraries)}")
    print(f"{len(of_python)} undefined symbols of Python, {len(core.undefined) - len(of_python)} of these libraries")
    wrong = faults(core, processor, (major, minor))
    print(*wrong, sep="\n", end="\n" if wrong else "")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
