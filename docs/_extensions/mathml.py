"""Write formulas as MathML, which browsers render without scripts, so the pages work offline."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


def inline(self: Any, node: nodes.math) -> None:
    """Write an inline formula."""
    self.body.append(converted(node.astext(), as_block=False))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write a display formula."""
    self.body.append(f'<div class="math">{converted(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def converted(tex: str, *, as_block: bool) -> str:
    """Convert a formula to MathML; a formula that cannot be converted is a build error."""
    try:
        return tex2mathml(tex.replace(r"\dots", r"\ldots"), as_block=as_block)
    except Exception as error:
        raise ExtensionError(f"this formula cannot be converted to MathML: {tex}\n{error}") from error


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
