"""What can have gone wrong, what a diagnosis reports, and numbers in its sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal


class Cause(StrEnum):
    """Why an answer is wrong or missing, in the order in which causes are tested: what was given, what was done.

    Without a hypothesis nothing was done, so that nothing else is tested. The last one is of answers without ground
    truth.
    """

    GROUND_TRUTH = "ground_truth"
    SYMMETRIC = "symmetric"
    UNIT = "unit"
    DEPTH = "depth"
    MASK = "mask"
    NEIGHBOUR = "neighbour"
    SCORE = "score"
    PLANE = "plane"
    COLLIDER = "collider"
    DISCARDED = "discarded"
    AMBIGUOUS = "ambiguous"
    SIMULATION = "simulation"
    ARM_STARVED = "arm_starved"
    BUDGET = "budget"
    OUT_OF_RANGE = "out_of_range"
    REFINER = "refiner"
    POOL = "pool"
    UNDECIDED = "undecided"
    NO_HYPOTHESIS = "no_hypothesis"
    IMPOSSIBLE = "impossible"


TITLES: dict[Cause, str] = {
    Cause.GROUND_TRUTH: "ground truth does not fit its image",
    Cause.SYMMETRIC: "symmetry of the shape not declared",
    Cause.UNIT: "initial poses in another unit",
    Cause.DEPTH: "depth missing or unregistered",
    Cause.MASK: "mask leaks or misses",
    Cause.NEIGHBOUR: "neighbour misplaced first",
    Cause.SCORE: "score ranks a wrong pose above the ground truth",
    Cause.PLANE: "wrong support plane",
    Cause.COLLIDER: "collider too coarse",
    Cause.DISCARDED: "correct pose discarded for one that scores more",
    Cause.AMBIGUOUS: "the observation cannot tell two poses apart",
    Cause.SIMULATION: "simulation pushed it away",
    Cause.ARM_STARVED: "best hypothesis tried too little",
    Cause.BUDGET: "budget too small",
    Cause.OUT_OF_RANGE: "refiner out of its training range",
    Cause.REFINER: "refiner diverged or got stuck",
    Cause.POOL: "no good hypothesis in the pool",
    Cause.UNDECIDED: "undecided: between two basins",
    Cause.NO_HYPOTHESIS: "no hypothesis at all",
    Cause.IMPOSSIBLE: "physically impossible where it is",
}
"""For tables, bar charts, filters."""
DECLARE = "declare the symmetry in models_info.json if shape is all that matters"
"""What to do where an answer is wrong only by a turn that leaves the object's shape as it is."""
STARVED_ADVICE = "each came right when its best hypothesis got the whole budget, so try "
ADVICE: dict[Cause, str] = {
    Cause.GROUND_TRUTH: "compare the axes of the meshes and the frame of the poses with what the data set says; until "
    "they fit, no error means anything",
    Cause.SYMMETRIC: DECLARE,
    Cause.UNIT: "write the translations of the initial poses in millimetres (hypotheses.files)",
    Cause.DEPTH: "look at the depth images and how they are registered",
    Cause.MASK: "look at where the masks leak or miss",
    Cause.NEIGHBOUR: "mend the objects first that were placed before them",
    Cause.AMBIGUOUS: "no setting tells what depth does not show; take another view, or use what colour shows",
    Cause.SCORE: "more iterations will not help where a wrong pose scores highest, so look at the score's maps first",
    Cause.PLANE: "look at the support plane, or give gravity (scene.gravity)",
    Cause.COLLIDER: "try convex parts (physics.collider)",
    Cause.DISCARDED: "a correct pose was there, so better initial poses are not what is missing; look where its score "
    "maps differ from those of the answer",
    Cause.SIMULATION: "look at what the simulation pushed, and try it without (physics.enabled)",
    Cause.ARM_STARVED: f"{STARVED_ADVICE}more iterations (method.iterations) or more exploration (method.exploration)",
    Cause.BUDGET: "try more iterations (method.iterations)",
    Cause.OUT_OF_RANGE: "the initial poses are further off than the refiner was trained for, so better ones are "
    "needed ([hypotheses]), or weights trained on a wider range",
    Cause.REFINER: "try another refiner, or other settings of it (method.refiner)",
    Cause.POOL: "no initial pose led to the ground truth, so more or better ones are needed ([hypotheses])",
    Cause.UNDECIDED: "the same run comes out right for another scene.seed, so more hypotheses make it more certain "
    "([hypotheses], max_per_object)",
    Cause.NO_HYPOTHESIS: "without an initial pose nothing is refined, so name further results files or an estimator "
    "(hypotheses.files, hypotheses.estimate)",
    Cause.IMPOSSIBLE: "they sink in, float or would tip, so look at the support plane and at what they touch",
}
"""What to try, by cause."""


