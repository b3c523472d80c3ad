"""The panels' sentences in plain words. Pure text, no markup: who shows it escapes it."""

from __future__ import annotations

from verefine_viz.evaluation.turning import turning_on
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.methods.registry import SEARCH
from verefine_viz.viewer.answer import beside_answer
from verefine_viz.viewer.correct import is_correct
from verefine_viz.viewer.edited_words import edited_error
from verefine_viz.viewer.plays import CHOOSING, WITH_UCB
from verefine_viz.viewer.pose_words import errors_in_words, movement, turn
from verefine_viz.viewer.revealing import is_revealed
from verefine_viz.viewer.truth_score import truth_score
from verefine_viz.viewer.view import View


def chosen(view: View) -> str:
    """Why the bandit took this hypothesis."""
    if view.state is None:
        return "There is no hypothesis to choose from."
    shown = view.shown
    if shown is None:
        if view.state.by_hand:
            return f"Nothing was chosen yet. Hypothesis {view.state.by_hand[0] + 1} was moved by hand: it comes first."
        return _to_choose(view)
    if shown.choice is None:
        works = f"it works on hypothesis {shown.arm + 1}"
        return f"{beside_answer(view)}{view.session.method.name} does not choose between hypotheses: {works}."
    return f"{beside_answer(view)}Iteration {shown.index} took {shown.choice.reason}."


def _to_choose(view: View) -> str:
    """What will be chosen first, where that is known."""
    name = view.session.method.name
    if name == SEARCH:
        return "The search tree is empty: each iteration adds one object, placed from one of its hypotheses."
    if name not in CHOOSING:
        return f"{name} does not choose between hypotheses."
    if name not in WITH_UCB:
        return "Nothing was chosen yet. Each hypothesis counts its initial score as the first play."
    first = next_choice(Ucb(view.exploration), view.state)
    return f"Nothing was chosen yet, and each first pose counts as a play. First comes {first.reason}."


def physics(view: View) -> str:
    """What the simulation did and what the refiner made of it."""
    shown = view.shown
    if view.target.observation.support is None:
        note = view.target.observation.support_note or "no support plane was found"
        return f"Physics is off for this frame: {note}"
    if not view.session.physics.enabled:
        return "Physics is switched off in the settings: nothing was simulated."
    if shown is None:
        return "No simulation yet: step once (N)."
    if not is_revealed(view, "simulated") and shown.stage("simulated") is not None:
        return f"Iteration {shown.index} is about to be simulated: press Stage (M)."
    simulated = shown.stage("simulated")
    refined = shown.stage("refined") if is_revealed(view, "refined") else None
    if simulated is None or shown.path is None:
        return f"{view.session.method.name} did not simulate in iteration {shown.index}."
    points = view.target.model.points
    steps = len(shown.path.Ts_cam_obj) - 1
    several = len(view.scene.objects) > 1
    label = view.scene.object(view.target.instance.instance_id).label
    said = (f"{label}: " if several else "") + beside_answer(view)
    said += f"In {steps} steps the simulation {movement(shown.stages[0].T_cam_obj, simulated.T_cam_obj, points)}"
    n = len(shown.path.contacts[-1].depths_m) if shown.path.contacts else 0
    said += f", ending with {n} contact{'s' if n != 1 else ''}."
    if refined is not None:
        mixed = shown.stage("mixed") or simulated
        said += f" The refiner then {movement(mixed.T_cam_obj, refined.T_cam_obj, points)}."
        undone = turn(shown.stages[0].T_cam_obj, refined.T_cam_obj)[0]
        turned = turn(shown.stages[0].T_cam_obj, simulated.T_cam_obj)[0]
        if turned > 2 and undone < turned / 2:
            said += f" It took back most of the turn: {undone:.1f}° are left."
    return said


def truth(view: View) -> str:
    """How far off the object is, and whether the score knows."""
    if view.truth is None:
        return "This frame has no ground truth for the object, so there are no errors to show."
    best = view.poses.get("best")
    if best is None or best.errors is None or best.score is None or view.truth.score is None:
        return f"{view.name} has no pose to measure."
    by_hand = edited_error(view)
    if by_hand:
        return f"{by_hand} The best pose so far is off by {best.errors.add_s_mm:.1f} mm."
    verdict = "correct" if is_correct(best.errors) else "wrong"
    what = "answer" if best.is_of_best_scene else "best pose"
    way = turning_on(view.target, best.T_cam_obj)
    said = (
        f"The {what} so far is {errors_in_words(best.errors, way)}; ADD(-S) {best.errors.add_s_mm:.1f} mm is "
        f"{best.errors.relative:.0%} of the diameter: {verdict} by the usual 10 %."
    )
    if view.state is not None and view.state.best.arm != view.arm:
        said += (
            f" Initial is where hypothesis {view.arm + 1} began; the {what} is of hypothesis {view.state.best.arm + 1}."
        )
    return f"{said}{never_refined(view)} {truth_score(view)}"


def never_refined(view: View) -> str:
    """That the best pose is a first pose although iterations worked on the object; "" where it is none."""
    answer = view.scene.object(view.target.instance.instance_id).answer if view.is_answer else None
    best = answer or (view.state.best if view.state is not None else None)
    told = view.cursor - view.is_partial
    if best is None or best.stage != "initial" or not any(i.index <= told for i in view.own_iterations):
        return ""
    return " It is a first pose: no iteration has improved upon it."


def remaining(seconds: float | None) -> str:
    """As in: about 12 s left."""
    if seconds is None:
        return ""
    return f"about {seconds:.0f} s left" if seconds < 90 else f"about {seconds / 60:.0f} min left"
