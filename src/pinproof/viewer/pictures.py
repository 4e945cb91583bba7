"""Pictures on meshes, as a page can hold them."""

from __future__ import annotations

from base64 import b64encode
from io import BytesIO
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["picture_on"]

LARGEST = 1024
"""Pixels of a side; larger pictures are made smaller, as nobody looks at a robot from that near."""

QUALITY = 88
"""Of JPEG."""


def picture_on(part: Any) -> tuple[npt.NDArray[np.float64] | None, str | None]:
    """The picture on a part of a trimesh scene: ``uv`` (V, 2) and a ``data:`` address; (None, None) if it has none.

    A picture that cannot be read leaves the part in its plain colour.
    """
    material, uv = getattr(part.visual, "material", None), getattr(part.visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or uv is None or np.shape(uv) != (len(part.vertices), 2) or not np.isfinite(uv).all():
        return None, None
    try:
        return np.asarray(uv, dtype=float), _address(image)
    except (OSError, ValueError, SyntaxError):  # what Pillow raises for torn files
        return None, None


def _address(image: Any) -> str:
    clear = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    small = image.convert("RGBA" if clear else "RGB")
    small.thumbnail((LARGEST, LARGEST))
    content = BytesIO()
    if clear:
        small.save(content, "PNG")
    else:
        small.save(content, "JPEG", quality=QUALITY)
    return f"data:image/{'png' if clear else 'jpeg'};base64,{b64encode(content.getvalue()).decode('ascii')}"
