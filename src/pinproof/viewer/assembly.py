"""Assembly of an HTML page: the viewer of meshcat, commands, scripts, styles and texts in a single file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pinproof.errors import ViewerError
from pinproof.viewer.camera import FIELD_OF_VIEW, LEAST_DISTANCE, View
from pinproof.viewer.wire import Commands

# The page runs only the scripts that it contains; the browser blocks every network request.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
)


def assemble(
    title: str,
    style: str,
    body: str,
    script: str,
    settings: Mapping[str, Any],
    commands: Commands,
    *,
    live: bool = False,
) -> str:
    """The HTML of a page.

    Parameters
    ----------
    title
        Plain text.
    style, body, script
        CSS, HTML and JavaScript. ``picture.js`` and ``player.js`` run before ``script``.
    settings
        The object ``settings`` of the scripts; references to arrays of ``commands`` become typed arrays.
    commands
        The commands to meshcat's viewer.
    live
        Whether the page may receive events from the server that sent it.
    """
    bundle, licences = _viewer_bundle()
    own = "\n".join([part("picture.js"), part("player.js"), script])
    values = {
        "title": escape(title),
        "policy": POLICY.format(connect="'self'" if live else "'none'"),
        "style": style,
        "body": body,
        "licences": _inside_script(licences),
        "bundle": _inside_script(bundle),
        "settings": json.dumps(settings, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        "commands": commands.json(),
        "pictures": commands.pictures_json(),
        "buffers": commands.base64(),
        "script": f'"use strict";\n(function () {{\n{own}\n}})();',
    }
    return fill(part("shell.html"), values)


def fill(template: str, values: Mapping[str, str]) -> str:
    """Replace each ``{{name}}`` of a template in a single pass, so that inserted text is never replaced again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], template)


def part(name: str, package: str = "pinproof.viewer") -> str:
    """The text of a file in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def view_settings(view: View) -> dict[str, Any]:
    """The settings from which the page computes the position of the camera for its canvas."""
    return {
        "direction": [round(float(v), 6) for v in view.direction],
        "points": [[round(float(v), 4) for v in point] for point in view.points],
        "fieldOfView": FIELD_OF_VIEW,
        "leastDistance": LEAST_DISTANCE,
        "margin": view.margin,
    }


def _viewer_bundle() -> tuple[str, str]:
    """The viewer of meshcat (MIT licence; it includes three.js and dat.GUI) and the licences to distribute with it."""
    spec = find_spec("meshcat")  # does not import the package; see pinproof.viewer.wire
    if spec is None or spec.origin is None:
        raise ViewerError("meshcat is not installed; pages need its viewer: pip install meshcat")
    folder = Path(spec.origin).parent / "viewer"
    try:
        bundle = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
        notices = [
            (folder / name).read_text(encoding="utf-8")
            for name in ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
            if (folder / name).is_file()
        ]
    except OSError as error:
        raise ViewerError(f"the installed meshcat has no viewer at {error.filename}: reinstall it") from error
    return bundle, "\n\n".join(["The viewer below is meshcat's.", *notices])


def _inside_script(text: str) -> str:
    """Escape a text so that it cannot close the ``<script>`` element that contains it."""
    return re.sub(r"<(?=/script|!--)", r"\\x3c", text, flags=re.IGNORECASE)
