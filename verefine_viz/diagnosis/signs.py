"""Signs of a fault that a run shows by itself, for the page, which cannot wait for the re-runs of a diagnosis.

What needs no re-run is decided by the same functions in both: undeclared symmetries, data in doubt, and whether the
score prefers a wrong pose. Where a diagnosis would let a re-run decide, a sign alone must be clearer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.records import Best, Iteration, Stage
from verefine_viz.core.refiner_steps import TrainedRange, TrainedRefiner
from verefine_viz.core.scores import PoseScore
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.evaluation.trained_range import Start, start_of

FAR = 0.25
"""A start further away than this share of the diameter is not near (ADD(-S))."""
STARVED = 0.3
"""A hypothesis that got at most this share of an even split of the iterations, or one of them, was starved."""
LOW_SCORE = 0.45
UNFIT_SCORE, FITTING_SCORE = 0.4, 0.7
"""Ground truth that scores less than the one, where an answer scores more than the other, is not that of this image: a
model with other axes (Y up) scored 0.08, its answers 0.94."""
WORSE = 0.03
"""The answer is worse than a pose before by more than this share of the diameter …"""
WORSE_BY = 1.2
"""… and by more than this factor: then something led it astray."""
LEAK_SHARE = 0.25
"""More of the pixels without the model may be a mask that leaks."""


@dataclass(frozen=True)
class Course:
    """How one object has fared so far. Errors are None where they are unknown."""

    starts: tuple[PoseErrors | None, ...]
    """Of each hypothesis."""
    n_tried: tuple[int, ...]
    """Iterations of each hypothesis."""
    answer: PoseErrors | None
    """Of the best pose so far."""
    score: PoseScore | None
    """The same pose's."""
    score_at_gt: PoseScore | None

    @property
    def is_wrong(self) -> bool:
        """Whether the best pose so far is known to be wrong."""
        return self.answer is not None and self.answer.relative >= CORRECT

    @property
    def nearest(self) -> tuple[int, PoseErrors] | None:
        """The hypothesis that started nearest to ground truth, and how far that was."""
        known = [(errors.add_s_mm, j) for j, errors in enumerate(self.starts) if errors is not None]
        if not known:
            return None
        _, j = min(known)
        errors = self.starts[j]
        assert errors is not None
        return j, errors

    @property
    def is_misled(self) -> bool:
        """Whether the score prefers the best pose so far to ground truth."""
        return self.score is not None and self.score_at_gt is not None and prefers(self.score, self.score_at_gt)


def prefers(score: PoseScore, score_at_gt: PoseScore) -> bool:
    """Whether a pose scores at least as much as ground truth: then more iterations need not help."""
    return score.score >= score_at_gt.score


def ground_truth_is_unfit(score: PoseScore | None, score_at_gt: PoseScore | None) -> bool:
    """Whether ground truth explains next to nothing of the image where another pose explains most of it."""
    if score is None or score_at_gt is None:
        return False
    return score_at_gt.score < UNFIT_SCORE and score.score > FITTING_SCORE


def far_start(course: Course) -> tuple[int, PoseErrors] | None:
    """The nearest start, where it is not near."""
    return course.nearest if course.nearest is not None and course.nearest[1].relative >= FAR else None


def starved(course: Course) -> tuple[int, PoseErrors] | None:
    """The nearest start, where it got next to no iterations and the answer is wrong.

    Not where the score prefers that answer to ground truth: more iterations would not have helped.
    """
    if course.nearest is None or len(course.n_tried) < 2 or not course.is_wrong or course.is_misled:
        return None
    even_split = sum(course.n_tried) / len(course.n_tried)
    return course.nearest if course.n_tried[course.nearest[0]] <= max(1, STARVED * even_split) else None


@dataclass(frozen=True)
class OutOfRange:
    """All initial poses are further from the ground truth than the refiner was trained for."""

    trained: TrainedRange
    starts: tuple[Start, ...]
    """Of each hypothesis that the method works on."""


def out_of_range(refiner: Refiner | None, target: Target, first_only: bool) -> OutOfRange | None:
    """None where a hypothesis is within the range, or that is unknown; ``first_only``: the others are not worked on."""
    trained = refiner.trained_range if isinstance(refiner, TrainedRefiner) else None
    T_gt, pool = target.instance.T_cam_obj_gt, target.instance.hypotheses[: 1 if first_only else None]
    if trained is None or T_gt is None or not pool:
        return None
    starts = tuple(start_of(target.model, h.T_cam_obj, T_gt) for h in pool)
    return OutOfRange(trained, starts) if all(start.is_beyond(trained) for start in starts) else None


@dataclass(frozen=True, eq=False)
class Discarded:
    """A correct pose that a run had and gave up for a wrong one."""

    arm: int
    """Of the hypothesis that it came from."""
    iteration: int
    """Which made it; 0 = it is the initial pose of the hypothesis."""
    stage: Stage
    score: PoseScore
    """The same pose's, as the iteration had it."""
    given_up: int
    """The first iteration from then on after which the object's best pose was a wrong one."""
    answer: Best
    """What was preferred to it in the end."""

    @property
    def margin(self) -> float:
        """By how much the answer scores more; negative where the scene decided, not the object's own score."""
        return self.answer.score.score - self.score.score


def discarded(own: Sequence[Iteration], answer: Best | None, is_correct: Callable[[Float], bool]) -> Discarded | None:
    """The highest-scoring correct pose among all that a run scored on its way to a wrong answer; None if there is none.

    Only for methods that answer with the pose that scores best. A hypothesis that was never tried is not on the way.

    Args:
        own: all iterations of the object.
        answer: of the run.
        is_correct: whether a pose T_cam_obj (4, 4) is, by its ADD(-S).
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
    """Of that pose."""
    score: PoseScore | None
    iteration: int
    """Which came by it; 0 = it is the initial pose of the hypothesis."""
    lost_in: int
    """The iteration that added most to the error."""
    added_by_refiner: float
    added_by_simulation: float
    """What each added to the error from then on."""
    score_rose: bool
    """Whether the answer scores more all the same."""
    n_unstable: int
    """Iterations from then on that the simulation left unstable."""

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


def leaks(score: PoseScore) -> bool:
    """Whether much of the mask is surface that the pose does not explain."""
    return score.shares["missed"] >= LEAK_SHARE


def is_low(score: PoseScore) -> bool:
    """Whether a score is so low that its pose is likely to be wrong."""
    return score.score < LOW_SCORE
