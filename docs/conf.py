"""How the manual is built: `scripts/docs`, which calls Sphinx with warnings as errors."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "pinproof"
author = "pinproof contributors"
project_copyright = "pinproof contributors, BSD-3-Clause"
release = version = version_of("pinproof")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "commands",
    "mathml",
    "references",
    "packages",
]
exclude_patterns = ["_extensions"]
nitpicky = True  # a reference that leads nowhere is a warning, and a warning an error

# Markdown as the pages use it, so that they read well where they are stored too.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_inherit_docstrings = True
python_use_unqualified_type_names = True
add_module_names = False
napoleon_google_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"pinproof {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
html_math_renderer = "mathml"


def setup(app: Sphinx) -> None:
    """Register "csv" as plain text; Pygments has no lexer for it."""
    app.add_lexer("csv", TextLexer)
