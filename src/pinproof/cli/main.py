"""The command ``pinproof`` and its exit codes.

0: yes. 1: an honest "no" (unreachable, in collision, a pick that fails). 2: wrong usage or unreadable input. 3: an
internal error, so that it is never mistaken for a "no".
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from typing import Annotated

import typer

from pinproof import __version__
from pinproof.cli.bench import bench_ik, bench_plan
from pinproof.cli.certify import certify_motion
from pinproof.cli.console import complain
from pinproof.cli.convert import dh2urdf, urdf2dh
from pinproof.cli.demo import demo
from pinproof.cli.info import info
from pinproof.cli.kinematics import fk, ik
from pinproof.cli.motion import check, plan, view
from pinproof.cli.pick import pick
from pinproof.cli.reach import reach
from pinproof.errors import NoAnswer, PinproofError

__all__ = ["main"]

NO, USAGE, INTERNAL, INTERRUPTED = 1, 2, 3, 130

app = typer.Typer(
    name="pinproof",
    help="Can this arm make this pick, and how? Answered with proof.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo,
    "pick": pick,
    "reach": reach,
    "info": info,
    "fk": fk,
    "ik": ik,
    "check": check,
    "plan": plan,
    "certify": certify_motion,
    "view": view,
    "dh2urdf": dh2urdf,
    "urdf2dh": urdf2dh,
    "bench ik": bench_ik,
    "bench plan": bench_plan,
}
"""Each command by the words that call it; the first of two is a group's."""

groups = {"": app, "bench": typer.Typer(help="Tables of figures, measured on this machine.", no_args_is_help=True)}
app.add_typer(groups["bench"], name="bench")
for words, command in COMMANDS.items():
    group, _, name = words.rpartition(" ")
    groups[group].command(name)(command)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pinproof {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[  # noqa: ARG001  # acted on by its callback
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the traceback of an error.")] = False,
) -> None:
    """Options of every command."""
    _Options.verbose = verbose


class _Options:
    """What the options before the command said."""

    verbose = False


def main() -> None:
    """Run the command line; ends the process with one of the exit codes above."""
    try:
        app()
    except NoAnswer as error:
        sys.exit(_told(error, NO))
    except PinproofError as error:
        sys.exit(_told(error, USAGE))
    except KeyboardInterrupt:
        complain("interrupted")
        sys.exit(INTERRUPTED)
    except Exception as error:  # noqa: BLE001  # whatever it is, it must not look like a "no"
        complain(f"internal error: {type(error).__name__}: {error}")
        if _Options.verbose:
            traceback.print_exc()
        else:
            complain("run it again with 'pinproof --verbose ...' for the traceback")
        sys.exit(INTERNAL)


def _told(error: PinproofError, code: int) -> int:
    if _Options.verbose:
        traceback.print_exc()
    complain(str(error))
    return code
