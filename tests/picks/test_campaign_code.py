"""All rows of a file come from the same code."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path

import pytest

import pinproof as pp
from pinproof.common import content_hash
from pinproof.errors import CampaignError
from pinproof.picks.batch.campaign import RowTask, describe_judge, judge_row


@pytest.fixture
def copy_of_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A copy of the source that tests can change, with its code version."""
    package = tmp_path / "pinproof"
    for path in content_hash.PACKAGE.rglob("*.py"):
        place = package / path.relative_to(content_hash.PACKAGE)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    original = content_hash.code_here()
    monkeypatch.setattr(content_hash, "PACKAGE", package)
    content_hash.code_here.cache_clear()
    assert content_hash.code_here() == original
    yield package
    monkeypatch.undo()
    content_hash.code_here.cache_clear()


def recomputed_version() -> str:
    content_hash.code_here.cache_clear()
    return content_hash.code_here()


def test_the_code_version_names_the_package_and_the_libraries() -> None:
    expected = content_hash.code_here()
    assert expected.startswith(f"{pp.__version__} ")
    assert "numpy " in expected
    assert "unknown" not in expected


def test_any_change_of_the_judging_code_changes_its_version(copy_of_the_package: Path) -> None:
    before = recomputed_version()
    module = copy_of_the_package / "collision" / "certificates" / "certify.py"
    module.write_text(module.read_text() + "\n# changed\n")
    changed = recomputed_version()
    assert changed != before
    (copy_of_the_package / "picks" / "new.py").touch()
    assert recomputed_version() not in (before, changed)


def test_help_texts_do_not_change_the_code_version(copy_of_the_package: Path) -> None:
    before = recomputed_version()
    page = copy_of_the_package / "cli" / "pick.py"
    page.write_text(page.read_text() + "\n# changed\n")
    assert recomputed_version() == before


@pytest.mark.slow
def test_a_campaign_begun_with_other_code_is_refused(stick, many, judges, tmp_path, monkeypatch) -> None:
    made = pp.Campaign(stick, pp.Scene(), many, judge=judges.echo)
    made.run(tmp_path, workers=1)
    before = (tmp_path / "rows.jsonl").read_bytes()
    monkeypatch.setattr("pinproof.picks.batch.campaign.code_here", lambda: "0.1.0 otherwise")
    with pytest.raises(CampaignError, match=r"differs in pinproof \(0.1.0 .* there, 0.1.0 otherwise here\)"):
        made.run(tmp_path, workers=1)
    assert (tmp_path / "rows.jsonl").read_bytes() == before


def test_a_worker_with_other_code_refuses_the_task(stick, many, monkeypatch) -> None:
    setup = pp.picks.PickSetup.make(stick, pp.Scene(), many.shared, home=None, rng=0)
    package = pickle.dumps(RowTask(setup, judge_row))
    assert isinstance(pickle.loads(package), RowTask)
    monkeypatch.setattr("pinproof.picks.batch.campaign.code_here", lambda: "0.1.0 otherwise")
    mismatch = rf"a worker runs pinproof 0\.1\.0 otherwise, the campaign runs {pp.__version__} "
    with pytest.raises(CampaignError, match=mismatch):
        pickle.loads(package)


def test_a_custom_judge_is_identified_by_its_source(judges) -> None:
    assert describe_judge(judge_row) == "pinproof.picks.batch.campaign.judge_row"
    echo, slow = describe_judge(judges.echo), describe_judge(judges.slow)
    assert echo.startswith("campaign_judges.echo ")
    assert echo.split()[1] != slow.split()[1]
