"""Finds correct and near poses that a run had on its way to a wrong answer: given up for another, or led away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Best, Iteration, Stage
from verefine_viz.core.scores import PoseScore
from verefine_viz.diagnosis.number_words import distinct_texts

FAR = 0.25
"""ADD(-S) of a start, as a share of the diameter, above which it is not near."""
WORSE = 0.03
"""The answer is worse than a pose before by more than this share of the diameter …"""
WORSE_BY = 1.2
"""… and by more than this factor: then something led it astray."""


@dataclass(frozen=True, eq=False)
class Discarded:
    """A correct pose that a run had and gave up for a wrong one."""

    arm: int
    """Index of the hypothesis that it came from."""
    iteration: int
    """Iteration that made the pose; 0 = it is the initial pose of the hypothesis."""
    stage: Stage
    score: PoseScore
    """Score of the pose, as the iteration had it."""
    given_up: int
    """The first iteration from then on after which the object's best pose was a wrong one."""
    answer: Best
    """The answer, which was preferred in the end."""

    @property
    def margin(self) -> float:
        """By how much the answer scores more; negative where the scene decided, not the object's own score."""
        return self.answer.score.score - self.score.score

    @property
    def where(self) -> str:
        """When the pose was reached: "at iteration 3"."""
        return f"at iteration {self.iteration}" if self.iteration else "at the start"

    def describe(self, name: str) -> str:
        """What happened to the object ``name``."""
        pose, answer = distinct_texts(self.score.score, self.answer.score.score, 3)
        since = f"from iteration {self.given_up} on" if self.given_up > self.iteration else "at once"
        return (
            f"Hypothesis {self.arm + 1} of the {name} was correct {self.where}, where it scores {pose}. A wrong pose "
            f"was preferred to it {since}: the answer scores {answer}."
        )


def discarded(own: Sequence[Iteration], answer: Best | None, is_correct: Callable[[Float], bool]) -> Discarded | None:
    """The highest-scoring correct pose among all that a run scored on its way to a wrong answer; None if there is none.

    Only for methods that answer with the pose that scores best. A hypothesis that was never tried is not on the way.

    Args:
        own: all iterations of the object.
        answer: of the run.
        is_correct: whether a pose T_cam_obj (4, 4) is correct, by its ADD(-S).
    """
    known: dict[bytes, bool] = {}  # An iteration starts where an earlier one ended: half of the poses come twice.

    def correct(T_cam_obj: Float) -> bool:
        key = T_cam_obj.tobytes()
        if key not in known:
            known[key] = is_correct(T_cam_obj)
        return known[key]

    if answer is None or correct(answer.T_cam_obj):
        return None
    highest: tuple[Iteration, Stage, PoseScore] | None = None
    for iteration in own:
        for stage in iteration.stages:
            if stage.score is None or (highest is not None and stage.score.score <= highest[2].score):
                continue
            if correct(stage.T_cam_obj):
                highest = (iteration, stage, stage.score)
    if highest is None:
        return None
    iteration, stage, score = highest
    is_initial = stage is iteration.stages[0] and iteration.arm_iteration == 1
    made = 0 if is_initial else iteration.index
    given_up = next((i.index for i in own if i.index >= made and not correct(i.best.T_cam_obj)), own[-1].index)
    return Discarded(iteration.arm, made, stage, score, given_up, answer)


@dataclass(frozen=True, eq=False)
class Lost:
    """A pose near ground truth that the wrong answer came from, and what led it away; errors are ADD(-S) as a share of
    the diameter.
    """

    error: float
    """Error of that pose."""
    score: PoseScore | None
    iteration: int
    """Iteration that made the pose; 0 = it is the initial pose of the hypothesis."""
    lost_in: int
    """The iteration that added most to the error."""
    added_by_refiner: float
    added_by_simulation: float
    """How much refiner and simulation each added to the error from then on."""
    score_rose: bool
    """Whether the answer scores more nevertheless."""
    n_unstable: int
    """Iterations from then on that ended unstable in simulation."""

    @property
    def by_simulation(self) -> bool:
        """Whether the simulation added more to the error than the refiner."""
        return self.added_by_simulation > self.added_by_refiner


def lost(
    own: Sequence[Iteration], answer: Best, error_of: Callable[[Float], float | None], far: float = FAR
) -> Lost | None:
    """The nearest of the poses that the answer came from, where the answer is clearly worse; None if there is none.

    Args:
        own: all iterations of the object.
        answer: of the run.
        error_of: ADD(-S) of a pose T_cam_obj (4, 4) as a share of the diameter; None without ground truth.
        far: a pose further away than this share is not near.
    """
    way = [i for i in own if i.arm == answer.arm and i.index <= answer.iteration]
    # An iteration starts where the one before ended: its first pose counts as made by that one.
    steps = [(i, stage, error_of(stage.T_cam_obj)) for i in way for stage in i.stages]
    known = [(i, stage, error) for i, stage, error in steps if error is not None]
    at_end = error_of(answer.T_cam_obj)
    if not known or at_end is None:
        return None
    k = min(range(len(known)), key=lambda k: known[k][2])
    iteration, stage, nearest = known[k]
    if nearest > far or at_end < max(nearest + WORSE, WORSE_BY * nearest):
        return None
    by_simulation = by_refiner = 0.0
    grown: dict[int, float] = {}
    for (_, _, before), (i, after, error) in pairwise(known[k:]):
        change = error - before
        grown[i.index] = grown.get(i.index, 0.0) + change
        if after.name in ("simulated", "mixed"):
            by_simulation += max(change, 0.0)
        elif after.name == "refined":
            by_refiner += max(change, 0.0)
    if not by_simulation and not by_refiner:
        return None  # It was edited.
    made = 0 if stage is iteration.stages[0] and iteration.arm_iteration == 1 else iteration.index
    rose = stage.score is not None and answer.score.score > stage.score.score
    n_unstable = sum(any(e.kind == "unstable" for e in i.events) for i in way if i.index >= iteration.index)
    lost_in = max(grown, key=lambda index: grown[index])
    return Lost(nearest, stage.score, made, lost_in, by_refiner, by_simulation, rose, n_unstable)
