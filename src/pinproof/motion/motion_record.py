"""Records in a motion file that state the setup with which the motion was certified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from pinproof.errors import InputError


@dataclass(frozen=True)
class MotionRecord:
    """The setup with which a motion, or a part of it, was certified.

    A record is not a proof. It allows a later certification to detect differences of the setup. A proof that can be
    verified independently is written by :meth:`pinproof.Certificate.save`.

    Parameters
    ----------
    name
        The name of the part, such as ``"transit"``; ``"motion"`` if there is only one.
    start, end
        Start and end time of the part in seconds from the start of the trajectory.
    status
        The status of the certificate: ``"FREE"``, ``"COLLIDING"``, ``"VIOLATED"`` or ``"UNDECIDED"``.
    clearance
        The proven clearance (m); None if no clearance was proven or no obstacle exists.
    margin
        The required distance (m) between any two bodies.
    pairs
        Number of pairs of bodies that were checked.
    curve, setup
        Hashes of the certified curve, and of the arm, the scene and the attached bodies.
    attached
        The bodies attached to the tcp: a hash of shape and pose by name.
    held
        Values (rad or m) of the joints outside the arm, by name.
    obstacles
        The names of the obstacles of the scene.
    constraints
        The constraints of the tcp that were certified, each as a text with all its numbers.
    """

    name: str
    start: float
    end: float
    status: str
    clearance: float | None
    margin: float
    pairs: int
    curve: str
    setup: str
    attached: Mapping[str, str] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    obstacles: tuple[str, ...] = ()
    constraints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ("attached", "held"):
            object.__setattr__(self, key, dict(getattr(self, key)))
        for key in ("obstacles", "constraints"):
            object.__setattr__(self, key, tuple(getattr(self, key)))

    def to_dict(self) -> dict[str, Any]:
        """The record as a dictionary for JSON."""
        lists = {"obstacles": list(self.obstacles), "constraints": list(self.constraints)}
        return {**asdict(self), **lists}

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
