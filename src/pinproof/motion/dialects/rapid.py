"""RAPID of ABB: ``MoveAbsJ``, ``MoveL``, ``SetDO`` and ``WaitTime``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.errors import InputError
from pinproof.motion.dialects.dialect import NUMBER, Body, Dialect, LineReader, in_degrees, numbers_of
from pinproof.motion.program_steps import Blend, JointMove, LinearMove, SetOutput, Step, Wait

NO_AXIS = ",".join(["9E9"] * 6)
"""The values of external axes that do not exist."""


class Rapid(Dialect):
    """RAPID; a fly-by point may use at most half of the move to it and half of the move after it."""

    name = "rapid"
    endings = (".mod", ".modx", ".prg")
    comment_mark = "! pinproof:"
    outputs = "do_gripper"
    blend = Blend(share=0.5)
    deviation = 0.002

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        lines = [f"    {_written(step)}" for step in steps]
        return [f"MODULE {name}", "  PROC main()"], lines, ["  ENDPROC", "ENDMODULE"]

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """See :meth:`Dialect.read`."""

        def move(found: re.Match[str], line: int) -> Step:
            duration = None if found[2] is None else float(found[2])
            if duration is not None and duration <= 0:
                raise ValueError("the time must be above 0")
            blend = None if found[3] == "fine" else Blend(share=0.5)
            return JointMove(np.deg2rad(numbers_of(found[1], joints)), duration, blend, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            if float(found[2]) <= 0:
                raise ValueError("the time must be above 0")
            return LinearMove(np.deg2rad(numbers_of(found[1], joints)), None, float(found[2]), line)

        target = rf"\[\[([^\]]*)\],\[{NO_AXIS}\]\]"
        rules = [
            (r"MODULE \w+|PROC \w+\(\)|ENDPROC|ENDMODULE", lambda _, __: None),
            (
                rf"MoveAbsJ {target}\\NoEOffs, v\d+(?:\\T:=({NUMBER}))?, (fine|z\d+), tool0;",
                move,
            ),
            (rf"MoveL CalcRobT\({target}, tool0\), v\d+\\T:=({NUMBER}), fine, tool0;", line_to),
            (r"SetDO (\w+), ([01]);", lambda found, line: SetOutput(found[1], found[2] == "1", line)),
            (rf"WaitTime ({NUMBER});", lambda found, line: Wait(float(found[1]), line)),
        ]
        return LineReader(source, rules, r"MoveAbsJ [[..],[9E9,..]]\NoEOffs, MoveL CalcRobT(..), SetDO, WaitTime").read(
            body
        )


def _written(step: Step) -> str:
    if isinstance(step, JointMove):
        time = "v100" if step.duration is None else rf"v1000\T:={max(step.duration, 0.01):.4f}"
        zone = "fine" if step.blend is None else "z10"
        return rf"MoveAbsJ [[{','.join(in_degrees(step.q, 4))}],[{NO_AXIS}]]\NoEOffs, {time}, {zone}, tool0;"
    if isinstance(step, LinearMove) and step.q is not None:
        target = f"CalcRobT([[{','.join(in_degrees(step.q, 4))}],[{NO_AXIS}]], tool0)"
        return rf"MoveL {target}, v1000\T:={max(step.duration or 1.0, 0.01):.4f}, fine, tool0;"
    if isinstance(step, SetOutput):
        if not re.fullmatch(r"[A-Za-z]\w*", step.output):
            raise InputError(f"output {step.output!r}: rapid has digital outputs with names, such as do_gripper")
        return f"SetDO {step.output}, {int(step.on)};"
    if isinstance(step, Wait):
        return f"WaitTime {step.seconds:.4f};"
    raise InputError("rapid programs of pinproof contain moves, outputs and waiting times; set points need EGM")
