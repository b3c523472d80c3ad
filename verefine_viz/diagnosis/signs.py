"""Signs of a fault that a finished run shows without a re-run: the first is the verdict, all are listed as reasons.

What needs no re-run is decided by the same functions in a diagnosis: undeclared symmetries, data in doubt, and whether
the score prefers a wrong pose. Where a diagnosis would let a re-run decide, a sign alone must be clearer.
"""

from __future__ import annotations

from dataclasses import dataclass

from msgspec import structs

from verefine_viz.core.accuracy import CORRECT, PoseErrors
from verefine_viz.core.causes import CAUSES, Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.records import Best
from verefine_viz.core.refiner_steps import TrainedRange, TrainedRefiner
from verefine_viz.core.remedies import COLOUR, MORE_EXPLORATION
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.diagnosis.lost_poses import FAR, Discarded, Lost
from verefine_viz.diagnosis.number_words import millimetres
from verefine_viz.diagnosis.other_pose import brief, describe
from verefine_viz.diagnosis.plane_doubt import plane_doubt
from verefine_viz.diagnosis.preferred_poses import blamed_pixels, preferred
from verefine_viz.diagnosis.undeclared_turn import UndeclaredTurn
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.trained_range import Start, start_of
from verefine_viz.methods.known_methods import MethodInfo, method_of

STARVED = 0.3
"""A hypothesis that got at most this share of an even split of the iterations, or one of them, was starved."""
LOW_SCORE = 0.45
"""Score below which an answer is likely to be wrong."""
UNFIT_SCORE, FITTING_SCORE = 0.4, 0.7
"""Ground truth that scores below the first, where an answer scores above the second, does not belong to this image:
with a model of other axes (Y up), ground truth scored 0.08 and answers 0.94."""
LEAK_SHARE = 0.25
"""Share of pixels without the model above which the mask may leak."""
NO_LEAD = 5e-4
"""Least lead that counts as one [score]."""
SAME_POSE_MM = 0.5
"""Distance below which two poses count as one [mm]."""
NEAR_TIE = 0.03
"""Lead below which a score says little about which pose is better [score]. Of refined pairs on real frames, the one
that scores less is more than 1 mm nearer to ground truth in 3 of 10 for leads of 0.01 to 0.03, in 3 of 20 up to 0.1,
and never beyond."""


@dataclass(frozen=True)
class RunnerUp:
    """The best pose of another hypothesis than the answer's."""

    pose: Best
    lead: float
    """How much more the answer scores."""
    apart_mm: float
    """ADD(-S) between it and the answer [mm]."""

    def describe(self, answer: Best) -> str:
        """Lead of ``answer`` over the runner-up: "0.003 ahead of hypothesis 2"; none where both are one pose."""
        lead, rival = self.lead, f"hypothesis {self.pose.arm + 1}"
        if self.apart_mm < SAME_POSE_MM:
            one, two = sorted((answer.arm + 1, self.pose.arm + 1))
            return f"hypotheses {one} and {two} end in the same pose"
        return f"level with {rival}" if lead < NO_LEAD else f"{lead:.{distinguishing_digits(lead)}f} ahead of {rival}"


