"""Options that several commands share, stated once: a parameter that is a dataclass stands for its fields."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_type_hints

import typer

from pinproof.cli.console import Stopped

__all__ = ["spread"]

Verbose = Annotated[bool, typer.Option("--verbose", help="Show the traceback of an error.")]


def spread(command: Callable[..., None], on_verbose: Callable[[], None]) -> Callable[..., None]:
    """A command as the parser takes it: every field of a dataclass among its parameters is an option of its own.

    It also takes ``--verbose``, and ends as :class:`pinproof.cli.console.Stopped` at Ctrl-C, which the parser would
    otherwise swallow.
    """
    # Not get_type_hints: of a parameter whose default is None, Python 3.10 makes an Optional that hides the Annotated.
    told = inspect.signature(command, eval_str=True).parameters
    groups: dict[str, Any] = {name: each.annotation for name, each in told.items() if is_dataclass(each.annotation)}
    options: list[tuple[str, Any, Any]] = []
    for name, parameter in told.items():
        if name in groups:
            inner = get_type_hints(groups[name], include_extras=True)
            options += [
                (field.name, inner[field.name], inspect.Parameter.empty if field.default is MISSING else field.default)
                for field in fields(groups[name])
            ]
        else:
            options.append((name, parameter.annotation, parameter.default))
    options.append(("verbose", Verbose, False))

    @functools.wraps(command)
    def call(*, verbose: bool, **given: Any) -> None:
        if verbose:
            on_verbose()
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        try:
            command(**given)
        except KeyboardInterrupt:
            raise Stopped from None

    by_name = inspect.Parameter.KEYWORD_ONLY
    call.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # what inspect reads first
        [inspect.Parameter(name, by_name, default=default, annotation=hint) for name, hint, default in options]
    )
    call.__annotations__ = {name: hint for name, hint, _ in options}
    return call
