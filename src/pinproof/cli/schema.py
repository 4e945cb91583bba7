"""``pinproof schema``: the JSON Schema of a file format."""

from __future__ import annotations

import json
from dataclasses import MISSING
from pathlib import Path

import pinproof as pp
from pinproof.cli.console import check_output_files, print_json, print_result, written
from pinproof.cli.options import Json, argument, option
from pinproof.common.files import write_text_whole
from pinproof.formats import FORMATS


def _formats(incomplete: str) -> list[str]:
    return [name for name in FORMATS if name.startswith(incomplete)]


def schema(
    name: str = argument(f"The format: {', '.join(FORMATS)}.", MISSING, metavar="FORMAT", autocompletion=_formats),
    output: Path | None = option("Write the schema to this file.", None, "-o", "--output"),
    as_json: Json = False,
) -> None:
    """Print the JSON Schema of a file format, with which an editor completes keys and marks errors.

    Example: pinproof schema picks -o picks.schema.json
    """
    check_output_files([output])
    found = pp.formats.file_schema(name)
    if output is None:
        print_json(found)
        return
    write_text_whole(output, json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    print_result({"schema": str(output)}, written(output), as_json=as_json)
