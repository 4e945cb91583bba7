"""A run of the table of picks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pinproof.benchmarks.picks_campaign import CampaignRow, campaign_rows, machinery_row
from pinproof.benchmarks.picks_measure import ScreenRow, VerdictRow, screen_rows, verdict_rows
from pinproof.benchmarks.picks_problems import CELLS, pick_cell
from pinproof.benchmarks.picks_table import PicksTable
from pinproof.benchmarks.provenance import provenance
from pinproof.common.validation import require_integer

__all__ = ["picks_benchmark"]


def picks_benchmark(
    cells: Sequence[str] = CELLS,
    *,
    picks: int = 200,
    poses: int = 20_000,
    campaign: int = 1_500,
    machinery: int = 20_000,
    seed: int = 0,
    on_progress: Callable[[str], object] = str,
) -> PicksTable:
    """Measure picks in the cells that come with the package.

    Parameters
    ----------
    cells
        Which; the campaign runs in the first.
    picks, poses
        How many are judged, and screened, in each; 0 for none.
    campaign
        Picks of the campaigns; 0 for none.
    machinery
        Picks of the campaign that judges nothing; 0 for none.
    seed
        Of the picks.
    on_progress
        Told what is being run.

    Raises
    ------
    InputError
        If a number is below 0, or a cell is not known.
    """
    for name, number in (("picks", picks), ("poses", poses), ("campaign", campaign), ("machinery", machinery)):
        require_integer(name, number, 0)
    made = [pick_cell(name) for name in cells]
    origin = provenance(seed)  # before anything runs: the load told is that of others
    verdicts: list[VerdictRow] = []
    screening: list[ScreenRow] = []
    for cell in made:
        if picks:
            on_progress(f"{cell.name}: {picks} picks through all stages")
            verdicts += verdict_rows(cell, picks, seed)
        if poses and "," not in cell.name:
            on_progress(f"{cell.name}: {poses:,} poses screened")
            screening += screen_rows(cell, poses, seed)
    campaigns: list[CampaignRow] = []
    if campaign and made:
        on_progress(f"{made[0].name}: a campaign of {campaign:,} picks")
        for row in campaign_rows(made[0], campaign, seed):
            on_progress(f"  {row.workers}: {row.wall_s:.1f} s")
            campaigns.append(row)
    idle: list[CampaignRow] = []
    if machinery and made:
        on_progress(f"{made[0].name}: a campaign of {machinery:,} picks that judges nothing")
        idle.append(machinery_row(made[0], machinery, seed))
    settings = {"picks": picks, "poses": poses, "campaign": campaign, "machinery": machinery}
    return PicksTable(settings, tuple(verdicts), tuple(screening), tuple(campaigns), tuple(idle), origin)
