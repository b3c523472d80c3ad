"""Which iteration of one run stands beside which of another.

Runs differ in length and in the order in which they take the objects, so iteration 17 of one says nothing about
iteration 17 of the other. What can be compared is an object after the same effort: the refiner calls spent on it. A
timeline is a walk through such moments. Along it each object goes forward in both runs, in the order of the first run;
what only the second has is put in as early as its own order allows. Where both runs have the same structure, moment k
is iteration k of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from verefine_viz.core.records import Iteration
from verefine_viz.session.trace import Trace, refiner_calls

Key = tuple[int, int, int]
"""(instance_id, refiner calls spent on it, which of several iterations with that number): names a moment while both
runs grow."""


@dataclass(frozen=True)
class Moment:
    """One object after the same number of refiner calls in both runs."""

    key: Key
    a: int | None
    """Index of A's iteration of this moment, from 1; None where A has none, and stays where it was."""
    b: int | None

    @property
    def instance_id(self) -> int:
        return self.key[0]

    @property
    def calls(self) -> int:
        return self.key[1]


@dataclass(frozen=True)
class Timeline:
    """All moments of two runs; place 0 is before the first."""

    moments: tuple[Moment, ...]

    def __len__(self) -> int:
        return len(self.moments)

    @cached_property
    def _places(self) -> dict[Key, int]:
        return {m.key: k for k, m in enumerate(self.moments, 1)}

    @cached_property
    def _of_a(self) -> dict[int, int]:
        return {m.a: k for k, m in enumerate(self.moments, 1) if m.a is not None}

    def place(self, key: Key | None) -> int | None:
        """Where that moment is, from 1; None = there is no such moment."""
        return self._places.get(key) if key is not None else None

    def of_a(self, index: int) -> int:
        """Where A's iteration ``index`` is; 0 before the first."""
        return self._of_a.get(index, 0)

    def a_at(self, place: int) -> int:
        """The latest iteration that A has made at that place; 0 = none."""
        return max((m.a for m in self.moments[:place] if m.a is not None), default=0)

    def latest(self, place: int, instance_id: int) -> tuple[int, int]:
        """The last iterations of A and of B on an object up to a place; 0 = none yet."""
        a = b = 0
        for moment in self.moments[:place]:
            if moment.instance_id == instance_id:
                a, b = moment.a or a, moment.b or b
        return a, b


def keys_of(iterations: Sequence[Iteration]) -> tuple[Key, ...]:
    """The moment at which each iteration is."""
    calls: dict[int, int] = {}
    seen: dict[tuple[int, int], int] = {}
    keys: list[Key] = []
    for iteration in iterations:
        own = iteration.instance_id
        calls[own] = calls.get(own, 0) + refiner_calls(iteration)
        n = seen.get((own, calls[own]), 0)
        seen[own, calls[own]] = n + 1
        keys.append((own, calls[own], n))
    return tuple(keys)


def aligned(a: Trace, b: Trace) -> Timeline:
    """The timeline of two runs: every iteration of both is in one moment."""
    keys_a, keys_b = keys_of(a.iterations), keys_of(b.iterations)
    in_b = {key: k for k, key in enumerate(keys_b, 1)}
    in_a = set(keys_a)
    only_b = [key for key in keys_b if key not in in_a]
    last_of_a = {key[0]: k for k, key in enumerate(keys_a)}
    moments: list[Moment] = []
    placed: set[Key] = set()

    def put(key: Key, k: int | None) -> None:
        moments.append(Moment(key, k, in_b.get(key)))
        placed.add(key)

    def follows(key: Key, now: int) -> bool:
        """Whether B alone goes on here: A is through with the object, and B's iteration before is placed."""
        before = keys_b[in_b[key] - 2] if in_b[key] > 1 else None
        return last_of_a.get(key[0], -1) <= now and (before is None or before in placed)

    for now, key in enumerate(keys_a):
        for waiting in [w for w in only_b if w[0] == key[0] and w < key]:
            put(waiting, None)
            only_b.remove(waiting)
        put(key, now + 1)
        while only_b and follows(only_b[0], now):
            put(only_b.pop(0), None)
    for key in only_b:
        put(key, None)
    return Timeline(tuple(moments))
