"""``pinproof dh2urdf`` and ``pinproof urdf2dh``: convert between DH tables and URDF files."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result
from pinproof.cli.options import ChainOptions, Json, Robot


class Convention(str, Enum):
    """The two conventions of Denavit-Hartenberg parameters."""

    STANDARD = "standard"
    MODIFIED = "modified"


def dh2urdf(
    table: Annotated[Path, typer.Argument(help="A DH table (.yaml, .csv).", metavar="TABLE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The URDF file to write.")],
    as_json: Json = False,
) -> None:
    """Convert a DH table to a URDF file.

    The file is written only if all frames of the URDF agree with the table.

    Example: pinproof dh2urdf robots/generic_6dof/dh.yaml -o generic_6dof.urdf
    """
    check_output_files([output], [table])
    rows = pp.DhTable.load(table)
    pp.write_urdf(rows, output)
    data = {"urdf": str(output), "robot": rows.name, "joints": list(rows.joint_names)}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} joints; all frames agree with the table"
    print_result(data, [line], as_json=as_json)


def urdf2dh(
    robot: Robot,
    output: Annotated[Path, typer.Option("-o", "--output", help="The DH table to write (.yaml, .csv).")],
    convention: Annotated[Convention, typer.Option(help="Convention of the table.")] = Convention.STANDARD,
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Compute the DH table of an arm.

    The command fails if no table describes the arm exactly.

    Example: pinproof urdf2dh ur5 -o ur5.yaml
    """
    check_output_files([output], [robot, *chain.files])
    arm = chain.arm(robot)
    rows = pp.urdf_to_dh(arm, convention=convention.value)
    rows.save(output)
    data = {"table": str(output), "robot": rows.name, "joints": list(rows.joint_names)}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} rows ({convention.value} convention)"
    print_result(data, [line], as_json=as_json)
