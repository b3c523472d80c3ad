"""The sentences of a report: its title, which group is best, and what to do next about wrong answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from verefine_viz.core.causes import STARVED_ADVICE, Cause, advice_on, cause_title
from verefine_viz.evaluation.bootstrap import DRAWS, Spread
from verefine_viz.methods.known_methods import METHODS, SEARCH
from verefine_viz.page.gallery import outcome_words
from verefine_viz.report.group_numbers import GroupComparison
from verefine_viz.report.groups import Group, Section, seeds_of
from verefine_viz.run.record import Answer

MOST_LETTERS = 48
"""Most letters of the group names in a sentence; further groups are counted."""
FEW = 5
"""Fewer wrong answers than this say little about other frames."""
_FIRST_ONLY = "each came right from another hypothesis than the first, the only one that this method looks at"
OWN_ADVICE = {
    **{
        name: {Cause.ARM_STARVED: f"{_FIRST_ONLY}, so try one that looks at all, such as rir"}
        for name, method in METHODS.items()
        if method.first_only
    },
    "even": {Cause.ARM_STARVED: f"{STARVED_ADVICE}more iterations (method.iterations)"},
    "expl": {Cause.ARM_STARVED: f"{STARVED_ADVICE}a method that explores, such as rir"},
    SEARCH: {
        Cause.ARM_STARVED: f"{STARVED_ADVICE}more expansions (mcts.expansions)",
        Cause.BUDGET: "try more expansions (mcts.expansions)",
    },
}
"""Advice for methods to which other settings matter."""


@dataclass(frozen=True)
class NextStep:
    """A recommendation: a sentence that ends with the answer to begin with."""

    text: str
    """The sentence up to that answer."""
    begin: Answer


def title(sections: Sequence[Section]) -> str:
    """The report's title, whatever the sessions are called."""
    if len(sections) > 1:
        n_runs = sum(len(section.runs) for section in sections)
        return f"{n_runs} runs on {len(sections)} sets of data"
    section = sections[0]
    named = [group.name for group in section.groups]
    if section.pair:
        return f"{named[0]} against {named[1]} on {section.data}"
    if len(named) > 1:
        return f"{listed(named)} on {section.data}"
    n_seeds = len({seeds_of(run) for run in section.runs})
    seeds = f", {n_seeds} seeds" if n_seeds > 1 else ""
    return f"{section.groups[0].method} on {section.data}{seeds}"


def headline(comparison: GroupComparison) -> str:
    """The result: how many objects are right, or which group is best, and by how much."""
    best, lines = comparison.best, comparison.lines
    if len(lines) == 1:
        return f"{outcome_words(best.group.rows, len(best.group.runs))}."
    recall = best.numbers.get("recall")
    if recall is None:
        return "Without ground truth it is unknown which is best."
    right = f"{best.name} gets {100 * recall.value:.1f} % of the objects right{_interval(recall, ' %')}"
    rivals = [(line, line.behind) for line in lines if line.behind is not None]
    rivals.sort(key=lambda one: -one[1].value)
    if not rivals:
        return f"{right}."
    if all(line.numbers["recall"].value == recall.value for line, _ in rivals):
        every = "Both" if len(lines) == 2 else f"All {len(lines)}"
        return f"{every} get the same share of the objects right: {100 * recall.value:.1f} %."
    name, behind = rivals[0][0].name, rivals[0][1]
    ahead = f"{-100 * behind.value + 0.0:.1f} points more than {name}{_interval(_negative(behind))}"
    if behind.low is None:
        return f"{right}, {ahead}; one frame of one object says nothing about how certain that is."
    close = [line.name for line, by in rivals if not by.is_clear]
    if not close:
        return f"{right}: the best, {ahead}."
    clear = [line.name for line, by in rivals if by.is_clear]
    return f"None is clearly best. {right}, {ahead}; {listed(close)} within the noise." + (
        f" Clearly behind: {listed(clear)}." if clear else ""
    )


def explanation(comparison: GroupComparison) -> str:
    """What the intervals mean; empty where there are none."""
    n_units, n_models = comparison.axes.shape
    if n_units == n_models == 1:
        return ""
    unit = "scene" if comparison.axes.by_scene else "frame"
    several = any(len(line.group.runs) > 1 for line in comparison.lines)
    drawn = f"{n_units} {unit}{'s' * (n_units != 1)} and {n_models} object{'s' * (n_models != 1)}"
    seeds = ", each with all its seeds" if several else ""
    paired = "; differences over the objects that both have, under the same draws" if len(comparison.lines) > 1 else ""
    return f"Intervals: 95 %, bootstrap over {drawn}{seeds}, drawn {DRAWS} times{paired}."


