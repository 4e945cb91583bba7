"""The directive ``commands``: documents every command of the CLI from the parser itself."""

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
    """``{commands}`` writes a section for each command: description, example, arguments and options."""

    def run(self) -> list[nodes.Node]:
        """Write the sections from the parser of the program."""
        lines = [line for words in COMMANDS for line in section(words)]
        return nested_parse_to_nodes(
            self.state, StringList(lines, source="<commands>"), source="<commands>", allow_section_headings=True
        )


def section(words: str) -> list[str]:
    """Return the Markdown of one command."""
    command: Any = typer.main.get_command(app)
    for word in words.split():
        command = command.commands[word]
    text = inspect.cleandoc(command.help or "").splitlines()
    examples = [line.removeprefix(EXAMPLE) for line in text if line.startswith(EXAMPLE)]
    prose = "\n".join(line for line in text if not line.startswith(EXAMPLE)).strip()
    named = " ".join(argument(each) for each in command.params if each.param_type_name == "argument")
    rows = [row(each) for each in command.params if each.name != "help" and not getattr(each, "hidden", False)]
    shown = ["```sh", *examples, "```"] if examples else []
    table = ["| option | description | default |", "|---|---|---|", *rows]
    return [f"## pinproof {words} {named}".rstrip(), "", *prose.splitlines(), "", *shown, "", *table, ""]


def argument(parameter: Any) -> str:
    """Return the name of an argument, in brackets if it is optional."""
    name = parameter.metavar or parameter.name.upper()
    return name if parameter.required else f"[{name}]"


def row(parameter: Any) -> str:
    """Return one row of the option table of a command."""
    given = parameter.default if isinstance(parameter.default, str | int | float) else None
    default = "" if given in (None, False, "") or parameter.required else f"`{getattr(given, 'value', given)}`"
    option = f"{', '.join(parameter.opts)} {parameter.metavar or ''}".rstrip()
    words, help_text = option if parameter.param_type_name == "option" else argument(parameter), parameter.help or ""
    cells = (f"`{words}`", " ".join(help_text.split()), default)
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
