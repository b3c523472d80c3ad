"""A comparison of groups in sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import accumulate

from verefine_viz.report import run_sentences as words
from verefine_viz.report.bootstrap import Spread
from verefine_viz.report.failure_cards import Gallery
from verefine_viz.report.group_comparison import Comparison, Line
from verefine_viz.report.groups import seeds_of
from verefine_viz.report.run_sentences import percent, signed

MOST_LETTERS = 48
"""Of groups that a sentence names; more are counted."""


def headline(comparison: Comparison) -> str:
    """Which group is best, and by how much; or why that is unknown."""
    best, *others = comparison.lines
    if best.recall is None:
        return f"{counted(comparison)}; without ground truth it is unknown which is best."
    right = f"{best.name} gets {percent(best.recall.value, 1)} of the objects right{_interval(best.recall, 100, '%')}"
    rivals = [line for line in others if line.behind is not None]
    if not rivals:
        return f"{right}."
    if all(line.recall and line.recall.value == best.recall.value for line in rivals):
        share = percent(best.recall.value, 1)
        return f"All {len(comparison.lines)} groups get the same share of the objects right: {share}."
    if not any(line.behind.low is not None for line in rivals if line.behind):
        return f"{right}, {_by(rivals[0])}; one frame and one seed say nothing about how certain that is."
    close = [line for line in rivals if line.behind and not line.behind.is_clear]
    if not close:
        return f"{right}: the best, {_by(rivals[0])}."
    clear = [line for line in rivals if line.behind and line.behind.is_clear]
    nearest = f"{close[0].name} by {_points(close[0].behind)}"
    noise = f"{names(close)} differ{'s' * (len(close) == 1)} within the noise, {nearest}"
    behind = f" Clearly behind: {names(clear)}." if clear else ""
    return f"No group is clearly best. {right}; {noise}.{behind}"


def explanation(comparison: Comparison) -> str:
    """What the intervals mean."""
    n_units, n_seeds = comparison.axes.shape
    unit = "scene" if comparison.axes.by_scene else "frame"
    drawn = f"{n_units} {unit}{'s' * (n_units != 1)} and {n_seeds} seed{'s' * (n_seeds != 1)}"
    return (
        f"Small: 95 % intervals, by drawing {drawn} 1000 times (bootstrap). Differences are taken under the same "
        "draws, over the frames and seeds that both groups have: they can be clear where the intervals overlap."
    )


def title(comparison: Comparison) -> str:
    """What is compared, whatever the sessions are called."""
    groups, n = comparison.groups, len(comparison.lines)
    if n == 1:
        first = groups[0].runs[0]
        n_seeds = len({seeds_of(run) for run in groups[0].runs})
        return f"{words.title(first)}, {n_seeds} seed{'s' * (n_seeds != 1)}"
    methods = {group.method for group in groups}
    what = "groups"
    if all(group.name == group.method for group in groups):
        what = "methods"
    elif len(methods) == 1:
        what = f"settings of {groups[0].method}"
    return f"{n} {what} compared: {names(comparison.lines)}"


def failures_sentence(comparison: Comparison, failures: Gallery) -> str:
    """What the gallery shows of each group."""
    n_shown, n_groups = len(failures.failures), len(comparison.lines)
    if not n_shown or n_groups == 1 or not comparison.has_truth:
        return words.failures_sentence(n_shown, failures.n_more, comparison.has_truth)
    most = max(Counter(card.pick.group for card in failures.failures).values())
    shown = f"The worst objects of each group, up to {most}, each with its worst seed"
    more = f"; {failures.n_more} more wrong answers in the runs' frames.csv" if failures.n_more else ""
    return f"{shown}{more}."


def counted(comparison: Comparison) -> str:
    """How much was compared."""
    n_groups, n_runs = len(comparison.lines), sum(len(line.group.runs) for line in comparison.lines)
    n_frames = len(comparison.axes.frames)
    return (
        f"{n_groups} group{'s' * (n_groups != 1)}, {n_runs} run{'s' * (n_runs != 1)}, "
        f"{n_frames} frame{'s' * (n_frames != 1)}"
    )


def names(lines: Sequence[Line]) -> str:
    """``sir, even and 3 more``: as many as fit."""
    ends = accumulate(len(line.name) + 2 for line in lines)
    shown = [line.name for line, end in zip(lines, ends, strict=True) if end <= MOST_LETTERS] or [lines[0].name]
    n_more = len(lines) - len(shown)
    if n_more:
        return f"{', '.join(shown)} and {n_more} more"
    return f"{', '.join(shown[:-1])} and {shown[-1]}" if len(shown) > 1 else "".join(shown)


def _by(second: Line) -> str:
    """``4.1 points more than sir, the next (95 %: 1.2 to 7.0)``."""
    assert second.behind is not None
    ahead = second.behind
    low, high = (None, None) if ahead.low is None or ahead.high is None else (-ahead.high, -ahead.low)
    more = 0.0 - ahead.value  # A tie is 0.0, not -0.0.
    return f"{100 * more:.1f} points more than {second.name}{_interval(Spread(more, low, high), 100)}"


def _points(difference: Spread | None) -> str:
    assert difference is not None
    return f"{signed(100 * difference.value)} points{_interval(difference, 100)}"


def _interval(spread: Spread, factor: float, unit: str = "") -> str:
    if spread.low is None or spread.high is None:
        return ""
    low, high = (f"{factor * end:.1f}".replace("-0.0", "0.0").replace("-", "−") for end in (spread.low, spread.high))
    return f" (95 %: {low} to {high}{' ' * bool(unit)}{unit})"