@dataclass(frozen=True, eq=False)
class FinishedObject:
    """One object after a finished run. Errors are None where they are unknown."""

    target: Target
    label: str
    answer: Best | None = None
    """The answer; None where the object had no hypothesis."""
    errors: PoseErrors | None = None
    """Errors of the answer."""
    starts: tuple[PoseErrors | None, ...] = ()
    """Errors of each hypothesis' initial pose."""
    n_tried: tuple[int, ...] = ()
    """Iterations of each hypothesis."""
    score_at_gt: PoseScore | None = None
    discarded: Discarded | None = None
    """The correct pose that was given up for a wrong answer."""
    lost: Lost | None = None
    """The pose near ground truth that a wrong answer came from; None where nothing led it away."""
    undeclared: UndeclaredTurn | None = None
    """The turn that alone makes the answer count as wrong; None where it is right, or wrong otherwise."""
    runner_up: RunnerUp | None = None
    """The best other hypothesis; None where no other could have been the answer."""
    impossible: Finding | None = None
    """The finding that the answer is physically impossible; None where it is possible, or unknown."""
    allowed: AllowedPoses | None = None
    """The poses that the image allows beside the answer, where they are known."""
    seen: tuple[AllowedPoses, float] | None = None
    """For a wrong answer, the poses that the image allows beside ground truth, and how far it is from them by ADD(-S)
    [mm], where that is known."""

    @property
    def instance_id(self) -> int:
        return self.target.instance.instance_id

    @property
    def is_wrong(self) -> bool:
        """Whether the answer is known to be wrong."""
        return self.errors is not None and not self.errors.is_correct

    @property
    def is_misled(self) -> bool:
        """Whether the score prefers the answer to ground truth: then more iterations need not help."""
        return self.score_at_gt is not None and self.score.score >= self.score_at_gt.score

    @property
    def score(self) -> PoseScore:
        """Score of the answer, where there is one."""
        assert self.answer is not None
        return self.answer.score

    @property
    def nearest(self) -> tuple[int, PoseErrors] | None:
        """The hypothesis that started nearest to ground truth, and how far that was."""
        known = [(j, errors) for j, errors in enumerate(self.starts) if errors is not None]
        return min(known, key=lambda start: start[1].add_s_mm) if known else None


def signs(o: FinishedObject, session: Session, refiner: Refiner | None = None) -> tuple[Finding, ...]:
    """Findings on what is wrong with an answer, or in doubt where there is no ground truth; the most telling first.

    Args:
        o: the object after the run.
        session: what was run.
        refiner: of the run; None = do not check whether starts lie outside its training range.
    """
    if o.answer is None:
        return ()
    method = method_of(session.method.name)
    if o.errors is None:
        return _known(o.impossible, _low(o, method), _leak(o), _ambiguous(o), _near_tie(o))
    if not o.is_wrong:
        return _known(_leak(o))
    whole = _unfit(o) or _symmetric(o, session)
    if whole is not None:
        return (whole,)
    unseen = _unseen_error(o)
    if unseen is not None:
        return (unseen,)
    by_score = _misled(o, method)
    if o.discarded is not None:
        way = [_discarded(o, o.discarded)]
    else:
        way = [_starved(o, session, method), *(_led_away(o) or [_far_start(o, session, method, refiner)])]
    # Ground truth may score a little less than the pose beside it that a refiner finds: then a tie was decided.
    is_tie = o.discarded is not None and abs(o.discarded.margin) < NEAR_TIE
    return _known(_leak(o), *([*way, by_score] if is_tie else [by_score, *way])) or _known(_missed(o))


def _known(*findings: Finding | None) -> tuple[Finding, ...]:
    return tuple(finding for finding in findings if finding is not None)


# Of a wrong answer.


def ground_truth_is_unfit(score: PoseScore | None, score_at_gt: PoseScore | None) -> bool:
    """Whether ground truth explains next to nothing of the image where another pose explains most of it."""
    if score is None or score_at_gt is None:
        return False
    return score_at_gt.score < UNFIT_SCORE and score.score > FITTING_SCORE


def _unfit(o: FinishedObject) -> Finding | None:
    at_gt = o.score_at_gt
    if at_gt is None or not ground_truth_is_unfit(o.score, at_gt):
        return None
    return Finding(
        Cause.GROUND_TRUTH,
        f"The ground truth of the {o.label} does not fit this image: it scores {at_gt.score:.2f}, the answer "
        f"{o.score.score:.2f}. The mesh may have other axes than the poses are about, or the poses another frame.",
        {"score_of_ground_truth": at_gt.score, "score": o.score.score},
        detail=f": scores {at_gt.score:.2f}, the answer {o.score.score:.2f}",
    )


