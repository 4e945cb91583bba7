"""``pinproof dh2urdf`` and ``pinproof urdf2dh``: convert between DH tables and URDF files."""

from __future__ import annotations

from dataclasses import MISSING
from enum import Enum
from pathlib import Path

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result
from pinproof.cli.options import ChainOptions, Json, Robot, argument, option


class Convention(str, Enum):
    """The two conventions of Denavit-Hartenberg parameters."""

    STANDARD = "standard"
    MODIFIED = "modified"


def dh2urdf(
    table: Path = argument("A DH table (.yaml, .csv).", MISSING, metavar="TABLE"),
    output: Path = option("The URDF file to write.", MISSING, "-o", "--output"),
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
    output: Path = option("The DH table to write (.yaml, .csv).", MISSING, "-o", "--output"),
    convention: Convention = option("Convention of the table.", Convention.STANDARD),
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
