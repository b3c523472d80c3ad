"""Causes of failure, with what page, tables, report and documents say about each. ``make tables`` writes the documents.

Each is tested by a function of ``input_causes.py``, ``scene_causes.py`` or ``search_causes.py``; a scene shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from verefine_viz.core.remedies import (
    BY_ICP,
    BY_NETWORK,
    COLOUR,
    CONVEX_PARTS,
    FOUND_HYPOTHESES,
    GIVEN_GRAVITY,
    MILLIMETRES,
    MORE_EXPANSIONS,
    MORE_EXPLORATION,
    MORE_HYPOTHESES,
    MORE_ITERATIONS,
    NO_PHYSICS,
    PLAUSIBLE,
    Remedy,
)


class Cause(StrEnum):
    """Why an answer is wrong or missing, in the order in which causes are tested: first the input, then the run.

    Without a hypothesis nothing was run, so that nothing else is tested. The last cause is for answers without ground
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


@dataclass(frozen=True, kw_only=True)
class KnownCause:
    """Texts about a cause. Those without a capital letter and a full stop become part of a sentence."""

    title: str
    """A few words for tables, bar charts and filters."""
    what: str
    """What is wrong, in markdown."""
    shown_by: str
    """How the cause shows."""
    advice: str
    """What to try."""
    remedies: tuple[Remedy, ...] = ()
    """Settings that may help; none where only the data can be mended."""
    numbers: Mapping[str, str] = field(default_factory=dict)
    """Names of the numbers in its findings, apart from :data:`RERUN_NUMBERS`, and what each means."""
    picture: str
    """What ``docs/causes/NAME.png`` shows."""
    command: str = ""
    """Arguments of ``verefine-viz`` that show the cause; "" where ``scripts/cause_scenes.py`` spoils a frame for it."""
    is_by_chance: bool = False
    """Whether it needs a control even where no re-run showed it; other causes are plain from what the run did."""