def _symmetric(o: FinishedObject, session: Session) -> Finding | None:
    turn = o.undeclared
    if turn is None:
        return None
    finding = turn.finding(o.target.model.name)
    tells = turn.texture_tells and session.score.colour_weight == 0
    advice = CAUSES[Cause.SYMMETRIC].advice
    text = f"{finding.text} {advice[0].upper()}{advice[1:]}."
    return structs.replace(finding, text=text, is_confirmed=False, try_=COLOUR.changes(session) if tells else None)


def _leak(o: FinishedObject) -> Finding | None:
    """A wrong pose misses pixels of any mask; ground truth only those of a mask that leaks."""
    judged = o.score_at_gt if o.is_wrong else o.score
    if judged is None or judged.shares["missed"] < LEAK_SHARE:
        return None
    missed, at_gt = f"{o.score.shares['missed']:.0%}", f"{judged.shares['missed']:.0%}"
    return Finding(
        Cause.MASK,
        f"{missed} of the pixels are missed (red){f', {at_gt} even at ground truth' * o.is_wrong}: the mask holds "
        "surface that the pose does not explain. If the red pixels form another object, the mask leaks onto it.",
        {"missed_share": o.score.shares["missed"]},
        short="" if o.is_wrong else f"{missed} of its mask unexplained: does it leak?",
        detail=f": {at_gt} missed even at ground truth" if o.is_wrong else "",
    )


def _unseen_error(o: FinishedObject) -> Finding | None:
    """Finds that the answer is right as far as the image shows."""
    if o.seen is None or o.errors is None or o.seen[1] >= CORRECT * 1e3 * o.target.model.diameter_m:
        return None
    allowed, error_mm = o.seen
    deg, shift = f"{o.errors.rotation_deg:.0f}°", millimetres(o.errors.translation_mm)
    return Finding(
        Cause.AMBIGUOUS,
        f"The {o.label} is {deg} and {shift} off, and the image does not tell: beside the ground truth it allows a "
        f"pose {millimetres(error_mm)} from the answer; {allowed.least_certain.describe()}.",
        {"error": o.errors.relative, "error_seen": 1e-3 * error_mm / o.target.model.diameter_m},
        detail=f": {deg if o.errors.rotation_deg >= 1 else shift} off, no pixel speaks against it",
    )


def _misled(o: FinishedObject, method: MethodInfo) -> Finding | None:
    right, errors, answer = o.score_at_gt, o.errors, o.answer
    if right is None or errors is None or answer is None or not o.is_misled:
        return None
    margin = o.score.score - right.score
    detail = f", by {margin:.{distinguishing_digits(margin)}f}"
    blamed = blamed_pixels(o.score, right)
    if blamed is not None:
        detail += f": {right.shares[blamed]:.0%} of the ground truth's pixels {blamed}"
    how = f" ({errors.rotation_deg:.0f}° and {errors.translation_mm:.0f} mm off)"
    text = preferred(o.label, errors.relative, o.score, right, how)
    if not method.takes_turns:  # A scene's answer is not decided by this score alone.
        text += " Look at the depth there and at the score's settings."
    numbers = {"score": o.score.score, "score_of_ground_truth": right.score, "error": errors.relative}
    return Finding(Cause.SCORE, text, numbers, iteration=answer.iteration, detail=detail)


def _discarded(o: FinishedObject, given_up: Discarded) -> Finding:
    margin, way = abs(given_up.margin), "higher" if given_up.margin >= 0 else "lower"
    return Finding(
        Cause.DISCARDED,
        given_up.describe(o.label),
        {"hypothesis": given_up.arm, "iteration": given_up.iteration, "margin": given_up.margin},
        iteration=given_up.given_up,
        short=f"correct {given_up.where}, given up",
        detail=f" for a score {margin:.{distinguishing_digits(margin)}f} {way}",
    )


