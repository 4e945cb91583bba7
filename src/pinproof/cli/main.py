"""Words for what went wrong: what the parser refuses, files that are nearly there, and what to report.

The command ``pinproof`` and its exit codes.

0: yes. 1: an honest "no" (unreachable, in collision, a pick that fails). 2: wrong usage or unreadable input. 3: an
internal error, so that it is never mistaken for a "no". 130: Ctrl-C, as shells count it; 141: whoever read the answer
went away before it was all said.
"""

from __future__ import annotations

import difflib
import os
import platform
import re
import sys
import traceback
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

from pinproof import __version__
from pinproof.cli.bench import bench_ik, bench_plan
from pinproof.cli.certify import certify_motion
from pinproof.cli.compiling import compile_kernels, hush
from pinproof.cli.console import Stopped, complain, print_json
from pinproof.cli.convert import dh2urdf, urdf2dh
from pinproof.cli.demo import demo
from pinproof.cli.info import info
from pinproof.cli.kinematics import fk, ik
from pinproof.cli.motion import check, plan
from pinproof.cli.options import spread
from pinproof.cli.pick import pick
from pinproof.cli.reach import reach
from pinproof.cli.view import view
from pinproof.errors import FileError, NoAnswer, PinproofError

__all__ = ["asked_for_help", "main", "remedy", "usage_fault", "versions"]

# What the parser raises: its classes have no public name, those above BadParameter least of all.
_UsageError = typer.BadParameter.__mro__[1]
_ParserError = _UsageError.__mro__[1]

DECISIVE = ("pin", "coal", "numba", "numpy", "typer")
"""Libraries whose version a report of a defect should name."""


def asked_for_help(error: Exception) -> bool:
    """Whether a group was called without a command, which is answered by its help; prints that."""
    if type(error).__name__ != "NoArgsIsHelpError":
        return False
    error.show()  # type: ignore[attr-defined]  # untyped: typer.BadParameter's family
    return True


def usage_fault(error: Exception) -> str | None:
    """What the parser found wrong with the line, in one line; None for an error that is not the parser's."""
    if not isinstance(error, _ParserError):
        return None
    message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined]
    message = message.replace("Value error, ", "").replace("(Possible options: ", "(did you mean ")
    message = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1)", message)
    if re.search(r"No such option: -[\dp.]$|unexpected extra argument", message):
        message += '; several numbers go between quotes, as in --q "0 -pi/2 0"'
    context = getattr(error, "ctx", None)
    where = "pinproof" if context is None else context.command_path
    return f"{message[:1].lower()}{message[1:]}; '{where} --help' shows what can be said"


def remedy(error: PinproofError) -> str:
    """A few more words on an error of ours, where the file system knows them."""
    if not isinstance(error, FileError):
        return ""
    path = Path(error.path)
    try:
        if path.exists():
            return ""
        if not path.parent.exists():
            return f"; there is no folder {path.parent}"
        if not path.parent.is_dir():
            return ""
        near = difflib.get_close_matches(path.name, [file.name for file in path.parent.iterdir()], n=1)
    except OSError:
        return ""
    return f"; did you mean {path.parent / near[0]}?" if near else ""


def versions() -> str:
    """What runs here."""
    told = [f"pinproof {version('pinproof')}", f"Python {platform.python_version()} on {sys.platform}"]
    for name in DECISIVE:
        try:
            told.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            told.append(f"no {name}")
    return ", ".join(told)


YES, NO, USAGE, INTERNAL, INTERRUPTED, NOBODY_READS = 0, 1, 2, 3, 130, 141

app = typer.Typer(
    name="pinproof",
    help="Can this arm make this pick, and how? Answered with proof.",
    epilog='"pinproof COMMAND --help" shows an example of each. Exit code 0: yes; 1: an honest no; 2: wrong usage or '
    "unreadable input; 3: an internal error.",
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
    "compile": compile_kernels,
}
"""Each command by the words that call it; the first of two is a group's."""


class _Options:
    """What was said on the line about how errors are told."""

    verbose = False

    @classmethod
    def be_verbose(cls) -> None:
        cls.verbose = True


groups = {"": app, "bench": typer.Typer(help="Tables of figures, measured on this machine.", no_args_is_help=True)}
app.add_typer(groups["bench"], name="bench")
for words, command in COMMANDS.items():
    group, _, name = words.rpartition(" ")
    groups[group].command(name)(spread(command, _Options.be_verbose))


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


def main() -> None:
    """Run the command line; ends the process with one of the exit codes above."""
    hush()
    try:
        code = _run()
        sys.stdout.flush()
    except BrokenPipeError:
        code = NOBODY_READS
    if code == NOBODY_READS:
        # What is still to be written has nowhere to go, and Python would complain of it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _run() -> int:
    try:
        return int(app(prog_name="pinproof", standalone_mode=False) or YES)
    except Stopped as stop:
        return _told(stop, INTERRUPTED)
    except NoAnswer as error:
        return _told(error, NO)
    except PinproofError as error:
        return _told(error, USAGE, remedy(error))
    except BrokenPipeError:
        raise
    except SystemExit as end:
        # Commands end by typer.Exit. Rich and the parser end so themselves, with 1, if nobody reads what they print.
        return NOBODY_READS if end.code == NO else int(end.code or YES)
    except (KeyboardInterrupt, typer.Abort):
        return _told(Stopped(), INTERRUPTED)
    except Exception as error:  # noqa: BLE001  # whatever it is, it must not look like a "no"
        if asked_for_help(error):
            return USAGE
        said = usage_fault(error)
        if said is not None:
            return _told(error, USAGE, words=said)
        code = _told(error, INTERNAL, words=f"internal error: {type(error).__name__}: {error}")
        if _Options.verbose:
            complain(
                f"this is a defect of pinproof and no answer: please report it with all of the above; {versions()}"
            )
        else:
            complain("this is a defect of pinproof and no answer: run it again with --verbose, and report what it says")
        return code


def _told(error: Exception, code: int, hint: str = "", words: str = "") -> int:
    """Say what went wrong: a line to stderr, and with --json also the one document that is then due on stdout."""
    if _Options.verbose and code != INTERRUPTED:
        traceback.print_exc()
    message = (words or str(error)) + hint
    complain(message)
    if "--json" in sys.argv and not (isinstance(error, Stopped) and error.answered):
        kind = {NO: "no", USAGE: "usage", INTERNAL: "internal", INTERRUPTED: "interrupted"}[code]
        print_json({"error": {"kind": kind, "type": type(error).__name__, "message": message, "exit_code": code}})
    return code
