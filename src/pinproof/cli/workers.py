"""Who judges: this process, several of this machine, or a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from pinproof.errors import CampaignError, InputError

__all__ = ["Dask", "WorkerCount", "chosen_workers"]

WorkerCount = Annotated[int | None, typer.Option("--workers", help="Judge in so many processes.", min=1)]
Dask = Annotated[str | None, typer.Option(help="Judge on a Dask cluster: its scheduler.", metavar="tcp://HOST:PORT")]

CONNECT_SECONDS = 20
"""How long a scheduler has to answer."""


@contextmanager
def chosen_workers(workers: int | None, dask: str | None) -> Iterator[dict[str, Any]]:
    """What the options say, as settings of :class:`pinproof.Campaign` and :func:`pinproof.validate_picks`.

    Raises
    ------
    InputError
        If both are given, or Dask is not installed.
    CampaignError
        If no scheduler answers.
    """
    if dask is None:
        yield {} if workers is None else {"workers": workers}
        return
    if workers is not None:
        raise InputError("--workers counts processes of this machine, and --dask has its own; give one of them")
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--dask needs the extra 'dask': pip install 'pinproof[dask]'") from error
    try:
        client = Client(dask, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise CampaignError(f"no Dask scheduler answers at {dask}: {error}") from error
    with client:
        threads = sum(client.nthreads().values())
        # Two a thread, so that the next chunk is there when one is done; more workers may still come.
        yield {"executor": client.get_executor(), "in_flight": max(2 * threads, 16)}
