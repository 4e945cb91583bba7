"""docs/campaigns.md runs as printed."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pinproof as pp

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
RUN_CLI = "import sys; sys.argv[0] = 'pinproof'; from pinproof.cli import main\nif __name__ == '__main__': main()"


def blocks(language: str) -> list[str]:
    return [text for found, text in BLOCK.findall((ROOT / "docs" / "campaigns.md").read_text()) if found == language]


def test_what_is_printed_runs(tmp_path, monkeypatch) -> None:
    shutil.copytree(ROOT / "robots" / "generic_6dof", tmp_path / "robots" / "generic_6dof")
    monkeypatch.chdir(tmp_path)
    (program,) = blocks("python")
    (tmp_path / "program.py").write_text(program)
    done = subprocess.run([sys.executable, "program.py"], capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "4 of 4 picks good\n['pin_0_0_0', 'pin_0_1_0', 'pin_1_0_0', 'pin_1_1_0']\n"
    assert pp.CampaignResult.open("pins").ok
    for line in "".join(blocks("sh")).splitlines():
        words = shlex.split(line)
        assert words[0] == "pinproof"
        if "--dask" not in words:
            run = [sys.executable, "-c", RUN_CLI, *words[1:]]
            done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=900)
            assert done.returncode == 1, done.stderr  # two of the four picks are not good, and are meant not to be
            assert "2 of 4 picks good" in done.stdout


def test_the_shared_part_of_a_table_is_a_picks_file(tmp_path) -> None:
    (text,) = blocks("yaml")
    (tmp_path / "picks.yaml").write_text(text)
    (tmp_path / "many.csv").write_text("name,x,y,z\nbolt,0.46,0.15,0.035\n")
    assert pp.open_picks(tmp_path / "picks.yaml").shared.robot == "ur5"
    assert [pick.name for pick in pp.read_picks(tmp_path / "picks.yaml")] == ["bolt"]
