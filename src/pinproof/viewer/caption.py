"""What the page says about its motion. FREE stands there only with a proof for exactly what is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from pinproof.collision import Certificate, CertificateStatus, CheckResult, FirstContact, Obstacle, Scene, UndecidedSpan
from pinproof.collision.certificate import proven_millimetres
from pinproof.model import Arm
from pinproof.motion import Trajectory

__all__ = ["Caption", "caption"]

UNPROVEN = "NOT VALIDATED"

BRIEF = ("Proven clearance", "Duration")
"""Figures that are told in one line too."""


@dataclass(frozen=True)
class Caption:
    """A headline, why, and figures.

    Parameters
    ----------
    headline
        ``FREE``, or ``NOT VALIDATED``.
    reason
        One sentence; why it is not validated, or what was proven.
    tone
        ``free``, ``colliding``, ``open`` or ``still``: how it is coloured.
    figures
        (name, value) pairs.
    left_out
        What the proof did not look at, and why.
    contact
        The contact that the picture marks.
    legend
        What the colours of drawn points mean: (text, (r, g, b)) pairs.
    """

    headline: str
    reason: str
    tone: str
    figures: tuple[tuple[str, str], ...]
    left_out: tuple[str, ...] = ()
    contact: FirstContact | None = None
    legend: tuple[tuple[str, tuple[float, float, float]], ...] = ()

    def html(self, notes: Sequence[str] = ()) -> str:
        """As HTML; every text is escaped."""
        rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in self.figures)
        remarks = f'<ul class="notes" aria-label="Remarks about the picture">{_items(notes)}</ul>' if notes else ""
        count = len(self.left_out)
        summary = f"{count} pair{'' if count == 1 else 's'} left out of the proof"
        left_out = f"<details><summary>{summary}</summary><ul>{_items(self.left_out)}</ul></details>" if count else ""
        return (
            f'<p class="verdict {escape(self.tone)}" id="verdict">{escape(self.headline)}</p>'
            f'<p id="reason">{escape(self.reason)}</p><dl>{rows}</dl>{self._legend()}{left_out}{remarks}'
        )

    @property
    def brief(self) -> tuple[str, ...]:
        """What there is to say in one line: the headline, unless there was nothing to prove, and the main figures."""
        figures = tuple(f"{name.lower()} {value}" for name, value in self.figures if name in BRIEF)
        return figures if self.tone == "still" else (self.headline, *figures)

    def _legend(self) -> str:
        items = "".join(
            f'<li><span class="swatch" style="background:rgb({r * 255:.0f},{g * 255:.0f},{b * 255:.0f})"></span>'
            f"{escape(text)}</li>"
            for text, (r, g, b) in self.legend
        )
        return f'<ul class="legend" aria-label="What the colours mean">{items}</ul>' if items else ""


def caption(
    arm: Arm,
    scene: Scene | None,
    motion: Trajectory | None,
    certificate: Certificate | None,
    attached: Sequence[Obstacle] = (),
    check: CheckResult | None = None,
) -> Caption:
    """The caption of a motion of an arm in a scene; ``motion`` None is a still picture, of which ``check`` may tell."""
    figures = [("Robot", arm.robot.name), ("Base to tcp", f"{arm.base} \u2192 {arm.tcp}")]
    if motion is None:
        return _still(check, figures)
    duration = ("Duration", f"{motion.duration:.2f} s")
    if certificate is None:
        return _open("No certificate was given for this motion.", [*figures, duration])
    if not certificate.matches(motion, arm, Scene() if scene is None else scene, attached):
        return _open("The certificate given belongs to another motion, arm, scene or tool.", [*figures, duration])
    if certificate.status is CertificateStatus.FREE:
        proof = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."
        clearance = ("Proven clearance", proven_millimetres(certificate.clearance))
        left_out = tuple(f"{' and '.join(pair.owners)}: {pair.reason}" for pair in certificate.excluded)
        contact = "Ends in contact; told of the motion run backwards" if certificate.backwards else "Begins in contact"
        leaves = tuple((contact, str(parting)) for parting in certificate.partings)
        return Caption("FREE", proof, "free", (*figures, clearance, duration, *leaves), left_out)
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        reason = _contact(certificate.first_contact, certificate.margin)
        return Caption(UNPROVEN, reason, "colliding", (*figures, duration), contact=certificate.first_contact)
    return _open(_undecided(certificate.undecided), [*figures, duration])


def _still(check: CheckResult | None, figures: Sequence[tuple[str, str]]) -> Caption:
    if check is None:
        return Caption(
            UNPROVEN, "A still picture: there is no motion that could have been proven.", "still", (*figures,)
        )
    if check.free:
        reason = "The check that was given found no contact here; what lies around this picture is not proven."
        return Caption(UNPROVEN, reason, "still", (*figures,))
    first, more = check.contacts[0], len(check.contacts) - 1
    reason = f"{first}{f', and {more} more' if more else ''}. Red balls mark the places, arrows the normals."
    return Caption("IN CONTACT", reason, "colliding", (*figures, ("Contacts", str(len(check.contacts)))))


def _open(reason: str, figures: Sequence[tuple[str, str]]) -> Caption:
    return Caption(UNPROVEN, reason, "open", tuple(figures))


def _contact(contact: FirstContact, margin: float) -> str:
    one, other = contact.bodies
    how = f"{one} touches {other}" if contact.penetrating else f"{one} comes within {margin * 1e3:g} mm of {other}"
    return f"Colliding: {how} at {contact.time:.3f} s. The red ball marks the place, the two bodies are red."


def _undecided(span: UndecidedSpan | None) -> str:
    said = "Undecided: neither contact nor freedom could be proven"
    if span is None:
        return f"{said}."
    return f"{said}: {span.bodies[0]} and {span.bodies[1]} between {span.start:.3f} and {span.end:.3f} s."


def _items(texts: Sequence[str]) -> str:
    return "".join(f"<li>{escape(text)}</li>" for text in texts)
