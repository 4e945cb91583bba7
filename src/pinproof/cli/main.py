"""The command ``pinproof``: its commands, its exit codes, and how errors are reported.

Exit codes: 0, solved or FREE; 1, a negative result (unreachable, in collision, a failed pick, a rejected proof); 2,
wrong usage or unreadable input; 3, an internal error; 130, interrupted by Ctrl-C; 141, the reader of stdout was closed.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import inspect
import os
import platform
import re
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer
from typer.core import TyperCommand, TyperGroup

import pinproof as pp
from pinproof.cli.cell import cell_allocate, cell_compare, cell_place, cell_sequence, cell_tolerance
from pinproof.cli.certify import certify_motion, export
from pinproof.cli.console import Interrupted, LongSteps, print_error, print_json, print_note
from pinproof.cli.follow import follow
from pinproof.cli.grasps import grasps
from pinproof.cli.motion import check, plan, view
from pinproof.cli.new import new_cell
from pinproof.cli.options import expand_options
from pinproof.cli.pick import demo, pick
from pinproof.cli.reach import reach
from pinproof.cli.robots import bench, dh2urdf, fk, ik, info, schema, urdf2dh
from pinproof.errors import FileError, NoAnswer, PinproofError, UnitWarning

# The error classes of the parser have no public names; they are the base classes of typer.BadParameter.
_UsageError = typer.BadParameter.__mro__[1]
_ParserError = _UsageError.__mro__[1]

REPORTED_LIBRARIES = ("pin", "coal", "numpy", "typer")
"""Libraries whose versions an internal error lists."""

SUCCESS, NEGATIVE, USAGE, INTERNAL, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 3, 130, 141
ERROR_KINDS = {NEGATIVE: "negative", USAGE: "usage", INTERNAL: "internal", INTERRUPTED: "interrupted"}
"""The ``kind`` of an error in the JSON output, by exit code."""


class _ValuesInHelp:
    """Help that shows what the user may enter (see :func:`expand_options`), without types of Python."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for each in params:
            each._get_number_range_help_str = lambda **_: None  # the value states the range
            if each.param_type_name == "argument":
                each.display_type_rich = lambda **_: None
            elif getattr(each, "is_flag", False):
                each.metavar = each.metavar or ""
        return params

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]  # type: ignore[misc]


class _Group(_ValuesInHelp, TyperGroup):
    pass


class _Command(_ValuesInHelp, TyperCommand):
    pass