def _starved(o: FinishedObject, session: Session, method: MethodInfo) -> Finding | None:
    """The nearest start, where it is near and got next to no iterations.

    Not where the score prefers the answer to ground truth: more iterations would not have helped.
    """
    if o.nearest is None or len(o.n_tried) < 2 or o.is_misled:
        return None
    (j, errors), n = o.nearest, sum(o.n_tried)
    if errors.relative >= FAR or o.n_tried[j] > max(1, STARVED * n / len(o.n_tried)):
        return None
    return Finding(
        Cause.ARM_STARVED,
        f"Hypothesis {j + 1} of the {o.label} started nearest to ground truth ({errors.add_s_mm:.0f} mm) but was tried "
        f"{o.n_tried[j]} of {n} times{': its exploration bonus never won' * method.has_ucb}.",
        {"hypothesis": j, "iterations_of_it": o.n_tried[j], "iterations": n},
        try_=MORE_EXPLORATION.changes(session) if method.has_ucb else None,
        detail=f": {o.n_tried[j]} of {n} iterations",
    )


def _led_away(o: FinishedObject) -> list[Finding]:
    """What made a wrong answer of a pose near ground truth; a plane in doubt before the simulation on it."""
    lost, answer, errors = o.lost, o.answer, o.errors
    if lost is None or answer is None or errors is None:
        return []
    near_mm = 1e3 * o.target.model.diameter_m * lost.error
    when = f"in iteration {lost.iteration}" if lost.iteration else "at its start"
    scored = f" and scored {lost.score.score:.2f}" if lost.score is not None else ""
    text = (
        f"Hypothesis {answer.arm + 1} of the {o.label} was {near_mm:.1f} mm off {when}{scored}; the answer, which came "
        f"from it, is {errors.add_s_mm:.1f} mm off and scores {answer.score.score:.2f}. The "
        f"{'simulation' if lost.by_simulation else 'refiner'} led it away, most in iteration {lost.lost_in}."
    )
    numbers = {
        "error_before": lost.error,
        "error": errors.relative,
        "added_by_refiner": lost.added_by_refiner,
        "added_by_simulation": lost.added_by_simulation,
    }
    at = lost.lost_in
    if not lost.by_simulation:
        where = f"at iteration {lost.iteration}" if lost.iteration else "at the start"
        short, detail = f"nearer {where}, then lost in iteration {at}", ""
        if lost.score_rose:
            short, detail = "refiner led it away", ": score rose while the error grew"
        return [Finding(Cause.REFINER, text, numbers, iteration=at, short=short, detail=detail)]
    detail = f": {millimetres(near_mm)} off before"
    if lost.n_unstable:
        text += f" In {lost.n_unstable} iteration{'s' * (lost.n_unstable != 1)} its centre of mass is outside its "
        text += "support: it tips over."
        detail = ": it tips over"
    pushed = Finding(Cause.SIMULATION, text, numbers, iteration=at, detail=detail)
    support = o.target.observation.support
    doubt = plane_doubt(support) if support is not None else ""
    if support is None or not doubt:
        return [pushed]
    detail, share = f": it explains only {support.inlier_share:.0%} of the background", support.inlier_share
    return [Finding(Cause.PLANE, doubt, {"inlier_share": share}, iteration=at, detail=detail), pushed]


def out_of_range(
    refiner: Refiner | None, target: Target, first_only: bool
) -> tuple[TrainedRange, tuple[Start, ...]] | None:
    """What the refiner was trained for, and the starts, all of which are further from the ground truth.

    None where a hypothesis is within the range, or that is unknown; ``first_only``: the others are not worked on.
    """
    trained = refiner.trained_range if isinstance(refiner, TrainedRefiner) else None
    T_gt, pool = target.instance.T_cam_obj_gt, target.instance.hypotheses[: 1 if first_only else None]
    if trained is None or T_gt is None or not pool:
        return None
    starts = tuple(start_of(target.model, h.T_cam_obj, T_gt) for h in pool)
    return (trained, starts) if all(start.is_beyond(trained) for start in starts) else None


