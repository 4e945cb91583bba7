"""Meshes made coarser for show, where a page would otherwise be too large to send or to open."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from pinproof.viewer.stage import Stage
from pinproof.viewer.surfaces import Surface, shade

__all__ = ["MOST_BYTES", "simplified"]

MOST_BYTES = 10e6
"""Of all meshes of a page, as text; with the viewer (1 MB) and a motion it stays below 15 MB."""

CELLS = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.008, 0.012, 0.020, 0.035, 0.060)
"""Metres, tried in turn: points that share a cell of this size become one. The first is never seen."""

FINE = 1500
"""Triangles; a surface with fewer is left as it is."""


def simplified(stage: Stage, most: float = MOST_BYTES) -> Stage:
    """The stage with surfaces so coarse that all of them fit into so many bytes; its notes say so.

    Points in one cell of a grid become their mean, and triangles that thereby lose a corner vanish (J. Rossignac and
    P. Borrel, 1993, "Multi-resolution 3D approximations for rendering complex scenes"). What checks see stays as it is.
    """
    made, used = stage, 0.0
    for cell in CELLS:
        if _bytes(made) <= most:
            break
        made, used = _coarser(stage, cell), cell
    if made is stage:
        return stage
    said = f"Meshes are simplified for show, to details of {used * 1e3:g} mm; checks and proofs use them as they are."
    return replace(made, notes=(*stage.notes, said))


def _bytes(stage: Stage) -> float:
    """What the surfaces take in a page: 15 bytes a vertex, indices of 2 or 4, as base64."""
    return (
        4
        / 3
        * sum(
            15 * len(each.vertices) + (4 if len(each.vertices) > np.iinfo(np.uint16).max else 2) * each.triangles.size
            for each in _surfaces(stage)
        )
    )


def _surfaces(stage: Stage) -> Iterable[Surface]:
    for link in stage.links:
        yield from (*link.surfaces, *link.bodies)
    for obstacle in stage.obstacles:
        yield from obstacle.surfaces


def _coarser(stage: Stage, cell: float) -> Stage:
    def merged(surfaces: tuple[Surface, ...]) -> tuple[Surface, ...]:
        return tuple(_merged(each, cell) for each in surfaces)

    links = tuple(replace(link, surfaces=merged(link.surfaces), bodies=merged(link.bodies)) for link in stage.links)
    obstacles = tuple(replace(each, surfaces=merged(each.surfaces)) for each in stage.obstacles)
    return replace(stage, links=links, obstacles=obstacles)


def _merged(surface: Surface, cell: float) -> Surface:
    if len(surface.triangles) < FINE or surface.image is not None:  # a picture would no longer lie where it should
        return surface
    grid = np.floor(surface.vertices / cell).astype(np.int64)
    _, kind, count = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
    kind = kind.reshape(-1)
    means = np.column_stack([np.bincount(kind, surface.vertices[:, axis]) for axis in range(3)]) / count[:, None]
    corners = kind[surface.triangles]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    _, first = np.unique(np.sort(corners[whole], axis=1), axis=0, return_index=True)
    kept = corners[whole][first]
    return shade(means, kept, surface.rgba) if len(kept) else surface