app = typer.Typer(
    name="pinproof",
    cls=_Group,
    help="Check whether a robot arm can execute a pick, plan its motion, and prove that the motion is collision-free.",
    epilog='"pinproof COMMAND --help" shows the options and an example of a command. "tcp" is the tool centre point. '
    "Exit codes: 0 success; 1 negative result, such as a collision or a pick that fails; 2 wrong usage or unreadable "
    "input; 3 internal error.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
PICKS, MOTIONS, ROBOTS, OTHERS = "Picks", "Motions", "Robots and kinematics", "Other commands"
COMMANDS: dict[str, Callable[..., None]] = {
    "demo": demo,
    "new cell": new_cell,
    "pick": pick,
    "reach": reach,
    "grasps": grasps,
    "cell place": cell_place,
    "cell sequence": cell_sequence,
    "cell allocate": cell_allocate,
    "cell compare": cell_compare,
    "cell tolerance": cell_tolerance,
    "check": check,
    "plan": plan,
    "follow": follow,
    "certify": certify_motion,
    "export": export,
    "view": view,
    "info": info,
    "fk": fk,
    "ik": ik,
    "dh2urdf": dh2urdf,
    "urdf2dh": urdf2dh,
    "schema": schema,
    "bench": bench,
}
"""The commands by name; ``new`` and ``cell`` are groups of commands."""

PANELS = {
    **dict.fromkeys(("demo", "new", "pick", "reach", "grasps", "cell"), PICKS),
    **dict.fromkeys(("check", "plan", "follow", "certify", "export", "view"), MOTIONS),
    **dict.fromkeys(("info", "fk", "ik", "dh2urdf", "urdf2dh"), ROBOTS),
    **dict.fromkeys(("schema", "bench"), OTHERS),
}
"""The part of ``pinproof --help`` in which a command is listed."""


class _ErrorOptions:
    """How errors are reported, as stated on the command line."""

    verbose = False

    @classmethod
    def set_verbose(cls) -> None:
        cls.verbose = True


groups = {
    "": app,
    "new": typer.Typer(help="Start from a robot and meshes of parts.", cls=_Group, no_args_is_help=True),
    "cell": typer.Typer(
        help="Plan a robot cell: where the robot is placed, the order of its picks, and its cycle time.",
        cls=_Group,
        no_args_is_help=True,
    ),
}
# Each command is registered with its docstring as help, in its part of the list
for words, command in COMMANDS.items():
    group, _, name = words.rpartition(" ")
    if group and not groups[group].registered_commands:
        app.add_typer(groups[group], name=group, rich_help_panel=PANELS[group])
    panel = None if group else PANELS[name]
    text = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.getdoc(command) or "")  # the parser keeps newlines
    register = groups[group].command(name, cls=_Command, rich_help_panel=panel, help=text)
    register(expand_options(command, _ErrorOptions.set_verbose))


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pinproof {pp.__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[  # noqa: ARG001  # used by its callback
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the traceback of an error.")] = False,
) -> None:
    """Options of the program itself."""
    _ErrorOptions.verbose = verbose


def main() -> None:
    """Run the command line and end the process with one of the exit codes above."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("default", UnitWarning)
            warnings.showwarning = _show_warning
            with LongSteps().listening():
                code = _run()
        sys.stdout.flush()
    except BrokenPipeError:
        code = BROKEN_PIPE
    if code == BROKEN_PIPE:
        # Discard the remaining output; otherwise Python reports a broken pipe when it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,  # noqa: ARG001  # part of the signature
    line: str | None = None,  # noqa: ARG001
) -> None:
    """Print a warning of pinproof as a note, and others with their place."""
    print_note(str(message) if issubclass(category, UnitWarning) else f"{filename}:{lineno}: {message}")


@functools.cache
def _command() -> Callable[..., Any]:
    """The parser of all commands, which programs that run several commands build once."""
    return typer.main.get_command(app)


def _run() -> int:
    try:
        return int(_command()(prog_name="pinproof", standalone_mode=False) or SUCCESS)
    except Interrupted as error:
        return _report(error, INTERRUPTED)
    except NoAnswer as error:
        return _report(error, NEGATIVE)
    except PinproofError as error:
        return _report(error, USAGE, hint=_file_hint(error))
    except BrokenPipeError:
        raise
    except SystemExit as end:
        # Commands end with typer.Exit. Rich and the parser raise SystemExit(1) themselves if stdout is closed.
        return BROKEN_PIPE if end.code == NEGATIVE else int(end.code or SUCCESS)
    except (KeyboardInterrupt, typer.Abort):
        return _report(Interrupted(), INTERRUPTED)
    except Exception as error:  # noqa: BLE001  # an unknown error must not look like a negative result
        if type(error).__name__ == "NoArgsIsHelpError":  # no command is stated
            error.show()  # type: ignore[attr-defined]  # prints the help
            return USAGE
        usage = _usage_message(error)
        if usage is not None:
            return _report(error, USAGE, message=usage)
        code = _report(error, INTERNAL, message=f"internal error: {type(error).__name__}: {error}")
        if _ErrorOptions.verbose:
            from importlib.metadata import PackageNotFoundError, version

            versions = [f"pinproof {pp.__version__}", f"Python {platform.python_version()} on {sys.platform}"]
            for name in REPORTED_LIBRARIES:
                with contextlib.suppress(PackageNotFoundError):
                    versions.append(f"{name} {version(name)}")
            report = f"please report it with the traceback above; {', '.join(versions)}"
            print_error(f"this is a bug in pinproof; {report}")
        else:
            print_error("this is a bug in pinproof; run the command again with --verbose and report its output")
        return code


def _report(error: Exception, code: int, *, message: str = "", hint: str = "") -> int:
    """Print an error as one line on stderr and, with ``--json``, as a JSON document on stdout."""
    if _ErrorOptions.verbose and code != INTERRUPTED:
        traceback.print_exc()
    message = (message or str(error)) + hint
    print_error(message)
    if "--json" in sys.argv and not (isinstance(error, Interrupted) and error.result_printed):
        kind = ERROR_KINDS[code]
        print_json({"error": {"kind": kind, "type": type(error).__name__, "message": message, "exit_code": code}})
    return code


def _usage_message(error: Exception) -> str | None:
    """The message of a usage error in one line, or None if the parser did not raise the error."""
    if not isinstance(error, _ParserError):
        return None
    # The wording of the parser becomes that of this program
    message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined]
    message = message.replace("Value error, ", "").replace("(Possible options: ", "(did you mean ")
    message = message.replace("Input should be greater than or equal to ", "it must be at least ")
    message = message.replace("Input should be less than or equal to ", "it must be at most ")
    message = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1)", message)
    if re.search(r"No such option: -[\dp.]$|unexpected extra argument", message):
        message += '; quote several numbers, as in --q "0 -pi/2 0"'
    context = getattr(error, "ctx", None)
    where = "pinproof" if context is None else context.command_path
    return f"{message[:1].lower()}{message[1:]}; see '{where} --help'"


def _file_hint(error: PinproofError) -> str:
    """A file with a similar name, or the folder that does not exist, for an input file that is missing."""
    if not isinstance(error, FileError) or "://" in error.path:  # a URI of a mesh
        return ""
    path = Path(error.path)
    try:
        if path.exists():
            return ""
        if not path.parent.exists():
            return f"; the folder {path.parent} does not exist"
        similar = difflib.get_close_matches(path.name, [file.name for file in path.parent.iterdir()], n=1, cutoff=0.8)
    except OSError:
        return ""
    return f"; did you mean {path.parent / similar[0]}?" if similar else ""