def _far_start(o: FinishedObject, session: Session, method: MethodInfo, refiner: Refiner | None) -> Finding | None:
    """The nearest start, where it is not near."""
    if o.nearest is None or o.nearest[1].relative < FAR:
        return None
    j, errors = o.nearest
    off = (
        f"{errors.rotation_deg:.0f}° and {errors.translation_mm:.0f} mm (hypothesis {j + 1}), ADD(-S) "
        f"{errors.relative:.0%} of the diameter."
    )
    numbers = {"nearest": j, "nearest_rotation_deg": errors.rotation_deg, "nearest_error": errors.relative}
    beyond = out_of_range(refiner, o.target, method.first_only)
    if beyond is not None:
        trained, starts = beyond
        start = starts[j if j < len(starts) else 0]
        text = (
            f"No hypothesis of the {o.label} is within the training range of {session.method.refiner}, "
            f"{trained.rotation_deg:.0f}° and {starts[0].largest_shift_mm(trained):.0f} mm: best "
            f"initial error {off}"
        )
        detail = f": starts {start.rotation_deg:.0f}° off"
        return Finding(Cause.OUT_OF_RANGE, text, numbers, iteration=0, detail=detail)
    text = (
        f"No hypothesis of the {o.label} starts near: best initial error {off} Refinement did not help: look at the "
        "estimator first."
    )
    return Finding(Cause.POOL, text, numbers, iteration=0, detail=f": nearest start {millimetres(errors.add_s_mm)}")


def _missed(o: FinishedObject) -> Finding | None:
    """Ground truth scores more than the answer, and nothing else explains it."""
    if o.score_at_gt is None or o.errors is None:
        return None
    right, wrong = o.score_at_gt.score, o.score.score
    how = f"{o.errors.rotation_deg:.0f}° and {o.errors.translation_mm:.0f} mm off"
    return Finding(
        Cause.BUDGET,
        f"The search missed the {o.label}: the ground truth would score {right:.2f}, the answer scores {wrong:.2f} "
        f"({how}). More iterations or better hypotheses can help; another score cannot.",
        {"score_of_ground_truth": right, "score": wrong, "error": o.errors.relative},
        short="search missed it",
        detail=f": ground truth scores {right - wrong:.{distinguishing_digits(right - wrong)}f} more",
    )


# Of an answer without ground truth.


def _low(o: FinishedObject, method: MethodInfo) -> Finding | None:
    score = o.score.score
    if score >= LOW_SCORE:
        return None
    text = f"The answer for the {o.label} scores only {score:.2f}."
    if method.verifies:
        text = f"All hypotheses of the {o.label} stay low: the best score is {score:.2f}."
    text += " Expect the answer to be wrong."
    return Finding(Cause.POOL, text, {"score": score}, short="so low a score is likely wrong")


def _ambiguous(o: FinishedObject) -> Finding | None:
    if o.allowed is None or o.allowed.furthest is None:
        return None
    other = o.allowed.furthest
    numbers = {"apart_mm": other.apart_mm, "score_noise": other.noise}
    text = describe(o.label, o.allowed, other)
    return Finding(Cause.AMBIGUOUS, text, numbers, short=brief(o.allowed, other))


def _near_tie(o: FinishedObject) -> Finding | None:
    """Another hypothesis scores nearly as much elsewhere."""
    rival, limit_mm = o.runner_up, CORRECT * o.target.model.diameter_m * 1e3
    if rival is None or o.answer is None or rival.lead >= NEAR_TIE or rival.apart_mm <= limit_mm:
        return None
    short = f"{rival.describe(o.answer)}, which lies {millimetres(rival.apart_mm)} away"
    numbers = {"margin": rival.lead, "apart_mm": rival.apart_mm}
    return Finding(Cause.AMBIGUOUS, f"The answer for the {o.label} is {short}.", numbers, short=short)
