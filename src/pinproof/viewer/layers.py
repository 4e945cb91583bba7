"""The parts of a picture that a reader switches on and off."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from pinproof.errors import UnknownNameError

__all__ = ["LAYERS", "Layer", "checked_layers"]

LAYERS = {
    "robot": "Robot",
    "collision": "Collision geometry",
    "scene": "Obstacles",
    "path": "Tcp path",
    "sweep": "Swept tool",
    "ghosts": "Ghosts",
    "frames": "Frames",
    "contact": "Contacts",
    "points": "Points",
}
"""What a page can show and hide, by the name it is called by, with its label."""


@dataclass(frozen=True)
class Layer:
    """A part of the picture that can be switched.

    Parameters
    ----------
    name
        One of :data:`LAYERS`.
    nodes
        Its nodes in meshcat's tree.
    shown
        Whether it is seen at first.
    note
        Added to its label: a number, how it is drawn.
    """

    name: str
    nodes: tuple[tuple[str, ...], ...]
    shown: bool
    note: str = ""

    def settings(self) -> dict[str, Any]:
        """For the page's script."""
        return {
            "name": self.name,
            "label": LAYERS[self.name],
            "note": self.note,
            "nodes": [list(node) for node in self.nodes],
            "shown": self.shown,
        }


def checked_layers(names: Collection[str]) -> frozenset[str]:
    """The names of layers.

    Raises
    ------
    UnknownNameError
        For one that is none of :data:`LAYERS`.
    """
    for name in [names] if isinstance(names, str) else names:
        if name not in LAYERS:
            raise UnknownNameError("layer", name, LAYERS, "layers")
    return frozenset([names] if isinstance(names, str) else names)
