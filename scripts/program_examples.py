"""Write docs/program_examples.md: programs of a bolt pick, and of a robot on a rail, with their durations.

python scripts/program_examples.py            writes the page
python scripts/program_examples.py --check    exit code 1 if the page is not up to date
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from generated_files import main, with_tables
from program_simulator import Simulator

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import RobotProgram, find_dialect
from pinproof.picks import export_picks, with_return

PAGE = Path(__file__).resolve().parents[1] / "docs" / "program_examples.md"
OUTPUTS = {"urscript": "0", "rapid": "do_gripper", "krl": "1", "fanuc": "1"}
"""The languages, each with the output that closes the gripper."""

RAIL = (
    '<link name="rail"/><joint name="rail" type="prismatic"><parent link="rail"/><child link="world"/>'
    '<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint></robot>'
)


def bolt_programs() -> dict[str, tuple[RobotProgram, float, float]]:
    """The pick ``over_the_wall`` of robots/ur5/carry.yaml, from home to home, with its durations and the motion's."""
    picks = pp.read_picks(robots_folder() / "ur5" / "carry.yaml")
    chosen = replace(picks, picks=tuple(pick for pick in picks.picks if pick.name == "over_the_wall"))
    report = pp.validate_picks(picks.load_arm(), picks.load_scene(), chosen)
    (verdict,) = report.good
    program, _ = with_return(report.setup, verdict.pick, report.programs(grip_dwell=0.5, release_dwell=0.5)[0])
    made = {
        language: export_picks(report.setup, [(verdict.pick, program)], language, output=output, name="over_the_wall")
        for language, output in OUTPUTS.items()
    }
    return {language: (each.program, each.duration, each.motion_duration) for language, each in made.items()}


def rail_programs() -> dict[str, RobotProgram]:
    """A motion of the UR5 along a rail, in the languages that have external axes."""
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", RAIL)).arm(tcp="tool0")
    start = np.array([-0.5, 0.0, -1.0, 1.4, -2.0, -1.57, 0.0])
    there = start + np.array([1.0, 0.6, -0.2, 0.1, 0.1, 0.0, 0.0])
    path = pp.JointPath([start, there], arm.joint_names)
    motion, checker = pp.time_parametrise(path, arm.limits), pp.CollisionChecker(arm)
    return {
        language: pp.collision.export_program(motion, checker, language, name="along_the_rail")[0]
        for language in ("rapid", "krl", "fanuc")
    }


def text() -> str:
    """The text of the page."""
    simulator = Simulator(robots_folder() / "ur5" / "ur5.urdf", "tool0")
    blocks = dict[str, str]()
    rows = ["| language | moves | program [s] | simulated [s] | motion [s] |", "|---|--:|--:|--:|--:|"]
    for language, (program, duration, motion) in bolt_programs().items():
        simulated, _, moves = simulator.run(program.text, find_dialect(language).endings[0])
        rows.append(f"| {language} | {moves} | {duration:.2f} | {simulated:.2f} | {motion:.2f} |")
        blocks[f"bolt {language}"] = f"```text\n{program.text}```"
    blocks["durations"] = "\n".join(rows)
    for language, program in rail_programs().items():
        blocks[f"rail {language}"] = f"```text\n{program.text}```"
    blocks = {name: f"\n{block}\n" for name, block in blocks.items()}
    return with_tables(PAGE.read_text(encoding="utf-8"), "program_examples.py", blocks)


if __name__ == "__main__":
    main(__doc__, lambda: {PAGE: text()})
