"""Which failures of several groups get a card."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from verefine_viz.report.gallery import Gallery, Pick, gallery_of
from verefine_viz.report.groups import Group, seeds_of
from verefine_viz.report.loaded import Key, Loaded, key, relative_error


def group_gallery(groups: Sequence[Group], most: int, tell: Callable[[int, int], None]) -> Gallery:
    """The worst failures of each group, as many of each; an object comes once a group, with its worst seed.

    Args:
        groups: in the order in which they take what does not divide evenly.
        most: cards of all groups together.
        tell: told how many cards are done, and how many there are.
    """
    shares = [most // len(groups) + (k < most % len(groups)) for k in range(len(groups))]
    picks = [pick for group, share in zip(groups, shares, strict=True) for pick in _picks(group, share)]
    picks.sort(key=lambda pick: -_error(pick))
    n_failures = sum(len(run.failures) for group in groups for run in group.runs)
    return gallery_of(picks, n_failures, tell)


def _picks(group: Group, most: int) -> list[Pick]:
    failed: dict[Key, list[Pick]] = {}
    for run in group.runs:
        for row in run.failures:
            failed.setdefault(key(row), []).append(Pick(run, row, group=group.name, remark=_remark(run)))
    worst = [max(mine, key=_error) for mine in failed.values()]
    worst.sort(key=lambda pick: -_error(pick))
    n_runs = len(group.runs)
    return [
        Pick(p.run, p.row, group=p.group, remark=f"{p.remark} · wrong in {len(failed[key(p.row)])} of {n_runs} runs")
        for p in worst[:most]
    ]


def _remark(run: Loaded) -> str:
    of_poses, of_method = seeds_of(run)
    seeds = f"seed {of_poses}" if of_poses == of_method else f"seeds {of_poses}, {of_method}"
    return f"{run.folder.name} ({seeds})"


def _error(pick: Pick) -> float:
    """What is worst comes first: no answer, then the error; without ground truth the lowest score."""
    if pick.row.status != "ok":
        return float("inf")
    error = relative_error(pick.row)
    return error if error is not None else -(pick.row.score or 0.0)
