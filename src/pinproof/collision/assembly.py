"""What a checker is made of: bodies, the pairs of them that are checked, and both packed for compiled loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision.bodies import Body, shape_bodies
from pinproof.collision.pairs import ALLOWED_BY_CALLER, ExcludedPair, PairRules, Pairs, choose_pairs
from pinproof.collision.scene import Obstacle, Scene
from pinproof.errors import InputError
from pinproof.model import Arm

if TYPE_CHECKING:
    from pinproof.kernels.world import World

__all__ = ["ROUNDING", "Assembly", "Known", "add_obstacle_bodies", "assemble", "keep_pairs", "leave_out"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

ROUNDING = 1e-9
"""Metres by which floating point may be off in placements and supports, for each metre the scene is wide (seen: 3e-9 m
at 100 m), with room. It is taken off every distance before anything is called free."""

Known = dict[tuple[int, str | None], tuple[Obstacle, tuple[Body, ...]]]
"""Bodies of obstacles that were made before, by the identity of the obstacle, which is kept for that, and its link."""


class Assembly(NamedTuple):
    """See the module."""

    bodies: tuple[Body, ...]
    """Links, what is attached, obstacles."""
    pairs: Pairs
    """What is checked."""
    rounding: float
    """Metres by which floating point may be off here."""
    world: World
    """The arrays, without margins."""
    at: Array
    """(B, 15) the placements of the bodies that never move."""
    still: Indices
    """The pairs between which no joint moves."""
    convex: npt.NDArray[np.bool_]
    """(P,) the pairs that need no coal."""
    known: Known
    """The obstacles' bodies, for the next assembly."""


def assemble(
    arm: Arm,
    links: Sequence[Body],
    scene: Scene,
    attached: Sequence[Obstacle],
    rules: PairRules,
    *,
    levels: Mapping[frozenset[str], int],
    allowed: Sequence[tuple[str, str]],
    known: Known,
) -> Assembly:
    """Put together an arm's links, what it holds, and a scene.

    Raises
    ------
    InputError, MeshError, UnknownNameError
        As :class:`pinproof.CollisionChecker` does.
    """
    from pinproof.collision.packed import convex_pairs, pack_world

    made: Known = {}
    added: list[Body] = []
    for link, obstacle in (*((arm.tcp, o) for o in attached), *((None, o) for o in scene.obstacles)):
        before = known.get((id(obstacle), link))
        if before is None or before[1][0].link_from_body != obstacle.pose:
            before = obstacle, tuple(shape_bodies(obstacle.name, link, obstacle.shape, obstacle.pose))
        made[id(obstacle), link] = before
        added.extend(before[1])
    bodies = (*links, *added)
    _check_names(bodies, arm.robot.urdf.links)
    pairs = choose_pairs(bodies, arm, scene, rules, levels=levels, allowed=allowed)
    rounding = ROUNDING * max((1.0, *(body.extent for body in bodies)))
    world, at, still = pack_world(arm, bodies, pairs.checked, rounding)
    return Assembly(bodies, pairs, rounding, world, at, still, convex_pairs(world), made)


def leave_out(made: Assembly, allowed: Sequence[tuple[str, str]]) -> Assembly | None:
    """The same bodies, with fewer pairs of them checked: what :func:`assemble` makes where more may touch.

    None where names stand for more than one body each, or for none: then it takes :func:`assemble` to tell.
    """
    order = {owner: i for i, owner in enumerate(dict.fromkeys(body.owner for body in made.bodies))}
    if any(name not in order for pair in allowed for name in pair) or any(len(set(pair)) != 2 for pair in allowed):
        return None
    moving = {body.owner for body in made.bodies if body.link is not None}
    named = {frozenset(pair) for pair in allowed if moving & set(pair)}
    owners = [body.owner for body in made.bodies]
    kept = [k for k, (i, j) in enumerate(made.pairs.checked) if frozenset((owners[i], owners[j])) not in named]
    excluded = [pair for pair in made.pairs.excluded if frozenset(pair.owners) not in named]
    for pair in named:
        first, second = sorted(pair, key=lambda owner: (owner not in moving, order[owner]))
        excluded.append(ExcludedPair((first, second), ALLOWED_BY_CALLER))
    excluded.sort(key=lambda pair: (pair.owners[1] not in moving, *(order[owner] for owner in pair.owners)))
    finer = [pair for pair in made.pairs.finer if frozenset(pair.owners) not in named]
    fewer = keep_pairs(made, np.array(kept, dtype=int))
    return fewer._replace(pairs=Pairs(fewer.pairs.checked, excluded, finer))


def keep_pairs(made: Assembly, kept: Indices) -> Assembly:
    """The same bodies, of which only the pairs with these indices, in increasing order, are checked."""
    checked = made.pairs.checked
    now = np.full(len(checked), -1)
    now[kept] = np.arange(len(kept))
    own, still = now[made.world.own], now[made.still]
    outer = np.where(made.world.outer >= 0, now[made.world.outer], -1) if len(now) else made.world.outer
    around = np.flatnonzero((outer >= 0).any(axis=1))[::-1]
    world = made.world._replace(pairs=made.world.pairs[kept], own=own[own >= 0], around=around, outer=outer)
    pairs = made.pairs._replace(checked=[checked[k] for k in kept.tolist()])
    return made._replace(pairs=pairs, world=world, still=still[still >= 0], convex=made.convex[kept])


def add_obstacle_bodies(arm: Arm, made: Assembly, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]) -> Assembly:
    """The same with more bodies of obstacles, appended to those there are, and more pairs of indices checked."""
    from pinproof.collision.packed import convex_pairs, pack_world

    every = (*made.bodies, *bodies)
    checked = sorted({*made.pairs.checked, *pairs})
    world, at, still = pack_world(arm, every, checked, made.rounding)
    return made._replace(
        bodies=every,
        pairs=made.pairs._replace(checked=checked),
        world=world,
        at=at,
        still=still,
        convex=convex_pairs(world),
    )


def _check_names(bodies: Sequence[Body], links: Sequence[str]) -> None:
    seen: set[str] = set()
    for body in bodies:
        if body.name in seen or (body.owner != body.link and body.name in links):
            raise InputError(f"the name {body.name!r} stands for two bodies; rename the obstacle or attached object")
        seen.add(body.name)
