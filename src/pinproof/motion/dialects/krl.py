"""KRL of KUKA: ``PTP``, ``LIN``, ``$OUT`` and ``WAIT SEC``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.motion.dialects.dialect import (
    NAME,
    NUMBER,
    Blend,
    Dialect,
    JointMove,
    LinearMove,
    Rule,
    Step,
    in_degrees,
    numbers_of,
    positive,
)
from pinproof.spatial import pose, xyz_rpy

# Per cent of half a move that the blend may use (`$APO.CPTP`).
APPROXIMATION = 50
# m/s of linear moves, and the largest value of `BAS(#VEL_CP,..)`.
LINE_SPEED, FASTEST_LINE = 0.1, 3.0
# Per cent of the axis velocities; KRL states no durations of moves.
SPEED = 30


class Krl(Dialect):
    """KRL; ``C_PTP`` blends a point within ``$APO.CPTP`` per cent of half a move."""

    name = "krl"
    endings = (".src",)
    comment_mark = "; pinproof:"
    outputs = "1"
    blend = Blend(share=APPROXIMATION / 200)
    deviation = 0.002
    output_line, output_states = "$OUT[{}]={}", ("FALSE", "TRUE")
    wait_line = "WAIT SEC {:.4f}"
    opening, closing = (rf"DEF {NAME}\(\)",), ("END",)
    # It resets base, tool and approximation, so it is the first instruction and no later one.
    settings = (r"BAS\(#INITMOV,0\)",)
    ignored = r"BAS\(#VEL_PTP,(100|[1-9]\d?)\)"
    supported = "PTP {A1 .., ..} [C_PTP], LIN {X .., Y .., Z .., A .., B .., C ..}, $APO.CPTP, $OUT[n], WAIT SEC"
    contents = "moves, outputs and waiting times; set points need RSI"
    frame = ("DEF {}()",), ("END",)

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        before, lines, after = super().write(name, steps)
        speeds = ["  BAS(#INITMOV,0)", f"  BAS(#VEL_PTP,{SPEED})", f"  $APO.CPTP={APPROXIMATION}"]
        if any(isinstance(step, LinearMove) for step in steps):
            speeds.insert(2, f"  BAS(#VEL_CP,{LINE_SPEED})")
        return before, [*speeds, *lines], after

    def move(self, step: Step) -> str | None:
        """See :meth:`Dialect.move`."""
        if isinstance(step, JointMove):
            axes = ",".join(f"A{i} {value}" for i, value in enumerate(in_degrees(step.q, 4), 1))
            return f"PTP {{{axes}}}{' C_PTP' if step.blend is not None else ''}"
        if isinstance(step, LinearMove) and step.pose is not None:
            x, y, z, *rpy = xyz_rpy(step.pose)
            numbers = [f"{1000 * length + 0.0:.4f}" for length in (x, y, z)] + in_degrees(np.array(rpy[::-1]), 5)
            return f"LIN {{{','.join(f'{key} {number}' for key, number in zip('XYZABC', numbers, strict=True))}}}"
        return None

    def move_rules(self, joints: int) -> list[Rule]:
        """See :meth:`Dialect.move_rules`."""
        share, speed, moved = Blend().share, 0.0, False

        def approximation(found: re.Match[str], _: int) -> None:
            nonlocal share
            if moved:  # whether it holds for a blend that is not executed yet depends on the advance run
                raise ValueError("it must be before the first move")
            share = positive(found[1], largest=100.0) / 200

        def line_speed(found: re.Match[str], _: int) -> None:
            nonlocal speed
            speed = positive(found[1], largest=FASTEST_LINE)

        def move(found: re.Match[str], line: int) -> Step:
            nonlocal moved
            moved = True
            axes = [re.fullmatch(rf"A{i} +({NUMBER})", part.strip()) for i, part in enumerate(found[1].split(","), 1)]
            if len(axes) != joints or None in axes:
                raise ValueError(f"needed are A1 to A{joints} in order, each with one number, separated by commas")
            values = numbers_of(",".join(axis[1] for axis in axes if axis), joints)
            return JointMove(np.deg2rad(values), None, Blend(share=share) if found[2] else None, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            if not speed:
                raise ValueError("BAS(#VEL_CP,..) must be before it")
            x, y, z, a, b, c = numbers_of(",".join(found.groups()), 6)
            place = pose((x / 1000, y / 1000, z / 1000), tuple(np.deg2rad([c, b, a]).tolist()))
            return LinearMove(None, place, None, line, speed)

        frame = ",".join(rf"{key} ({NUMBER})" for key in "XYZABC")
        return [
            (rf"LIN \{{{frame}\}}", line_to),
            (rf"\$APO\.CPTP=({NUMBER})", approximation),
            (rf"BAS\(#VEL_CP,({NUMBER})\)", line_speed),
            (r"PTP \{([^}]*)\}( C_PTP)?", move),
        ]
