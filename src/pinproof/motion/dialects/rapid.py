"""RAPID of ABB: ``MoveAbsJ``, ``MoveL``, ``SetDO`` and ``WaitTime``."""

from __future__ import annotations

import re

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
    rounded_up,
)

# The values of external axes that do not exist.
NO_AXIS = ",".join(["9E9"] * 6)

SPEEDS = "v(?:5|[1-68]0|[1-68]00|1500|[1-7]000|2500|150)"
# Regular expressions of the speeds and zones that RAPID predefines; others may be defined elsewhere, as anything.
ZONES = "z(?:[015]|[1-6]0|15|80|1[05]0|200)"


class Rapid(Dialect):
    """RAPID; a fly-by point may use at most half of the move to it and half of the move after it."""

    name = "rapid"
    endings = (".mod", ".modx", ".prg")
    comment_mark = "! pinproof:"
    outputs = "do_gripper"
    blend = Blend(share=0.5)
    deviation = 0.002
    output_line, output_states = "SetDO {}, {};", ("0", "1")
    output_names, output_kind = r"[A-Za-z]\w*", "names, such as do_gripper"
    wait_line = "WaitTime {:.4f};"
    opening, closing = (f"MODULE {NAME}", r"PROC main\(\)"), ("ENDPROC", "ENDMODULE")
    supported = r"MoveAbsJ [[..],[9E9,..]]\NoEOffs, MoveL CalcRobT(..), SetDO, WaitTime"
    contents = "moves, outputs and waiting times; set points need EGM"
    frame = ("MODULE {}", "  PROC main()"), ("  ENDPROC", "ENDMODULE")
    indent = "    "

    def move(self, step: Step) -> str | None:
        """See :meth:`Dialect.move`."""
        if isinstance(step, JointMove):
            time = "v100" if step.duration is None else rf"v1000\T:={rounded_up(step.duration, 1e-4, 0.01):.4f}"
            zone = "fine" if step.blend is None else "z10"
            return rf"MoveAbsJ [[{','.join(in_degrees(step.q, 4))}],[{NO_AXIS}]]\NoEOffs, {time}, {zone}, tool0;"
        if isinstance(step, LinearMove) and step.q is not None:
            target = f"CalcRobT([[{','.join(in_degrees(step.q, 4))}],[{NO_AXIS}]], tool0)"
            return rf"MoveL {target}, v1000\T:={rounded_up(step.duration or 1.0, 1e-4, 0.01):.4f}, fine, tool0;"
        return None

    def move_rules(self, joints: int) -> list[Rule]:
        """See :meth:`Dialect.move_rules`."""

        def move(found: re.Match[str], line: int) -> Step:
            duration, blend = positive(found[2]) if found[2] else None, None if found[3] == "fine" else Blend(share=0.5)
            return JointMove(np.deg2rad(numbers_of(found[1], joints)), duration, blend, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            return LinearMove(np.deg2rad(numbers_of(found[1], joints)), None, positive(found[2]), line)

        target = rf"\[\[([^\]]*)\],\[{NO_AXIS}\]\]"
        return [
            (rf"MoveAbsJ {target}\\NoEOffs, {SPEEDS}(?:\\T:=({NUMBER}))?, (fine|{ZONES}), tool0;", move),
            (rf"MoveL CalcRobT\({target}, tool0\), {SPEEDS}\\T:=({NUMBER}), fine, tool0;", line_to),
        ]
