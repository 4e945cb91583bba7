"""The directive ``commands``: every command as the program itself knows it, so that the page is never out of date."""

from __future__ import annotations

import inspect
from typing import Any

import typer.main
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from sphinx.util.parsing import nested_parse_to_nodes

from pinproof.cli.main import COMMANDS, app

EXAMPLE = "Example: "


class Commands(SphinxDirective):
    """``{commands}`` writes a section for each command: what it does, an example, its arguments and options."""

    def run(self) -> list[nodes.Node]:
        """Read the program's own parser."""
        lines = [line for words in COMMANDS for line in section(words)]
        return nested_parse_to_nodes(
            self.state, StringList(lines, source="<commands>"), source="<commands>", allow_section_headings=True
        )


def section(words: str) -> list[str]:
    """A command in Markdown."""
    command: Any = typer.main.get_command(app)
    for word in words.split():
        command = command.commands[word]
    text = inspect.cleandoc(command.help or "").splitlines()
    examples = [line.removeprefix(EXAMPLE) for line in text if line.startswith(EXAMPLE)]
    prose = "\n".join(line for line in text if not line.startswith(EXAMPLE)).strip()
    named = " ".join(argument(each) for each in command.params if each.param_type_name == "argument")
    rows = [row(each) for each in command.params if each.name != "help" and not getattr(each, "hidden", False)]
    shown = ["```sh", *examples, "```"] if examples else []
    table = ["| | | by default |", "|---|---|---|", *rows]
    return [f"## pinproof {words} {named}".rstrip(), "", *prose.splitlines(), "", *shown, "", *table, ""]


def argument(parameter: Any) -> str:
    """The name of an argument, in brackets if it may be left out."""
    name = parameter.metavar or parameter.name.upper()
    return name if parameter.required or name.startswith("[") else f"[{name}]"


def row(parameter: Any) -> str:
    """A line of a command's table."""
    given = parameter.default if isinstance(parameter.default, str | int | float) else None
    default = "" if given in (None, False, "") or parameter.required else f"`{getattr(given, 'value', given)}`"
    words = ", ".join(parameter.opts) if parameter.param_type_name == "option" else argument(parameter)
    told = " ".join((parameter.help or "").split()).replace("|", r"\|")
    choices = getattr(getattr(parameter, "type", None), "choices", None)
    if choices:
        told += f" One of {', '.join(str(getattr(each, 'value', each)) for each in choices)}."
    return f"| `{words}` | {told} | {default} |"


def setup(app: Sphinx) -> dict[str, Any]:
    """Join Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
