"""Why an arm has no closed form, and what to use instead."""

from __future__ import annotations

from pinproof.ik.analytic.geometry import find_triples, lines_of, size_of
from pinproof.model import Arm

__all__ = ["why_not"]


def why_not(arm: Arm, tried: bool) -> str:
    """The reason in words; ``tried`` if a triple exists, but poses were not found again by it."""
    if arm.dof > 7:
        return (
            f"no closed form: {arm.dof} joints are {arm.dof - 6} more than a pose needs, and only one can be swept; "
            "hold joints still (robot.arm with another base or tcp), or use Clik"
        )
    if tried:
        return (
            "no closed form: three of the axes meet or are parallel, but with the others they do not tell a pose's "
            "joints apart (the arm loses a direction everywhere); use Clik"
        )
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    nearest = sorted(find_triples(lines, size, float("inf")), key=lambda triple: triple.miss)
    text = "no three neighbouring axes meet in one point, are parallel, or move in one plane"
    if nearest:
        best = nearest[0]
        names = ", ".join(arm.joint_names[line.own] for line in best.lines)
        amount = f"{best.miss:.3g} rad" if best.planar else f"{best.miss * size:.3g} m"
        what = "do not move in one plane" if best.planar else "do not meet in one point"
        text += f"; the nearest are those of {names}, which {what} by {amount}"
    if arm.dof < 6:
        text += ", nor can they be completed to such three"
    if arm.dof == 7:
        text += ", with one of the seven locked beside them"
    return f"no closed form: {text} (Pieper's condition); use Clik"
