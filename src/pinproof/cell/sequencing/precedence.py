"""Which picks must be executed before which others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from pinproof.errors import InputError, UnknownNameError

Pair = tuple[int, int]


@dataclass(frozen=True)
class Precedence:
    """Pairs (before, after) of indices of picks, each with its reason.

    Parameters
    ----------
    names
        The names of the picks.
    reasons
        Why the first pick of each pair must be executed before the second.
    """

    names: tuple[str, ...]
    reasons: Mapping[Pair, str] = field(default_factory=dict)

    @classmethod
    def stated(cls, names: Iterable[str], pairs: Iterable[tuple[str, str]]) -> Precedence:
        """The precedence that pairs of names (before, after) state.

        Raises
        ------
        UnknownNameError
            If a pair names a pick that does not exist.
        InputError
            If the pairs contradict each other; the message names a cycle.
        """
        empty = cls(tuple(names))
        reasons = {tuple(empty.index(name, "the precedence") for name in pair): "stated" for pair in pairs}
        return cls(empty.names, reasons).checked()  # type: ignore[arg-type]  # pairs

    def index(self, name: str, where: str) -> int:
        """The index of a pick; UnknownNameError if it does not exist."""
        if name not in self.names:
            raise UnknownNameError("pick", name, self.names, where)
        return self.names.index(name)

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """The names of the first and the second pick of each pair, and the reason."""
        return [(self.names[a], self.names[b], reason) for (a, b), reason in self.reasons.items()]

    def with_pairs(self, reasons: Mapping[Pair, str]) -> Precedence:
        """The precedence with more pairs; the reasons of existing pairs are kept."""
        return Precedence(self.names, {**reasons, **self.reasons})

    def of(self, kept: Sequence[int]) -> Precedence:
        """The precedence of some of the picks."""
        new = {old: k for k, old in enumerate(kept)}
        pairs = {(new[a], new[b]): why for (a, b), why in self.reasons.items() if a in new and b in new}
        return Precedence(tuple(self.names[i] for i in kept), pairs)

    def checked(self) -> Precedence:
        """The same precedence, if an order satisfies it.

        Raises
        ------
        InputError
            If the pairs contradict each other; the message names a shortest cycle that was found, with its reasons.
        """
        if cycle := self.cycle():
            steps = [
                f"{self.names[a]} before {self.names[b]} ({self.reasons[a, b]})"
                for a, b in zip(cycle, (*cycle[1:], cycle[0]), strict=True)
            ]
            raise InputError(f"the precedence of the picks is contradictory: {', '.join(steps)}")
        return self

    def cycle(self) -> tuple[int, ...]:
        """Indices of picks each of which must be executed before the next, and the last before the first; or empty."""
        after = self.successors()
        left = {i: set(before) for i, before in enumerate(self.predecessors())}
        ready = [i for i, before in left.items() if not before]
        while ready:  # Kahn (1962): what remains is part of a cycle or behind one
            done = ready.pop()
            del left[done]
            for other in after[done]:
                left[other].discard(done)
                if not left[other]:
                    ready.append(other)
        if not left:
            return ()
        found: list[list[int]] = []
        for start in left:
            came: dict[int, int] = {}
            queue = [start]
            for here in queue:
                for other in after[here]:
                    if other in left and other not in came:
                        came[other] = here
                        queue.append(other)
            if start in came:
                path = [start]
                while came[path[-1]] != start:
                    path.append(came[path[-1]])
                found.append(path[::-1])
        shortest = min(found, key=len)
        at = shortest.index(min(shortest))
        return (*shortest[at:], *shortest[:at])

    def predecessors(self) -> list[set[int]]:
        """For each pick the picks that must be executed before it."""
        found: list[set[int]] = [set() for _ in self.names]
        for before, after in self.reasons:
            found[after].add(before)
        return found

    def successors(self) -> list[set[int]]:
        """For each pick the picks that must be executed after it."""
        found: list[set[int]] = [set() for _ in self.names]
        for before, after in self.reasons:
            found[before].add(after)
        return found

    def allows(self, order: Iterable[int]) -> bool:
        """Whether an order of all picks satisfies every pair."""
        place = {pick: k for k, pick in enumerate(order)}
        return all(place[before] < place[after] for before, after in self.reasons)