@dataclass(frozen=True)
class Finding:
    """One thing that had a part in an answer that is wrong, missing or in doubt."""

    cause: Cause
    text: str
    """What happened, in a sentence with numbers and units."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """The evidence. Names carry their unit; errors are ADD(-S) as a share of the diameter."""
    is_confirmed: bool = False
    """Whether it alone explains the failure: a re-run without it came out right, or nothing else can."""
    rests_on: str = ""
    """The re-run that came out right; empty where none was needed."""
    iteration: int | None = None
    """Where to look; 0 = before the first. None: nowhere in particular."""
    try_: Mapping[str, float] | None = None
    """Settings that may help, such as ``method.exploration``."""
    short: str = ""
    """The text in a few words, for one line; empty where the title of the cause says it."""
    detail: str = ""
    """Goes on behind ``title`` where there is room: a number."""

    @property
    def title(self) -> str:
        """A few words for one line."""
        return self.short or TITLES[self.cause]


@dataclass(frozen=True)
class Diagnosis:
    """Why one instance failed."""

    instance_id: int
    findings: tuple[Finding, ...]
    """The main one first, then what else had a part in it, the likeliest first."""
    n_reruns: int
    """Runs of the method on this instance that it took to find out."""
    ms: float = 0.0
    """Time it took [ms]."""
    doubts: tuple[str, ...] = ()
    """What is off with the data of the frame, and may be behind the cause; the main text ends with it."""

    @property
    def main(self) -> Finding:
        return self.findings[0]


MORE_DIGITS = 3
"""Digits that are added at most so that two numbers differ."""


def share(error: float) -> str:
    """An error as a share of the diameter."""
    return f"{error:.0%}" if math.isfinite(error) else "no answer"


def distinct_texts(a: float, b: float, digits: int, kind: Literal["f", "%"] = "f") -> tuple[str, str]:
    """Two numbers with ``digits`` after the point, or as many more as it takes to see that they differ.

    The same text twice if :data:`MORE_DIGITS` more do not show it.
    """
    for n in range(digits, digits + MORE_DIGITS + 1):
        texts = f"{a:.{n}{kind}}", f"{b:.{n}{kind}}"
        if texts[0] != texts[1]:
            return texts
    return f"{a:.{digits}{kind}}", f"{b:.{digits}{kind}}"


def millimetres(mm: float) -> str:
    """A length with as many digits as matter."""
    return f"{mm:.1f} mm" if mm < 99.95 else f"{mm:.0f} mm"


def instead(then: float, now: float) -> str:
    """What a re-run changed: "the error is 2% of the diameter instead of 30%"."""
    if not math.isfinite(then):
        return "there is no answer at all"
    if not math.isfinite(now):
        return f"the error is {then:.0%} of the diameter instead of {share(now)}"
    after, before = distinct_texts(then, now, 0, "%")
    if after == before:
        return f"the error is still {after} of the diameter"
    return f"the error is {after} of the diameter instead of {before}"


def cause_title(cause: str) -> str:
    """A cause as tables and filters show it; one that this version does not know is shown as it is."""
    return TITLES[Cause(cause)] if cause in set(Cause) else cause.replace("_", " ")
