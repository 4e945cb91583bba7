"""Records in a motion file that state the setup with which the motion was certified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Protocol

from pinproof.common.results import Written
from pinproof.common.structs import (
    ANY_TEXT,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    key,
    list_of,
    mapping_to,
    struct,
)
from pinproof.errors import InputError


@struct("record")
class MotionRecord(Written):
    """The setup with which a motion, or a part of it, was certified. A record is not a proof.

    Notes
    -----
    It allows a later certification to detect differences of the setup. A proof that can be verified independently is
    written by :meth:`pinproof.Certificate.save`.
    """

    name: str = key("name of the part, such as `transit`; `motion` if there is only one", kind=ANY_TEXT)
    start: float = key("start of the part from the start of the motion", "s", kind=PLAIN_NUMBER)
    end: float = key("end of the part", "s", kind=PLAIN_NUMBER)
    status: str = key("status of the certificate: `FREE`, `COLLIDING`, `VIOLATED` or `UNDECIDED`", kind=ANY_TEXT)
    clearance: Annotated[float | None, OPTIONAL_NUMBER] = key(
        "proven clearance; null if none was proven or no obstacle exists", "m"
    )
    margin: float = key("required distance between any two bodies", "m", kind=PLAIN_NUMBER)
    pairs: int = key("number of pairs of bodies that were checked")
    curve: str = key("hash of the certified curve", kind=ANY_TEXT)
    setup: str = key("hash of the arm, the scene and the attached bodies", kind=ANY_TEXT)
    attached: Mapping[str, str] = key(
        "the bodies attached to the tcp: a hash of shape and pose by name",
        default_factory=dict,
        required=True,
        kind=mapping_to(ANY_TEXT),
    )
    held: Mapping[str, float] = key(
        "values of joints outside the arm, by name",
        "rad or m",
        default_factory=dict,
        required=True,
        kind=mapping_to(PLAIN_NUMBER),
    )
    obstacles: tuple[str, ...] = key(
        "names of the obstacles of the scene", default=(), required=True, kind=list_of(ANY_TEXT)
    )
    constraints: tuple[str, ...] = key(
        "the certified constraints of the tcp, with all their numbers", default=(), kind=list_of(ANY_TEXT)
    )

    def same_setup(self, other: MotionRecord) -> bool:
        """Whether both were made with the same attached bodies, held joints, scene and margin."""
        return (self.setup, self.attached, self.held, self.margin) == (
            other.setup,
            other.attached,
            other.held,
            other.margin,
        )


class Certified(Protocol):
    """The attributes of a certificate that :meth:`pinproof.Trajectory.save` requires."""

    @property
    def curve(self) -> str:
        """The hash of the certified curve."""

    def motion_record(self, name: str = "motion", start: float = 0.0, end: float = 0.0) -> MotionRecord:
        """The record of the setup."""


def records_of(certificate: Certified, curve: str, duration: float) -> tuple[MotionRecord, ...]:
    """The record of a certificate for the complete curve with the given hash.

    Raises
    ------
    InputError
        If the certificate is for another curve.
    """
    if certificate.curve != curve:
        raise InputError("the certificate is for another motion; save the motion that was certified")
    return (certificate.motion_record(end=duration),)
