"""Configuration of Sphinx for the manual. `scripts/docs` builds it, with warnings as errors."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "pinproof"
author = "pinproof contributors"
project_copyright = "pinproof contributors, BSD-3-Clause"
release = version = version_of("pinproof")

LOCAL = ("commands", "mathml", "packages", "references")  # in docs/_extensions
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", *LOCAL]
exclude_patterns = ["_extensions"]
nitpicky = True  # a reference to a name that does not exist is a warning, and scripts/docs fails on warnings

# Few extensions of Markdown, so that the pages also read well as files.
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
