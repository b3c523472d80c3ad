"""Which failures of several groups get a card."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

from verefine_viz.diagnosis.words import cause_title
from verefine_viz.report.gallery import Gallery, Pick, gallery_of
from verefine_viz.report.groups import Group, seed_words
from verefine_viz.report.loaded import Key, Loaded, key


def group_gallery(groups: Sequence[Group], most: int, tell: Callable[[int, int], None]) -> Gallery:
    """The worst failures of each group, as many of each; an object comes once a group, with its worst seed.

    Args:
        groups: in the order in which they take what does not divide evenly.
        most: cards of all groups together.
        tell: told how many cards are done, and how many there are.
    """
    shares = [most // len(groups) + (k < most % len(groups)) for k in range(len(groups))]
    picks = [pick for group, share in zip(groups, shares, strict=True) for pick in _picks(group, share)]
    picks.sort(key=lambda pick: -pick.badness)
    n_failures = sum(len(run.failures) for group in groups for run in group.runs)
    return gallery_of(picks, n_failures, tell)


def _picks(group: Group, most: int) -> list[Pick]:
    failed: dict[Key, list[Pick]] = {}
    for run in group.runs:
        for row in run.failures:
            failed.setdefault(key(row), []).append(Pick(run, row, group=group.name, remark=_remark(run)))
    worst = [max(mine, key=lambda pick: pick.badness) for mine in failed.values()]
    worst.sort(key=lambda pick: -pick.badness)
    return [replace(p, remark=f"{p.remark} · {_often(failed[key(p.row)], len(group.runs))}") for p in worst[:most]]


def _often(failed: Sequence[Pick], n_runs: int) -> str:
    """``wrong in 12 of 20 runs: best hypothesis tried too little 9, collider too coarse 3``."""
    said = f"wrong in {len(failed)} of {n_runs} runs"
    causes = Counter(pick.row.cause for pick in failed if pick.row.cause).most_common()
    if len(failed) < 2 or not causes:
        return said
    return f"{said}: {', '.join(f'{cause_title(cause)} {n}' for cause, n in causes)}"


def _remark(run: Loaded) -> str:
    return f"{run.folder.name} ({seed_words(run)})"
