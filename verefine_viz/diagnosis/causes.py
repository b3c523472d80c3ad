"""What can have gone wrong, and what a diagnosis says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from verefine_viz.core.records import TIMING


class Cause(StrEnum):
    """Why an answer is wrong or missing, in the order in which causes are asked for: what was given, what was done.

    Without a hypothesis nothing was done, so that nothing else is asked.
    """

    SYMMETRIC = "symmetric"
    UNIT = "unit"
    DEPTH = "depth"
    MASK = "mask"
    NEIGHBOUR = "neighbour"
    SCORE = "score"
    PLANE = "plane"
    COLLIDER = "collider"
    SIMULATION = "simulation"
    ARM_STARVED = "arm_starved"
    BUDGET = "budget"
    REFINER = "refiner"
    POOL = "pool"
    NO_HYPOTHESIS = "no_hypothesis"


TITLES: dict[Cause, str] = {
    Cause.SYMMETRIC: "symmetry of the shape not declared",
    Cause.UNIT: "first poses in another unit",
    Cause.DEPTH: "depth missing or unregistered",
    Cause.MASK: "mask leaks or misses",
    Cause.NEIGHBOUR: "neighbour misplaced first",
    Cause.SCORE: "score ranks a wrong pose above the ground truth",
    Cause.PLANE: "wrong support plane",
    Cause.COLLIDER: "collider too coarse",
    Cause.SIMULATION: "simulation pushed it away",
    Cause.ARM_STARVED: "best hypothesis tried too little",
    Cause.BUDGET: "budget too small",
    Cause.REFINER: "refiner diverged or got stuck",
    Cause.POOL: "no good hypothesis in the pool",
    Cause.NO_HYPOTHESIS: "no hypothesis at all",
}
"""For people: tables, bar charts, filters."""


@dataclass(frozen=True)
class Finding:
    """One cause that had a part in it."""

    cause: Cause
    sentence: str
    """What happened, with numbers and units, for a person."""
    evidence: Mapping[str, float]
    """Names carry their unit; errors are ADD(-S) as a share of the diameter."""
    is_confirmed: bool
    """Whether it alone explains the failure: a re-run without it came out right, or nothing else can."""


@dataclass(frozen=True)
class Diagnosis:
    """Why one instance failed."""

    instance_id: int
    cause: Cause
    sentence: str
    evidence: Mapping[str, float]
    is_confirmed: bool
    others: tuple[Finding, ...]
    """What else had a part in it, the likeliest first."""
    n_reruns: int
    """Runs of the method on this instance that it took to find out."""
    ms: float = field(default=0.0, metadata=TIMING)
    """Time it took [ms]."""
    doubts: tuple[str, ...] = ()
    """What is off with the data of the frame, and may be behind the cause; the sentence ends with it."""
