"""What the page says of each pick. FREE stands there only with a proof for exactly what is shown."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pinproof.collision import Scene
from pinproof.collision.certificate import proven_millimetres, setup_hash
from pinproof.model import Arm
from pinproof.picks.pick import Picks
from pinproof.picks.verdict import PickVerdict

__all__ = ["KINDS", "Kind", "entry", "without_more_details"]


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

DETAILS = ("stages", "motions", "refuted")

MOST_DETAILS = 2_000_000
"""Characters of what entries tell beside verdict, reason and figures: a page of thousands stays one that opens."""

PROVEN = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."


def entry(row: dict[str, Any], verdict: PickVerdict | None, arm: Arm, scene: Scene, picks: Picks) -> dict[str, Any]:
    """The row as the page's table and caption need it."""
    kind = row["verdict"]
    headline, tone, said = kind.upper(), kind.replace(" ", "-"), row.get("reason", "")
    if kind == "good" and verdict is None:
        said = "Judged good, with its motion proven. The rows of a campaign keep no motions, so none is played."
    elif kind == "good" and verdict is not None:
        if _proven(verdict, arm, scene, picks):
            headline, tone, said = "FREE", "free", PROVEN
        else:
            headline, tone = "NOT VALIDATED", "open"
            said = "The certificate belongs to another motion, arm, scene or tool than those of this page."
    clearance, duration = row.get("clearance_proven"), row.get("duration")
    proven = _proven_text(row)
    figures = {
        "Proven clearance": proven,
        "Duration": _seconds(duration),
        "Grasp at": _seconds(row.get("grasp_time")),
        "Let go at": _seconds(row.get("release_time")),
        "Grasp": ", ".join(f"{value:.3f}" for value in row["xyz"]) + " m" if "xyz" in row else "",
        "In the frame": row.get("frame", ""),
        "Member": row.get("member", ""),
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
        "motions": [[each["name"], _seconds(each["duration"]), _proven_text(each)] for each in row.get("motions", ())],
        "refuted": list(row.get("refuted", ())),
    }


def without_more_details(entries: Iterable[dict[str, Any]]) -> tuple[list[dict[str, Any]], int]:
    """Entries of which those behind :data:`MOST_DETAILS` lose their details, and how many those are."""
    kept, room, bare = [], MOST_DETAILS, 0
    for each in entries:
        room -= len(json.dumps([each[name] for name in DETAILS]))
        if room < 0:
            each, bare = {**each, **dict.fromkeys(DETAILS, ())}, bare + 1
        kept.append(each)
    return kept, bare


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} s"


def _proven_text(row: dict[str, Any]) -> str:
    """The clearance that a row, or a motion of it, is proven to keep; empty without a proof."""
    clearance = row.get("clearance_proven")
    if clearance is not None:
        return proven_millimetres(clearance)
    return "" if row.get("pairs_proven") is None else "unbounded"


def _proven(verdict: PickVerdict, arm: Arm, scene: Scene, picks: Picks) -> bool:
    """Whether the motion begins with this arm, tool and scene, and every part of it has a FREE certificate of its own.

    Of what stands around, the later parts may differ by what is carried alone.
    """
    motions = verdict.motions
    if not verdict.ok or not motions:
        return False
    first, own = motions[0], {thing.name for thing in picks.open_tool}
    if not first.certificate.matches(first.trajectory, arm, scene, picks.open_tool):
        return False
    carried = {thing.name for motion in motions for thing in motion.attached} - own
    around = _without(scene, carried, arm)
    return all(
        each.certificate.free
        and each.certificate.matches(each.trajectory, arm.with_held(each.held), each.scene, each.attached)
        and _without(each.scene, carried, arm) == around
        for each in motions
    )


def _without(scene: Scene, names: set[str], arm: Arm) -> str:
    """A hash of what stands around beside some things."""
    return setup_hash(arm, scene.remove(*names.intersection(scene.names)))