STARVED_ADVICE = "each came right when its best hypothesis got the whole budget, so try "
RERUN_NUMBERS = {
    "error": "of the answer",
    "error_repaired": "of the answer of the re-run with the repair",
    "reruns, reruns_right": "re-runs on other samples of the observed points with nothing changed, and how many came "
    "out right; missing where none did, and where no re-run was needed",
    "repaired, repaired_right": "the same with the repair",
}
"""Numbers that findings of any cause may have, and what each means."""
CAUSES: dict[Cause, KnownCause] = {
    Cause.GROUND_TRUTH: KnownCause(
        title="ground truth does not fit its image",
        what="the ground truth scores next to nothing and the measured depth is elsewhere, while the answer scores "
        "high: the mesh has other axes than the poses assume (Y up, mirrored), or the poses are in another frame",
        shown_by="without a re-run: both poses are scored",
        advice="compare the axes of the meshes and the frame of the poses with what the data set says; until they fit, "
        "no error means anything",
        numbers={
            "score_of_ground_truth": "of the ground-truth pose as it is given",
            "score": "of the answer",
            "agreement": "how well depth lies on the ground truth; 1 is best",
        },
        picture="A mug whose answer fits, and whose ground truth lies on its side",
    ),
    Cause.SYMMETRIC: KnownCause(
        title="symmetry of the shape not declared",
        what="the answer looks like the ground truth, but the model does not declare the symmetry between them",
        shown_by="without a re-run: the error is measured again with the symmetry",
        advice="declare the symmetry in models_info.json if shape is all that matters",
        remedies=(COLOUR,),
        numbers={
            "turn_deg, error_with_symmetry": "the turn [°], and the error if it were declared",
        },
        picture="A pack whose answer is upside down and fits as well",
        command="view failure_score_prefers_flip",
    ),
    Cause.UNIT: KnownCause(
        title="initial poses in another unit",
        what="translations of hypotheses are in metres or centimetres instead of millimetres",
        shown_by="by a re-run with these translations put right",
        advice="write the translations of the initial poses in millimetres (hypotheses.files)",
        remedies=(MILLIMETRES,),
        numbers={
            "hypotheses": "how many there are",
            "hypotheses_in_another_unit, factor": "how many look so, and what their translations have to be multiplied "
            "by",
        },
        picture="A duck, and at the right edge the contour of its answer, which lies just in front of the camera",
    ),
    Cause.DEPTH: KnownCause(
        title="depth missing or unregistered",
        what="much of the object has no depth, or the depth image is shifted or scaled",
        shown_by="by a re-run with the depth image put right",
        advice="look at the depth images and how they are registered",
        numbers={
            "missing_share": "of the object's pixels that have no depth",
            "shift_right_px, shift_down_px, scale": "of the depth image against the ground truth",
            "agreement, agreement_repaired": "how well depth lies on the ground truth, and would if it were put right; "
            "1 is best",
        },
        picture="The depth image of a mirroring duck: almost none of it was measured",
    ),
    Cause.MASK: KnownCause(
        title="mask leaks or misses",
        what="the mask covers other things, or not all of the object",
        shown_by="by a re-run with the mask of the ground truth",
        advice="look at where the masks leak or miss",
        numbers={
            "leak_share, miss_share": "of the mask beside the object, and of the object beside the mask",
            "missed_share": "of the pixels that the answer's score counts, by class",
        },
        picture="The mask of a can that covers the bottle beside it",
        command="view failure_mask_leaks",
    ),
    Cause.NEIGHBOUR: KnownCause(
        title="neighbour misplaced first",
        what="an object that was placed before this one is misplaced",
        shown_by="by a re-run with the other objects at ground truth",
        advice="first mend the neighbours that were placed before",
        numbers={
            "neighbour, neighbour_error": "instance_id of the object that was misplaced first, and its error",
        },
        picture="A duck, and the can that was placed where the duck is",
    ),
    Cause.SCORE: KnownCause(
        title="score ranks a wrong pose above the ground truth",
        what="the wrong answer scores at least as high as the ground truth",
        shown_by="without a re-run: both poses are scored",
        advice="more iterations will not help where a wrong pose scores highest, so look at the score's maps first",
        remedies=(COLOUR, PLAUSIBLE),
        numbers={
            "score": "of the answer",
            "explained_share, missed_share, protruding_share, hidden_share, unknown_share": "of the pixels that the "
            "answer's score counts, by class",
            "depth_fit, normal_fit": "mean f_d and f_n of Eq. 1",
            "unexplained_px": "pixels that the scene leaves unexplained with the answer: the cost of `physim_mcts`",
        },
        picture="A jug whose answer covers the body and not the handle",
        command="view failure_score_prefers_wrong",
    ),
    Cause.PLANE: KnownCause(
        title="wrong support plane",
        what="the plane or gravity of the simulation is wrong, or was not found",
        shown_by="by a re-run with the plane of the ground truth",
        advice="look at the support plane, or give gravity (scene.gravity)",
        remedies=(GIVEN_GRAVITY, NO_PHYSICS),
        numbers={
            "inlier_share": "of the background on the plane, where the page doubts it without a re-run",
            "plane_too_high_mm, plane_tilt_deg, gravity_off_deg": "against the ground truth; none of them where no "
            "plane was found",
        },
        picture="The carton in 3D with a support plane through the board behind it",
        command="view failure_wrong_plane",
    ),
    Cause.COLLIDER: KnownCause(
        title="collider too coarse",
        what="the simulated solid differs much from the mesh",
        shown_by="by a re-run with convex parts in place of a hull",
        advice="try convex parts (physics.collider)",
        remedies=(CONVEX_PARTS,),
        numbers={
            "deviation_mm": "largest, of the solid from the mesh",
        },
        picture="A duck in a bowl that physics takes for its hull",
    ),
    Cause.DISCARDED: KnownCause(
        title="correct pose discarded for one that scores more",
        what="a correct pose was reached, but the answer is another that scores at least as much, although the ground "
        "truth scores more; or a hypothesis comes right when refined alone, but scores less there than the answer",
        shown_by="without a re-run: all poses of the run are compared",
        advice="a correct pose was reached, so better initial poses are not needed; look where its score maps differ "
        "from those of the answer",
        remedies=(MORE_ITERATIONS, COLOUR),
        numbers={
            "score": "of the answer",
            "unexplained_px": "pixels that the scene leaves unexplained with the answer: the cost of `physim_mcts`",
            "hypothesis": "index of the hypothesis concerned",
            "iteration, given_up_in_iteration": "which made the correct pose (0: it is an initial pose), and after "
            "which a wrong pose was the best",
            "error_of_correct, score_of_correct, unexplained_px_of_correct": "of the correct pose",
            "score_refined_on, margin": "the highest score that the refiner reaches from the correct pose; by how much "
            "the answer scores more than the correct pose itself",
            "hypothesis_of_answer, iteration_of_answer": "which made the answer",
            "calls, iterations_of_it, iterations": "refiner calls that it needs to come right, iterations that it got, "
            "iterations of the object",
        },
        picture="A mug whose answer is turned a little more than what counts as right",
        command="view --scene.demo mug --method.name vf_breadth --method.iterations 1 --method.refiner icp "
        "--hypotheses.max-per-object 2 --hypotheses.rotation-deg 30 --hypotheses.translation-mm 10 --hypotheses.seed 2",
    ),
    Cause.AMBIGUOUS: KnownCause(
        title="the observation cannot tell two poses apart",
        what="the answer is next to a pose whose score differs from that of the ground truth by no more than errors of "
        "depth and mesh explain: it is right as far as the image shows",
        shown_by="without a re-run: the poses that the image allows beside ground truth are computed",
        advice="no setting tells what depth does not show; take another view, or use what colour shows",
        remedies=(COLOUR,),
        numbers={
            "score": "of the allowed pose next to the answer; without ground truth, of the answer",
            "score_of_other, score_noise, apart_mm": "of the other pose, the standard deviation of the difference, "
            "ADD(-S) between both",
            "undetermined_mm, undetermined_deg": "as in `frames.csv`",
            "error_seen": "error to the nearest pose that the image allows beside the ground truth",
            "margin": "by how much the answer scores more than the other pose, where the page names it without a "
            "re-run",
        },
        picture="A jug whose handle is hidden behind it",
    ),
    Cause.SIMULATION: KnownCause(
        title="simulation pushed it away",
        what="simulating moved the object away from the ground truth",
        shown_by="by a re-run without simulation",
        advice="look at what the simulation pushed, and try it without (physics.enabled)",
        remedies=(NO_PHYSICS,),
        numbers={
            "hypothesis": "index of the hypothesis concerned",
            "error_of_correct, score_of_correct, unexplained_px_of_correct": "of the correct pose",
            "iteration, moved_mm, turned_deg, error_added": "the simulation that did most harm, how far it moved the "
            "object, and how much it added to the error",
            "error_of_simulated_ground_truth": "after one simulation from the ground truth",
            "calls, iterations_of_it, iterations": "refiner calls that it needs to come right, iterations that it got, "
            "iterations of the object",
            "error_before, added_by_refiner, added_by_simulation": "error of the pose nearest to the ground truth "
            "on the way to the answer, and what each added to it from then on",
        },
        picture="A tall box that was pushed over and floats above where it was seen",
        command="view failure_simulation_topples",
        is_by_chance=True,
    ),
    Cause.ARM_STARVED: KnownCause(
        title="best hypothesis tried too little",
        what="a hypothesis got few iterations or none, and comes right when it gets all",
        shown_by="by a re-run with all iterations for that hypothesis",
        advice=f"{STARVED_ADVICE}more iterations (method.iterations) or more exploration (method.exploration)",
        remedies=(MORE_EXPLORATION, MORE_ITERATIONS, MORE_EXPANSIONS),
        numbers={
            "hypothesis": "index of the hypothesis concerned",
            "error_of_correct, score_of_correct, unexplained_px_of_correct": "of the correct pose",
            "calls, iterations_of_it, iterations": "refiner calls that it needs to come right, iterations that it got, "
            "iterations of the object",
            "initial_error_of_it": "of the hypothesis as it was given",
        },
        picture="The timeline: of five hypotheses three were played, ten times in all",
        command="view failure_arm_starved",
        is_by_chance=True,
    ),
    Cause.BUDGET: KnownCause(
        title="budget too small",
        what="the answer was still improving at the end",
        shown_by="by a re-run with 2, 4 or 8 times the iterations",
        advice="try more iterations (method.iterations)",
        remedies=(MORE_ITERATIONS, MORE_EXPANSIONS),
        numbers={
            "falling, times": "how much the last iteration lowered the error; the multiple of the budget that "
            "was tried",
            "error_alone": "when solved by RIR among the other objects",
            "score": "of the answer",
        },
        picture="A duck whose answer is still on its way",
        command="view --scene.demo duck --method.name rir --method.iterations 1 --method.refiner icp "
        "--icp.max-iterations 2 --hypotheses.max-per-object 1",
        is_by_chance=True,
    ),
    Cause.OUT_OF_RANGE: KnownCause(
        title="refiner out of its training range",
        what="all initial poses are turned or shifted further from the ground truth than a learned refiner was trained "
        "to correct",
        shown_by="by a re-run with the initial poses brought within half of that range",
        advice="the initial poses are further off than the refiner was trained for, so better ones are needed "
        "([hypotheses]), or weights trained on a wider range",
        remedies=(FOUND_HYPOTHESES, BY_ICP),
        numbers={
            "hypotheses": "how many there are",
            "nearest, nearest_error, nearest_rotation_deg": "the hypothesis that started nearest to the ground truth, "
            "and how far that was",
            "nearest_shift_mm, trained_rotation_deg, trained_shift_mm": "how far the middle of the object was shifted "
            "there; the range that the refiner was trained on, for an object of this size",
        },
        picture="A duck whose poses are all turned further than what the network was trained on",
        command="view failure_out_of_range",
        is_by_chance=True,
    ),
    Cause.REFINER: KnownCause(
        title="refiner diverged or got stuck",
        what="the refiner led away from a pose nearer to the ground truth, or does not reach it from the hypotheses",
        shown_by="by a re-run with ICP in place of the refiner, or with ground truth as a start",
        advice="try another refiner, or other settings of it (method.refiner)",
        remedies=(BY_ICP, BY_NETWORK),
        numbers={
            "hypothesis": "index of the hypothesis of the answer",
            "calls": "refiner calls that were made",
            "calls_that_took_it_away": "how many of these increased the error",
            "best_iteration": "the iteration that made the pose nearest to the ground truth on the way to the answer",
            "error_before, added_by_refiner, added_by_simulation": "error of the pose nearest to the ground truth "
            "on the way to the answer, and what each added to it from then on",
            "nearest, nearest_error, nearest_rotation_deg": "the hypothesis that started nearest to the ground truth, "
            "and how far that was",
            "nearest_translation_mm": "how far the middle of the object was off there",
            "error_from_ground_truth": "of the answer when it starts at the ground truth",
        },
        picture="A carton whose answer is turned by a quarter and leans",
        command="view failure_icp_slides",
        is_by_chance=True,
    ),
    Cause.POOL: KnownCause(
        title="no good hypothesis in the pool",
        what="there are hypotheses, but none leads to the ground truth",
        shown_by="by a re-run with ground truth as a start",
        advice="no initial pose led to the ground truth, so more or better ones are needed ([hypotheses])",
        remedies=(MORE_HYPOTHESES, FOUND_HYPOTHESES),
        numbers={
            "hypotheses": "how many there are",
            "score": "of the answer",
            "nearest, nearest_error, nearest_rotation_deg": "the hypothesis that started nearest to the ground truth, "
            "and how far that was",
            "nearest_translation_mm": "how far the middle of the object was off there",
            "error_from_ground_truth": "of the answer when it starts at the ground truth",
        },
        picture="A duck whose answer, in green, stands on its head beside the ground truth",
        command="view failure_no_hypothesis_near",
        is_by_chance=True,
    ),
    Cause.UNDECIDED: KnownCause(
        title="undecided: between two basins",
        what="the answer lies between two basins: with other samples of the observed points (another `scene.seed`) it "
        "comes out right as well, and no repair helps clearly more often",
        shown_by="by three re-runs with nothing changed, five where one of them comes out right",
        advice="the same run comes out right for another scene.seed, so more hypotheses make it more certain "
        "([hypotheses], max_per_object)",
        remedies=(MORE_HYPOTHESES,),
        picture="A steel bracket whose answer is off",
        command="view --scene.demo bracket --scene.seed 2 --method.name pir --method.iterations 3 --method.refiner icp "
        "--hypotheses.max-per-object 1 --hypotheses.rotation-deg 90 --hypotheses.translation-mm 15",
    ),
    Cause.NO_HYPOTHESIS: KnownCause(
        title="no hypothesis at all",
        what="no initial pose was given, so nothing was refined",
        shown_by="by a re-run with ground truth as a start",
        advice="without an initial pose nothing is refined, so name further results files or an estimator "
        "(hypotheses.files, hypotheses.estimate)",
        remedies=(FOUND_HYPOTHESES,),
        numbers={
            "hypotheses": "how many there are",
            "error_from_ground_truth": "of the answer when it starts at the ground truth",
        },
        picture="A mug with the contour of its ground truth alone",
    ),
    Cause.IMPOSSIBLE: KnownCause(
        title="physically impossible where it is",
        what="an answer without ground truth floats by more than 5 mm, sinks in 5 mm deeper than short or leaning "
        "heights in the depth image explain, or would tip over; not named where the only evidence is a support "
        "plane that explains little of the background, where three or more objects measure too short by as much as it "
        "sinks in, or where the frame's data are in doubt",
        shown_by="without a re-run: by geometry alone, where the method simulates",
        advice="they sink in, float or would tip, so look at the support plane and at what they touch",
        remedies=(PLAUSIBLE,),
        numbers={
            "penetration_mm, gap_mm": "how deep it sinks in, and how far it is from the nearest surface [mm]",
        },
        picture="A can whose answer floats beside it",
    ),
}


def cause_title(cause: str) -> str:
    """A cause in words for tables and filters; a cause unknown to this version is shown by its name."""
    return CAUSES[Cause(cause)].title if cause in CAUSES else cause.replace("_", " ")


def advice_on(cause: str) -> str:
    """What to try; "" for a cause unknown to this version."""
    return CAUSES[Cause(cause)].advice if cause in CAUSES else ""
