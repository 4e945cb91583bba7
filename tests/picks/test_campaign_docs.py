"""docs/campaigns.md runs as printed."""

from __future__ import annotations

import pytest

import pinproof as pp

from ..pages import PROGRAM, ROOT, blocks, commands, reader_folder, run_command, run_program

PAGE = ROOT / "docs" / "campaigns.md"


@pytest.mark.slow
def test_the_page_runs_as_printed(tmp_path) -> None:
    (program,) = blocks(PAGE, "python")
    assert PROGRAM in program.text
    with reader_folder(tmp_path):
        printed = run_program(program.text, "campaigns.md")
        assert printed == "4 of 4 picks good\n['pin_0_0_0', 'pin_0_1_0', 'pin_1_0_0', 'pin_1_1_0']\n"
        assert pp.picks.CampaignResult.open("pins").ok
        for words, _ in (each for block in blocks(PAGE, "sh") for each in commands(block)):
            if "--dask" not in words:  # there is no cluster here; tests/picks/test_campaign_dask.py does
                # Two of the four picks are not good, and are meant not to be.
                assert "2 of 4 picks good" in run_command(words, 1, "campaigns.md")


def test_the_shared_part_of_a_table_is_a_picks_file(tmp_path) -> None:
    (block,) = blocks(PAGE, "yaml")
    (tmp_path / "picks.yaml").write_text(block.text)
    (tmp_path / "many.csv").write_text("name,x,y,z\nbolt,0.46,0.15,0.035\n")
    assert pp.picks.open_picks(tmp_path / "picks.yaml").shared.robot == "ur5"
    assert [pick.name for pick in pp.read_picks(tmp_path / "picks.yaml")] == ["bolt"]
