"""``pinproof dh2urdf`` and ``pinproof urdf2dh``: DH tables to URDF and back, each proven by forward kinematics."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.console import check_outputs, print_json, say
from pinproof.cli.options import Chain, Json, Robot

__all__ = ["dh2urdf", "urdf2dh"]


class Convention(str, Enum):
    """The two conventions of Denavit and Hartenberg's parameters."""

    STANDARD = "standard"
    MODIFIED = "modified"


def dh2urdf(
    table: Annotated[Path, typer.Argument(help="A DH table (.yaml, .csv).", metavar="TABLE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The URDF.")],
    as_json: Json = False,
) -> None:
    """Write a DH table as a URDF, if both are equal at every frame.

    Example: pinproof dh2urdf robots/generic_6dof/dh.yaml -o generic_6dof.urdf
    """
    check_outputs([output], [table])
    rows = pp.DhTable.load(table)
    pp.write_urdf(rows, output)
    if as_json:
        print_json({"urdf": str(output), "robot": rows.name, "joints": list(rows.joint_names)})
    else:
        say(f"wrote {output}: {rows.name}, {len(rows.joint_names)} joints, equal to the table at every frame")


def urdf2dh(
    robot: Robot,
    output: Annotated[Path, typer.Option("-o", "--output", help="The DH table (.yaml, .csv).")],
    convention: Annotated[Convention, typer.Option(help="Which convention the table is in.")] = Convention.STANDARD,
    *,
    chain: Chain,
    as_json: Json = False,
) -> None:
    """Recover the DH table of an arm, if it has one that is exact.

    Example: pinproof urdf2dh ur5 -o ur5.yaml
    """
    check_outputs([output], [robot, chain.srdf])
    arm = chain.arm(robot)
    rows = pp.urdf_to_dh(arm, convention=convention.value)
    rows.save(output)
    if as_json:
        print_json({"table": str(output), "robot": rows.name, "joints": list(rows.joint_names)})
    else:
        say(f"wrote {output}: {rows.name}, {len(rows.joint_names)} rows ({convention.value} convention)")
