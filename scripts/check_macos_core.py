#!/usr/bin/env python3
"""Check a core that was compiled for macOS.

python scripts/check_macos_core.py FILE arm64|x86_64 [VERSION]

The file must be a library for the processor, ask for no newer macOS than VERSION (11.0 by default), and link against
the system's libraries only. Its undefined symbols must come from these, or be Python's and exist in this Python.
Mach-O is described by Apple's mach-o/loader.h. scripts/cross_compile calls this after linking.
"""

from __future__ import annotations

import ctypes
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

MAGIC, KINDS = 0xFEEDFACF, (6, 8)  # 64 bits, little-endian; a dynamic library or a bundle
PROCESSORS = {0x0100000C: "arm64", 0x01000007: "x86_64"}
LOAD_DYLIB, LOAD_WEAK_DYLIB, VERSION_MIN, BUILD_VERSION, DYLD_INFO, SIGNATURE = (
    0xC,
    0x80000018,
    0x24,
    0x32,
    0x80000022,
    0x1D,
)
ORDINAL, LONG_ORDINAL, SPECIAL_ORDINAL, SYMBOL, DO_BIND = 0x10, 0x20, 0x30, 0x40, range(0x90, 0xD0, 0x10)
NUMBERS = {0x20: 1, 0x60: 1, 0x70: 1, 0x80: 1, 0xA0: 1, 0xC0: 2}  # how many numbers follow an instruction
LOOKUP = -2  # the ordinal of a symbol that is looked up in all loaded images, as those of Python are
SYSTEM = ("/usr/lib/libSystem.", "/usr/lib/libc++.", "/usr/lib/libobjc.", "/System/Library/Frameworks/")


@dataclass(frozen=True)
class MachObject:
    """What the load commands of a Mach-O file state."""

    processor: str
    kind: int
    minimum: tuple[int, int] | None
    libraries: tuple[str, ...]
    signed: bool
    undefined: dict[str, str]
    """The symbols that dyld binds, each with the library that has it; "" if it is looked up in all loaded images."""


def bindings(code: bytes) -> Iterator[tuple[str, int]]:
    """The symbols that instructions for dyld bind, with the ordinals of their libraries."""
    at, name, ordinal = 0, "", 0
    while at < len(code):
        instruction, value = code[at] & 0xF0, code[at] & 0x0F
        at += 1
        if instruction == SYMBOL:
            end = code.index(b"\0", at)
            name, at = code[at:end].decode(), end + 1
        number = value
        for _ in range(NUMBERS.get(instruction, 0)):
            number = shift = 0
            while True:
                number |= (code[at] & 0x7F) << shift
                shift, at = shift + 7, at + 1
                if not code[at - 1] & 0x80:
                    break
        if instruction in (ORDINAL, LONG_ORDINAL):
            ordinal = number
        elif instruction == SPECIAL_ORDINAL:
            ordinal = value - 16 if value else 0
        elif instruction in DO_BIND:
            yield name, ordinal


def read_macho(data: bytes) -> MachObject:
    """Read a Mach-O file for one 64-bit processor."""
    if len(data) < 32 or struct.unpack_from("<I", data)[0] != MAGIC:
        raise ValueError("not a 64-bit Mach-O file")
    _, processor, _, kind, commands, *_ = struct.unpack_from("<8I", data)
    minimum, libraries, bound, signed, at = None, [], {}, False, 32
    for _ in range(commands):
        command, size = struct.unpack_from("<2I", data, at)
        if command in (LOAD_DYLIB, LOAD_WEAK_DYLIB):
            start = at + struct.unpack_from("<I", data, at + 8)[0]
            libraries.append(data[start : at + size].split(b"\0")[0].decode())
        elif command in (BUILD_VERSION, VERSION_MIN):
            (version,) = struct.unpack_from("<I", data, at + (12 if command == BUILD_VERSION else 8))
            minimum = version >> 16, version >> 8 & 0xFF
        elif command == SIGNATURE:
            signed = True
        elif command == DYLD_INFO:  # symbols that are bound at once, weak ones of C++, and those at their first call
            _, _, start, length, _, _, lazy_start, lazy_length = struct.unpack_from("<8I", data, at + 8)
            bound.update(bindings(data[start : start + length]))
            bound.update(bindings(data[lazy_start : lazy_start + lazy_length]))
        at += size
    undefined = {
        name: "" if ordinal == LOOKUP else libraries[ordinal - 1] if ordinal > 0 else f"library {ordinal}"
        for name, ordinal in bound.items()
    }
    return MachObject(PROCESSORS.get(processor, hex(processor)), kind, minimum, tuple(libraries), signed, undefined)


def faults(core: MachObject, processor: str, newest: tuple[int, int]) -> list[str]:
    """What is wrong with a core, one line each."""
    wrong = []
    if core.processor != processor:
        wrong.append(f"it is for {core.processor}, not {processor}")
    if core.kind not in KINDS:
        wrong.append(f"its file type is {core.kind}, not that of a library or a bundle")
    if core.minimum is None or core.minimum > newest:
        wrong.append(f"it asks for macOS {core.minimum}, newer than {newest}")
    if processor == "arm64" and not core.signed:
        wrong.append("it has no signature, without which macOS on arm64 loads no code")
    wrong += [f"it links against {name}" for name in core.libraries if not name.startswith(SYSTEM)]
    for name, library in core.undefined.items():
        if library and (library not in core.libraries or name.startswith(("_Py", "__Py"))):
            wrong.append(f"{name} is looked up in {library}")
        elif not library and not (name.startswith(("_Py", "__Py")) and hasattr(ctypes.pythonapi, name[1:])):
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
