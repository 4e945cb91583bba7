"""KRL of KUKA: ``PTP``, ``LIN``, ``$OUT`` and ``WAIT SEC``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.errors import InputError
from pinproof.motion.dialects.dialect import NUMBER, Body, Dialect, LineReader, in_degrees, numbers_of
from pinproof.motion.program_steps import Blend, JointMove, LinearMove, SetOutput, Step, Wait
from pinproof.spatial import pose, xyz_rpy

APPROXIMATION = 50
"""Per cent of half a move that the blend may use (``$APO.CPTP``)."""

LINE_SPEED = 0.1
"""m/s of linear moves."""

SPEED = 30
"""Per cent of the axis velocities; KRL states no durations of moves."""


class Krl(Dialect):
    """KRL; ``C_PTP`` blends a point within ``$APO.CPTP`` per cent of half a move."""

    name = "krl"
    endings = (".src",)
    comment_mark = "; pinproof:"
    outputs = "1"
    blend = Blend(share=APPROXIMATION / 200)
    deviation = 0.002

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        lines = ["  BAS(#INITMOV,0)", f"  BAS(#VEL_PTP,{SPEED})", f"  $APO.CPTP={APPROXIMATION}"]
        if any(isinstance(step, LinearMove) for step in steps):
            lines.insert(2, f"  BAS(#VEL_CP,{LINE_SPEED})")
        lines += [f"  {_written(step)}" for step in steps]
        return [f"DEF {name}()"], lines, ["END"]

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """See :meth:`Dialect.read`."""
        share = Blend().share

        def approximation(found: re.Match[str], _: int) -> None:
            nonlocal share
            if not 0 < float(found[1]) <= 100:
                raise ValueError("$APO.CPTP must be above 0 and at most 100")
            share = float(found[1]) / 200

        def move(found: re.Match[str], line: int) -> Step:
            axes = re.findall(r"([AE]\d+) ", found[1])
            if axes != [f"A{i}" for i in range(1, joints + 1)]:
                raise ValueError(f"has the axes {', '.join(axes)}; needed are A1 to A{joints}, in order")
            values = numbers_of(re.sub(r"A\d+ ", "", found[1]), joints)
            return JointMove(np.deg2rad(values), None, Blend(share=share) if found[2] else None, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            x, y, z, a, b, c = numbers_of(",".join(found.groups()), 6)
            place = pose((x / 1000, y / 1000, z / 1000), tuple(np.deg2rad([c, b, a]).tolist()))
            return LinearMove(None, place, None, line)

        frame = ",".join(rf"{key} ({NUMBER})" for key in "XYZABC")
        rules = [
            (rf"LIN \{{{frame}\}}", line_to),
            (r"DEF \w+\(\)|END|BAS\(#INITMOV,0\)|BAS\(#VEL_PTP,\d+\)|BAS\(#VEL_CP,[\d.]+\)", lambda _, __: None),
            (rf"\$APO\.CPTP=({NUMBER})", approximation),
            (r"PTP \{([^}]*)\}( C_PTP)?", move),
            (r"\$OUT\[(\d+)\]=(TRUE|FALSE)", lambda found, line: SetOutput(found[1], found[2] == "TRUE", line)),
            (rf"WAIT SEC ({NUMBER})", lambda found, line: Wait(float(found[1]), line)),
        ]
        return LineReader(
            source,
            rules,
            "PTP {A1 .., ..} [C_PTP], LIN {X .., Y .., Z .., A .., B .., C ..}, $APO.CPTP, $OUT[n], WAIT SEC",
        ).read(body)


def _written(step: Step) -> str:
    if isinstance(step, JointMove):
        axes = ",".join(f"A{i} {value}" for i, value in enumerate(in_degrees(step.q, 4), 1))
        return f"PTP {{{axes}}}{' C_PTP' if step.blend is not None else ''}"
    if isinstance(step, LinearMove) and step.pose is not None:
        x, y, z, *rpy = xyz_rpy(step.pose)
        numbers = [f"{1000 * length + 0.0:.4f}" for length in (x, y, z)] + in_degrees(np.array(rpy[::-1]), 5)
        return f"LIN {{{','.join(f'{key} {number}' for key, number in zip('XYZABC', numbers, strict=True))}}}"
    if isinstance(step, SetOutput):
        if not step.output.isdigit() or int(step.output) < 1:
            raise InputError(f"output {step.output!r}: krl has digital outputs with numbers from 1")
        return f"$OUT[{step.output}]={'TRUE' if step.on else 'FALSE'}"
    if isinstance(step, Wait):
        return f"WAIT SEC {step.seconds:.4f}"
    raise InputError("krl programs of pinproof contain moves, outputs and waiting times; set points need RSI")
