"""Which objects get a card where two runs are compared: those that one of them, or both, got wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.report.gallery import Gallery, Pick, gallery_of
from verefine_viz.report.loaded import Loaded, key

ONLY_A, ONLY_B, BOTH = "only A wrong", "only B wrong", "both wrong"


def pair_gallery(a: Loaded, b: Loaded, most: int, tell: Callable[[int, int], None]) -> Gallery:
    """What the runs got wrong, an object once, worst first; what only one got wrong is shown as often as what both did.

    Without ground truth nobody knows what is wrong: then the lowest scores of A.

    Args:
        a: one run.
        b: the other.
        most: how many are shown.
        tell: told how many cards are done, and how many there are.
    """
    if not a.with_truth and not b.with_truth:
        return gallery_of([Pick(a, row, b) for row in a.failures[:most]], len(a.failures), tell)
    found = _wrong(a, b)
    shown = [pick for picks, n in zip(found, shared_out(most, [len(mine) for mine in found]), strict=True)
             for pick in picks[:n]]  # fmt: skip
    shown.sort(key=lambda pick: -pick.badness)
    return gallery_of(shown, sum(map(len, found)), tell)


def shared_out(most: int, sizes: Sequence[int]) -> list[int]:
    """How many each of several lists may show: the same, and what one does not need goes to the others."""
    shares = [0] * len(sizes)
    for _ in range(max(sizes, default=0)):
        for k, size in enumerate(sizes):
            if shares[k] < size and sum(shares) < most:
                shares[k] += 1
    return shares


def _wrong(a: Loaded, b: Loaded) -> list[list[Pick]]:
    """What only A, only B and both got wrong, each worst first; a card is that of the run whose answer is worse."""
    of_a, of_b = ({key(row): row for row in run.failures} for run in (a, b))
    both = [max(Pick(a, row, b, BOTH), Pick(b, of_b[k], a, BOTH), key=lambda pick: pick.badness)
            for k, row in of_a.items() if k in of_b]  # fmt: skip
    both.sort(key=lambda pick: -pick.badness)
    return [_alone(a, b, ONLY_A), _alone(b, a, ONLY_B), both]


def _alone(run: Loaded, other: Loaded, kind: str) -> list[Pick]:
    """What ``run`` got wrong and ``other`` did not."""
    theirs = {key(row) for row in other.failures}
    return [Pick(run, row, other, kind, _absent(other, row)) for row in run.failures if key(row) not in theirs]


def _absent(other: Loaded, row: ObjectRow) -> str:
    """Why the other run says nothing about an object; empty where it does."""
    there = other.row_of(row)
    if there is None:
        return f"{other.label} does not have it"
    return "" if there.was_asked_for else f"{other.label} was not asked for it: {there.message}"
