"""A run, or two compared, in sentences; what to do next about wrong answers; numbers as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.batch.totals import doubts_in_words, misranked_share
from verefine_viz.diagnosis.causes import ADVICE, STARVED_ADVICE, Cause, cause_title
from verefine_viz.methods.registry import METHODS, SEARCH
from verefine_viz.report.failure_cards import BOTH, ONLY_A, ONLY_B, Gallery
from verefine_viz.report.groups import names, seed_words
from verefine_viz.report.run_difference import Difference
from verefine_viz.report.run_results import LoadedRun, Numbers, data_set
from verefine_viz.run.record import Answer

DASH = "–"


def data_doubts(runs: Sequence[LoadedRun]) -> list[str]:
    """What of the runs' data does not fit together; of two runs each with its label."""
    doubts = [(run, doubts_in_words([(run.name, run.rows)])) for run in runs]
    return [f"{run.label}: {doubt}" if run.label else doubt for run, doubt in doubts if doubt]


def percent(share: float | None, digits: int = 0) -> str:
    """0.891 → 89 %; an infinite error is that of no answer."""
    if share is None or math.isnan(share):
        return DASH
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else "no answer"


def number(value: float | None, digits: int = 1, unit: str = "") -> str:
    """12.34 → 12.3 mm."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:,.{digits}f}".replace(",", "\u202f") + (f" {unit}" if unit else "")


def signed(value: float | None, digits: int = 1, unit: str = "") -> str:
    """A difference with its sign."""
    if value is None or not math.isfinite(value):
        return DASH
    # What rounds to nothing is no change: neither +0.0 nor −0.0.
    shown = f"{value:+.{digits}f}" if round(value, digits) else f"{0:.{digits}f}"
    return shown.replace("-", "−") + (f" {unit}" if unit else "")


def tone(gain: float, digits: int = 1) -> str:
    """``good``, ``bad``, or nothing where a gain shows as zero."""
    if math.isnan(gain) or round(min(max(gain, -1e9), 1e9), digits) == 0:
        return ""
    return "good" if gain > 0 else "bad"


def title(a: LoadedRun, b: LoadedRun | None = None) -> str:
    """What the report is about, whatever the sessions are called: a run, or what differs between two."""
    if b is None:
        return f"{a.method} on {data_set(a)}"
    pairs = (names((a.index.session, b.index.session)), (seed_words(a), seed_words(b)), (a.folder.name, b.folder.name))
    differing = [(x, y) for x, y in pairs[:2] if x != y] or [pairs[2]]
    of_a, of_b = (", ".join(parts) for parts in zip(*differing, strict=True))
    both = f"{a.method}: " if a.method == b.method else ""
    return f"{both}{of_a} (A) against {of_b} (B)"


def session_title(runs: Sequence[LoadedRun]) -> str:
    """The title of the runs' sessions; empty where they have different ones, or none."""
    titles = {run.index.session.title for run in runs}
    return titles.pop() if len(titles) == 1 else ""


def headline(run: LoadedRun, n: Numbers) -> str:
    """The run in a sentence."""
    objects = f"{n.n_objects} objects in {n.n_frames} frame{'s' * (n.n_frames != 1)}"
    if n.recall is None:
        return f"{run.method} on {objects}; without ground truth it is unknown which answers are right."
    right = round(n.recall * n.n_with_truth)
    recall = f"{run.method} got {right} of {n.n_with_truth} objects right (error below 10 % of the diameter)"
    rest = []
    if n.n_without_answer:
        rest.append(f"{n.n_without_answer} without a hypothesis")
    if n.n_left_out:
        rest.append(f"{n.n_left_out} left out as their mask or model cannot be used")
    if n.n_failed_frames:
        held = f" with {n.n_in_failed_frames} objects" if n.n_in_failed_frames else ""
        rest.append(f"{n.n_failed_frames} of {n.n_frames} frames failed as a whole{held}")
    missing = "".join(f" {note}." for note in run.index.notes)
    return f"{recall}{'; ' * bool(rest)}{', '.join(rest)}.{missing}"


def score_sentence(run: LoadedRun) -> str:
    """Whether the score can be trusted."""
    share = misranked_share(run.objects)
    if share is None:
        return "There are not both right and wrong answers with a score, so it is unknown whether the score misleads."
    n_right = sum(row.is_correct is True for row in run.objects)
    n_wrong = sum(row.is_correct is False for row in run.objects)
    verdict = "mostly separates right from wrong"
    if share < 0.1:
        verdict = "separates right from wrong"
    elif share > 0.3:
        verdict = "often misleads"
    return (
        f"The score {verdict}: of all pairs of a wrong and a right answer, the wrong one scores higher in {share:.0%} "
        f"({n_wrong} wrong, {n_right} right). Crosses in the upper right are where it misleads."
    )


