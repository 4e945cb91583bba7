"""Conversion of a DH table to a URDF, whose forward kinematics are compared with those of the table."""

from __future__ import annotations

from pathlib import Path

from pinproof.common.files import write_text_whole
from pinproof.common.validation import require_type
from pinproof.description.dh import DhTable
from pinproof.description.dh_urdf import urdf_of_table
from pinproof.model.dh_proof import prove_urdf_equals_table


def dh_to_urdf(table: DhTable) -> str:
    """Convert a DH table to a URDF and verify that both have the same forward kinematics.

    Parameters
    ----------
    table
        The arm. The root ``base_link`` is the frame in which ``table.base`` is given; the tcp is ``tool0``.

    Returns
    -------
    str
        URDF XML, deterministic. :mod:`pinproof.description.dh_urdf` describes the generated bodies.

    Raises
    ------
    ConversionError
        If the forward kinematics of the URDF, computed by Pinocchio, differ from the product of the DH matrices by more
        than 1e-12 m or 1e-12 rad at a frame dh_0 ... dh_n or at the tool.
    InputError
        If a row has a name that is reserved for a link or joint of the URDF.
    """
    require_type("table", table, DhTable)
    text = urdf_of_table(table)
    prove_urdf_equals_table(table, text)
    return text


def write_urdf(table: DhTable, path: str | Path) -> None:
    """Write the URDF of a DH table (:func:`dh_to_urdf`) atomically to a file.

    Raises
    ------
    ConversionError, InputError
        As :func:`dh_to_urdf`; no file is written.
    FileError
        If the file cannot be written.
    """
    write_text_whole(path, dh_to_urdf(table))
