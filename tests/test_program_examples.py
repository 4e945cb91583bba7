"""The page of printed programs is what the code writes."""

from __future__ import annotations

import re

import program_examples
import pytest
from program_simulator import Simulator

from pinproof.description import robots_folder


@pytest.mark.slow
def test_the_page_has_the_programs_that_are_written_now() -> None:
    page = program_examples.PAGE.read_text(encoding="utf-8")
    assert program_examples.text() == page
    rows = re.findall(r"^\| (\w+) \| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", page, re.MULTILINE)
    assert [row[0] for row in rows] == ["urscript", "rapid", "krl", "fanuc"]
    for _, moves, program, simulated, motion in rows:  # few moves, nearly as fast as the certified motion
        assert int(moves) <= 12
        assert float(program) <= 1.1 * float(motion)
        assert float(simulated) == pytest.approx(float(program), rel=0.1)


@pytest.mark.parametrize(
    ("title", "ending"), [("urscript", ".script"), ("rapid", ".mod"), ("krl", ".src"), ("fanuc", ".ls")]
)
def test_the_simulator_finds_a_printed_program_within_the_velocities_and_slower_without_its_blends(
    title, ending
) -> None:
    page = program_examples.PAGE.read_text(encoding="utf-8")
    text = page.partition(f"<!-- begin: bolt {title} ")[2].partition("```text\n")[2].partition("```")[0]
    simulator = Simulator(robots_folder() / "ur5" / "ur5.urdf", "tool0")
    duration, velocity, moves = simulator.run(text, ending)
    assert moves in (8, 9)
    assert velocity <= 1.005
    stops = re.sub(r", r=[\d.]+|\bz\d+(?=,)| C_DIS|CNT100", lambda m: {"z": "fine", "C": "FINE"}.get(m[0][0], ""), text)
    assert stops.count("CNT") == stops.count("C_DIS") == 0
    assert simulator.run(stops, ending)[0] >= duration + (0.05 if stops != text else 0.0)
