"""KRL of KUKA: ``PTP``, ``$OUT`` and ``WAIT SEC``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.errors import InputError
from pinproof.motion.dialects.dialect import NUMBER, Body, Dialect, LineReader, in_degrees, numbers_of
from pinproof.motion.program_steps import Blend, JointMove, SetOutput, Step, Wait

__all__ = ["Krl"]

APPROXIMATION = 50
"""Per cent of half a move that the blend may use (``$APO.CPTP``)."""

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

        rules = [
            (r"DEF \w+\(\)|END|BAS\(#INITMOV,0\)|BAS\(#VEL_PTP,\d+\)", lambda _, __: None),
            (rf"\$APO\.CPTP=({NUMBER})", approximation),
            (r"PTP \{([^}]*)\}( C_PTP)?", move),
            (r"\$OUT\[(\d+)\]=(TRUE|FALSE)", lambda found, line: SetOutput(found[1], found[2] == "TRUE", line)),
            (rf"WAIT SEC ({NUMBER})", lambda found, line: Wait(float(found[1]), line)),
        ]
        return LineReader(source, rules, "PTP {A1 .., ..} [C_PTP], $APO.CPTP, $OUT[n], WAIT SEC").read(body)


def _written(step: Step) -> str:
    if isinstance(step, JointMove):
        axes = ",".join(f"A{i} {value}" for i, value in enumerate(in_degrees(step.q, 4), 1))
        return f"PTP {{{axes}}}{' C_PTP' if step.blend is not None else ''}"
    if isinstance(step, SetOutput):
        if not step.output.isdigit() or int(step.output) < 1:
            raise InputError(f"output {step.output!r}: krl has digital outputs with numbers from 1")
        return f"$OUT[{step.output}]={'TRUE' if step.on else 'FALSE'}"
    if isinstance(step, Wait):
        return f"WAIT SEC {step.seconds:.4f}"
    raise InputError("krl programs of pinproof contain moves, outputs and waiting times; set points need RSI")
