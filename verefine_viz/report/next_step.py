"""What to do next about a run's wrong answers, from the causes that diagnosis found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.diagnosis.causes import Cause
from verefine_viz.diagnosis.words import DECLARE, cause_title
from verefine_viz.methods.registry import METHODS, SEARCH
from verefine_viz.report.loaded import Loaded

FEW = 5
"""Wrong answers below this number say little about other frames."""
_STARVED = "each came right when its best hypothesis got the whole budget, so try "
ADVICE = {
    Cause.SYMMETRIC: DECLARE,
    Cause.UNIT: "write the translations of the first poses in millimetres (hypotheses.files)",
    Cause.DEPTH: "look at the depth images and how they are registered",
    Cause.MASK: "look at where the masks leak or miss",
    Cause.NEIGHBOUR: "mend the objects first that were placed before them",
    Cause.SCORE: "more iterations will not help where a wrong pose scores highest, so look at the score's maps first",
    Cause.PLANE: "look at the support plane, or give gravity (scene.gravity)",
    Cause.COLLIDER: "try convex parts (physics.collider)",
    Cause.SIMULATION: "look at what the simulation pushed, and try it without (physics.enabled)",
    Cause.ARM_STARVED: f"{_STARVED}more iterations (method.iterations) or more exploration (method.exploration)",
    Cause.BUDGET: "try more iterations (method.iterations)",
    Cause.REFINER: "try another refiner, or other settings of it (method.refiner)",
    Cause.POOL: "no first pose led to the truth, so more or better ones are needed ([hypotheses])",
    Cause.NO_HYPOTHESIS: "without a first pose nothing is refined, so name further results files or an estimator "
    "(hypotheses.files, hypotheses.estimate)",
}
"""What to try, by cause."""
_FIRST_ONLY = "each came right from another hypothesis than the first, the only one that this method looks at"
OWN_ADVICE = {
    **{
        name: {Cause.ARM_STARVED: f"{_FIRST_ONLY}, so try one that looks at all, such as rir"}
        for name, method in METHODS.items()
        if method.first_only
    },
    "even": {Cause.ARM_STARVED: f"{_STARVED}more iterations (method.iterations)"},
    "expl": {Cause.ARM_STARVED: f"{_STARVED}a method that explores, such as rir"},
    SEARCH: {
        Cause.ARM_STARVED: f"{_STARVED}more expansions (mcts.expansions)",
        Cause.BUDGET: "try more expansions (mcts.expansions)",
    },
}
"""The same for methods to which other settings matter."""


@dataclass(frozen=True)
class NextStep:
    """A sentence that ends with the answer to begin with."""

    said: str
    """Up to that answer."""
    begin: ObjectRow


def next_step(run: Loaded) -> NextStep | None:
    """What the causes of a run's wrong answers ask for; None where there is nothing to do."""
    wrong = run.failures
    if not wrong:
        return None
    if not run.with_truth:
        worst = "the lowest score" if wrong[0].status == "ok" else "one that has no answer"
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
        return "look at what the cards below say"
    return OWN_ADVICE.get(method, {}).get(Cause(cause), ADVICE[Cause(cause)])


def _lead(run: Loaded, wrong: Sequence[ObjectRow], counts: Sequence[tuple[str, int]]) -> str:
    cause, n = counts[0]
    title = cause_title(cause)
    if len(wrong) == 1:
        return f"The only wrong answer of {len(run.with_truth)} has the cause “{title}”"
    n_unknown = len(wrong) - sum(m for _, m in counts)
    others = [f"next: {_shown(counts[1:])}"] if len(counts) > 1 else []
    others += [f"{n_unknown} not explained"] if n_unknown else []
    others += ["few cases, which say little about other frames"] if len(wrong) < FEW else []
    said = f"{n} of {_of(len(wrong))} {'has' if n == 1 else 'have'} the cause “{title}”"
    return said + (f" ({'; '.join(others)})" if others else "")


def _shown(counts: Sequence[tuple[str, int]]) -> str:
    """``collider too coarse 2``; ``collider too coarse and budget too small 1 each``: the most frequent of these."""
    n = counts[0][1]
    titles = [cause_title(cause) for cause, m in counts if m == n]
    return f"{' and '.join(titles)} {n}{' each' * (len(titles) > 1)}"


def _in_common(rows: Sequence[ObjectRow]) -> str:
    """What all of several answers share, if anything."""
    if len(rows) < 2:
        return ""
    names, frames = {row.name for row in rows}, {row.frame for row in rows}
    if len(names) == 1 and rows[0].name:
        return f", all of them of the {rows[0].name}"
    return f", all in frame {rows[0].frame}" if len(frames) == 1 else ""


def _of(n: int) -> str:
    return f"{n} wrong answers" if n != 1 else "the only wrong answer"
