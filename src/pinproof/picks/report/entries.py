"""What the page says of each pick. FREE stands there only with a proof for exactly what is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pinproof.collision import CertificateStatus, Obstacle, Scene
from pinproof.collision.certificate import proven_millimetres
from pinproof.model import Arm
from pinproof.picks.report.rows import proofs
from pinproof.picks.verdict import PickVerdict

__all__ = ["KINDS", "Kind", "entry"]


@dataclass(frozen=True)
class Kind:
    """A kind of verdict: its colour, and what it means in a sentence."""

    css: str
    means: str

    @property
    def rgb(self) -> tuple[float, float, float]:
        """0 to 1 each."""
        r, g, b = (int(self.css[k : k + 2], 16) / 255 for k in (1, 3, 5))
        return r, g, b


KINDS = {
    "good": Kind("#0b7a43", "Every stage is passed, and the motion is proven."),
    "impossible": Kind("#b3191f", "Every configuration was enumerated, and each is refuted."),
    "not found": Kind("#c05a00", "No way was found within the budget; there may be one."),
    "unreadable": Kind("#5b6673", "The row could not be read."),
    "crashed": Kind("#7a2aa3", "The pick could not be judged."),
}

PROVEN = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."


def entry(
    row: dict[str, Any], verdict: PickVerdict | None, arm: Arm, scene: Scene, tool: Sequence[Obstacle]
) -> dict[str, Any]:
    """The row as the page's table and caption need it."""
    kind = row["verdict"]
    headline, tone, said = kind.upper(), kind.replace(" ", "-"), row.get("reason", "")
    if kind == "good" and verdict is None:
        said = "Judged good, with its motion proven. The rows of a campaign keep no motions, so none is played."
    elif kind == "good" and verdict is not None:
        if _proven(verdict, arm, scene, tool):
            headline, tone, said = "FREE", "free", PROVEN
        else:
            headline, tone = "NOT VALIDATED", "open"
            said = "The certificate belongs to another motion, arm, scene or tool than those of this page."
    clearance, duration, grasp_time = row.get("clearance_proven"), row.get("duration"), row.get("grasp_time")
    proven = ""
    if clearance is not None:
        proven = proven_millimetres(clearance)
    elif row.get("pairs_proven") is not None:
        proven = "unbounded"
    figures = {
        "Proven clearance": proven,
        "Duration": "" if duration is None else f"{duration:.2f} s",
        "Grasp at": "" if grasp_time is None else f"{grasp_time:.2f} s",
        "Grasp": ", ".join(f"{value:.3f}" for value in row["xyz"]) + " m" if "xyz" in row else "",
    }
    return {
        "name": row["name"],
        "verdict": kind,
        "failed": row.get("failed_at") or "",
        "clearance": clearance,
        "clearanceText": proven,
        "duration": duration,
        "reason": row.get("reason", ""),
        "remedy": row.get("remedy", ""),
        "headline": headline,
        "tone": tone,
        "said": said,
        "figures": [[name, text] for name, text in figures.items() if text],
        "stages": [[stage["stage"], stage["ok"], stage["message"]] for stage in row.get("stages", ())],
    }


def _proven(verdict: PickVerdict, arm: Arm, scene: Scene, tool: Sequence[Obstacle]) -> bool:
    """Whether every part of the motion has a FREE certificate of its own, made for this arm in this scene."""
    if not verdict.ok or any(each.status is not CertificateStatus.FREE for each in proofs(verdict)):
        return False
    motions = getattr(verdict, "motions", ())
    if motions:
        return all(
            each.certificate.matches(each.trajectory, arm.with_held(each.held), each.scene, each.attached)
            for each in motions
        )
    certificate, trajectory = verdict.certificate, verdict.trajectory
    return certificate is not None and trajectory is not None and certificate.matches(trajectory, arm, scene, tool)