def next_step(group: Group) -> NextStep | None:
    """What to do next about a group's wrong answers, from their causes; None where there is nothing to do."""
    wrong = group.failures
    if not wrong:
        return None
    if not group.with_truth:
        worst = "the lowest score" if wrong[0].status == "ok" else "one that has no answer"
        worst = "one that is physically impossible" if wrong[0].cause == Cause.IMPOSSIBLE else worst
        return NextStep(f"Which answers are wrong is not known; begin with {worst},", wrong[0])
    counts = Counter(row.cause for row in wrong if row.cause).most_common()
    if not counts:
        return NextStep(f"No cause is known for {_of(len(wrong))}; begin with the worst,", wrong[0])
    first = [cause for cause, n in counts if n == counts[0][1]]
    if len(first) > 1:
        causes = ", ".join(f"{cause_title(cause)} {n}" for cause, n in counts)
        return NextStep(f"No cause stands out among {_of(len(wrong))} ({causes}); begin with the worst,", wrong[0])
    mine = [row for row in wrong if row.cause == first[0]]
    lead = _lead(len(group.with_truth), len(wrong), counts)
    return NextStep(f"{lead}{_shared_facts(mine)}: {advice(first[0], group.method)}; begin with", mine[0])


def advice(cause: str, method: str) -> str:
    """What to try against a cause; for one that this version does not know, where to look."""
    if cause not in set(Cause):
        return "look at the cards below"
    return OWN_ADVICE.get(method, {}).get(Cause(cause), advice_on(cause))


def listed(names: Sequence[str]) -> str:
    """``sir, even and 3 more``: as many as fit."""
    ends = accumulate(len(name) + 2 for name in names)
    shown = [name for name, end in zip(names, ends, strict=True) if end <= MOST_LETTERS] or [names[0]]
    n_more = len(names) - len(shown)
    if n_more:
        return f"{', '.join(shown)} and {n_more} more"
    return f"{', '.join(shown[:-1])} and {shown[-1]}" if len(shown) > 1 else shown[0]


def counted(sections: Sequence[Section]) -> str:
    """``2 groups, 4 runs, 3 frames``."""
    groups = [group for section in sections for group in section.groups]
    numbers = {
        "group": len(groups),
        "run": sum(len(group.runs) for group in groups),
        "frame": sum(len(section.frames) for section in sections),
    }
    return ", ".join(f"{n} {what}{'s' * (n != 1)}" for what, n in numbers.items() if n > 1 or what == "frame")


def _negative(spread: Spread) -> Spread:
    if spread.low is None or spread.high is None:
        return spread
    return Spread(-spread.value, -spread.high, -spread.low)


def _interval(spread: Spread, unit: str = "") -> str:
    if spread.low is None or spread.high is None:
        return ""
    low, high = (f"{100 * end + 0.0:.1f}".replace("-0.0", "0.0").replace("-", "−") for end in (spread.low, spread.high))
    return f" (95 %: {low} to {high}{unit})"


def _lead(n_objects: int, n_wrong: int, counts: Sequence[tuple[str, int]]) -> str:
    cause, n = counts[0]
    if n_wrong == 1:
        return f"The only wrong answer of {n_objects} has the cause “{cause_title(cause)}”"
    n_unknown = n_wrong - sum(m for _, m in counts)
    others = [f"next: {_shown(counts[1:])}"] if len(counts) > 1 else []
    others += [f"{n_unknown} not explained"] if n_unknown else []
    others += ["few cases, which say little about other frames"] if n_wrong < FEW else []
    lead = f"{n} of {_of(n_wrong)} {'has' if n == 1 else 'have'} the cause “{cause_title(cause)}”"
    return lead + (f" ({'; '.join(others)})" if others else "")


def _shown(counts: Sequence[tuple[str, int]]) -> str:
    """``collider too coarse 2``; ``collider too coarse and budget too small 1 each``: the most frequent of these."""
    n = counts[0][1]
    titles = [cause_title(cause) for cause, m in counts if m == n]
    return f"{' and '.join(titles)} {n}{' each' * (len(titles) > 1)}"


def _shared_facts(rows: Sequence[Answer]) -> str:
    """What several answers have in common, if anything."""
    if len(rows) < 2:
        return ""
    names, frames = {row.name for row in rows}, {row.frame for row in rows}
    if len(names) == 1 and rows[0].name:
        return f", all of them of the {rows[0].name}"
    return f", all in frame {rows[0].frame}" if len(frames) == 1 else ""


def _of(n: int) -> str:
    return f"{n} wrong answers" if n != 1 else "the only wrong answer"