def difference_sentence(difference: Difference) -> str:
    """What changed from A to B."""
    right = sum(c.turned == "now right" for c in difference.changes)
    wrong = sum(c.turned == "now wrong" for c in difference.changes)
    left = [f"{n} only in {side}" for n, side in ((difference.only_a, "A"), (difference.only_b, "B")) if n]
    return (
        f"Of {len(difference.changes)} objects that both runs have, B is better in {len(difference.better)} and worse "
        f"in {len(difference.worse)}; {right} became right, {wrong} became wrong."
        + (f" Left out: objects {' and '.join(left)}." if left else "")
    )


def pair_failures_sentence(failures: Gallery, has_truth: bool) -> str:
    """What the gallery of two compared runs shows."""
    n_shown = len(failures.failures)
    if not has_truth or not n_shown:
        return failures_sentence(n_shown, failures.n_more, has_truth)
    counts = Counter(card.pick.group for card in failures.failures)
    listed = ", ".join(f"{counts[kind]} {kind}" for kind in (ONLY_A, ONLY_B, BOTH) if counts[kind])
    more = f"; {failures.n_more} more in the runs' frames.csv" if failures.n_more else ""
    return f"{n_shown} object{'s' * (n_shown != 1)} that one run or both got wrong, worst first: {listed}{more}."


def failures_sentence(n_shown: int, n_more: int, has_truth: bool) -> str:
    """What the gallery shows."""
    if not n_shown:
        hidden = f"{n_more} failures, none of them shown (--failures)."
        return hidden if n_more else "Nothing that could be solved came out wrong."
    what = "failure" if has_truth else "object"
    order = "worst first" if has_truth else "what cannot be, then the lowest score first, as there is no ground truth"
    more = f"; {n_more} more in frames.csv" if n_more else ""
    return f"{n_shown} {what}{'s' * (n_shown != 1)}, {order}{more}."


FEW = 5
"""Wrong answers below this number say little about other frames."""
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
"""The same for methods to which other settings matter."""


@dataclass(frozen=True)
class NextStep:
    """A sentence that ends with the answer to begin with."""

    text: str
    """Up to that answer."""
    begin: Answer


def next_step(run: LoadedRun) -> NextStep | None:
    """What to do next about a run's wrong answers, from their causes; None where there is nothing to do."""
    wrong = run.failures
    if not wrong:
        return None
    if not run.with_truth:
        worst = "the lowest score" if wrong[0].status == "ok" else "one that has no answer"
        worst = "one that is physically impossible" if wrong[0].cause == Cause.IMPOSSIBLE else worst
        return NextStep(f"Which answers are wrong is not known; begin with {worst},", wrong[0])
    counts = Counter(row.cause for row in wrong if row.cause).most_common()
    if not counts:
        return NextStep(f"No cause is known for {_of(len(wrong))}; begin with the worst,", wrong[0])
    most = counts[0][1]
    first = [cause for cause, n in counts if n == most]
    if len(first) > 1:
        listed = ", ".join(f"{cause_title(cause)} {n}" for cause, n in counts)
        return NextStep(f"No cause stands out among {_of(len(wrong))} ({listed}); begin with the worst,", wrong[0])
    mine = [row for row in wrong if row.cause == first[0]]
    return NextStep(
        f"{_lead(run, wrong, counts)}{_in_common(mine)}: {advice(first[0], run.method)}; begin with", mine[0]
    )


def advice(cause: str, method: str) -> str:
    """What to try against a cause; of one that this version does not know, where to look."""
    if cause not in set(Cause):
        return "look at the cards below"
    return OWN_ADVICE.get(method, {}).get(Cause(cause), ADVICE[Cause(cause)])


def _lead(run: LoadedRun, wrong: Sequence[Answer], counts: Sequence[tuple[str, int]]) -> str:
    cause, n = counts[0]
    title = cause_title(cause)
    if len(wrong) == 1:
        return f"The only wrong answer of {len(run.with_truth)} has the cause “{title}”"
    n_unknown = len(wrong) - sum(m for _, m in counts)
    others = [f"next: {_shown(counts[1:])}"] if len(counts) > 1 else []
    others += [f"{n_unknown} not explained"] if n_unknown else []
    others += ["few cases, which say little about other frames"] if len(wrong) < FEW else []
    lead = f"{n} of {_of(len(wrong))} {'has' if n == 1 else 'have'} the cause “{title}”"
    return lead + (f" ({'; '.join(others)})" if others else "")


def _shown(counts: Sequence[tuple[str, int]]) -> str:
    """``collider too coarse 2``; ``collider too coarse and budget too small 1 each``: the most frequent of these."""
    n = counts[0][1]
    titles = [cause_title(cause) for cause, m in counts if m == n]
    return f"{' and '.join(titles)} {n}{' each' * (len(titles) > 1)}"


def _in_common(rows: Sequence[Answer]) -> str:
    """What all of several answers share, if anything."""
    if len(rows) < 2:
        return ""
    names, frames = {row.name for row in rows}, {row.frame for row in rows}
    if len(names) == 1 and rows[0].name:
        return f", all of them of the {rows[0].name}"
    return f", all in frame {rows[0].frame}" if len(frames) == 1 else ""


def _of(n: int) -> str:
    return f"{n} wrong answers" if n != 1 else "the only wrong answer"
