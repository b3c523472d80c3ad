"""The sentence at the top of each panel. Pure text, no markup: who shows it escapes it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import first_of
from verefine_viz.evaluation.pose_errors import turning_on
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.methods.registry import method_of
from verefine_viz.session.breakpoints import UNITS
from verefine_viz.session.files import AT_ITS_START, changed, resolve
from verefine_viz.viewer.snapshot.snapshot import Snapshot, is_revealed
from verefine_viz.viewer.state.branch import current_values, nested
from verefine_viz.viewer.state.view_options import STAGES
from verefine_viz.viewer.text.names import is_correct
from verefine_viz.viewer.text.poses import edited_error, errors_in_words, movement, truth_score, turn

if TYPE_CHECKING:
    from verefine_viz.viewer.snapshot.snapshot import Snapshot


def chosen(view: Snapshot) -> str:
    """Why the bandit took this hypothesis."""
    if view.state is None:
        return "There is no hypothesis to choose from."
    shown = view.shown
    if shown is None:
        if view.state.edited_arms:
            arm = view.state.edited_arms[0]
            return f"Nothing was chosen yet. Hypothesis {arm + 1} was moved by hand: it comes first."
        return _to_choose(view)
    if shown.choice is None:
        works = f"it works on hypothesis {shown.arm + 1}"
        return f"{beside_answer(view)}{view.session.method.name} does not choose between hypotheses: {works}."
    return f"{beside_answer(view)}Iteration {shown.index} took {shown.choice.reason}."


def _to_choose(view: Snapshot) -> str:
    """What will be chosen first, where that is known."""
    name = view.session.method.name
    if method_of(name).has_tree:
        return "The search tree is empty: each iteration adds one object, placed from one of its hypotheses."
    if not method_of(name).chooses:
        return f"{name} does not choose between hypotheses."
    if not method_of(name).has_ucb:
        return "Nothing was chosen yet. Each hypothesis counts its initial score as the first play."
    first = next_choice(Ucb(view.exploration), view.state)
    return f"Nothing was chosen yet, and each initial pose counts as a play. First comes {first.reason}."


def physics(view: Snapshot) -> str:
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


def truth(view: Snapshot) -> str:
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


def never_refined(view: Snapshot) -> str:
    """That the best pose is an initial pose although iterations worked on the object; "" where it is none."""
    answer = view.scene.object(view.target.instance.instance_id).answer if view.is_answer else None
    best = answer or (view.state.best if view.state is not None else None)
    shown_to_its_end = view.cursor - view.is_partial
    if best is None or best.stage != "initial" or not any(i.index <= shown_to_its_end for i in view.own_iterations):
        return ""
    return " It is an initial pose: no iteration has improved upon it."


def remaining(seconds: float | None) -> str:
    """As in: about 12 s left."""
    if seconds is None:
        return ""
    return f"about {seconds:.0f} s left" if seconds < 90 else f"about {seconds / 60:.0f} min left"


def the_answer(view: Snapshot) -> str:
    """As in: the answer, of iteration 16. Plain text; the objects of a frame are each of another."""
    if view.is_whole_scene:
        return "the answer"
    answer = view.scene.object(view.target.instance.instance_id).answer
    if answer is None:
        return "no answer"
    own = f"of iteration {answer.iteration}" if answer.iteration else "an initial pose"
    if len(view.scene.objects) > 1:
        return f"the answer; {view.scene.object(view.target.instance.instance_id).label}: {own}"
    return f"the answer, {own}"


def beside_answer(view: Snapshot) -> str:
    """Where the answer is shown: of which iteration the numbers are that belong to one; empty elsewhere."""
    answer = view.scene.object(view.target.instance.instance_id).answer
    if not view.is_answer or view.shown is None or answer is None:
        return ""
    last = f"iteration {view.shown.index}, the last one on it"
    if answer.iteration == view.shown.index:
        return f"The answer is of {last}. "
    own = f"of iteration {answer.iteration}" if answer.iteration else "an initial pose"
    return f"The answer is {own}; shown here is {last}. "


# The sentence above the switches of the View panel: what is drawn of the object in focus, and what is not.

LABELS = {"camera image": "photo", "ground truth": "truth"}
"""Layers that the panel calls otherwise."""


def view_words(view: Snapshot, switches: Iterable[str]) -> str:
    """As in: Drawn of mug: current, truth. On, but not made here: simulated. Off: best.

    Args:
        view: what is on the screen.
        switches: the layers that can be switched, in the order to name them.
    """
    layers, names = view.options.layers, tuple(switches)
    if view.comparison is not None:
        drawn = "Drawn: the poses of A, solid, and of B, as an outline."
    else:
        poses = [name for name in STAGES if name in layers and name in view.poses]
        drawn = f"Drawn of {view.name}: {_listed(poses) or 'no pose'}{_others(view)}."
    waiting = [name for name in names if name in STAGES and name in layers and name not in view.poses]
    off = [name for name in names if name not in layers]
    return " ".join(
        (
            drawn,
            *([f"On, but not made here: {_listed(waiting)}."] if waiting and view.comparison is None else []),
            f"Off: {_listed(off)}." if off else "Nothing is off.",
            *_cloud(view),
        )
    )


def _others(view: Snapshot) -> str:
    n = sum(o.T_cam_obj is not None for o in view.scene.objects) - 1
    return f"; {n} other object{'s' if n > 1 else ''}" if n > 0 and "others" in view.options.layers else ""


def _cloud(view: Snapshot) -> list[str]:
    if "cloud" not in view.options.layers or view.options.cloud == "colour":
        return []
    of = view.b.pose.label if view.b is not None else "B"
    meant = "observed − rendered depth" if view.options.cloud == "residual" else "class of each pixel"
    return [f"Cloud: {meant} for {of}."]


def _listed(names: Iterable[str]) -> str:
    return ", ".join(LABELS.get(name, name) for name in names)


HINTS = {
    "initial": "where the hypothesis started",
    "current": "where this iteration started",
    "simulated": "after physics",
    "mixed": "rotation of simulated, translation of current: where the refiner starts",
    "refined": "after the refiner",
    "accepted": "what was accepted, outlined",
    "best": "the best of all so far, outlined; where a finished run shows its answer, solid",
    "edited": "moved by hand",
    "ground truth": "outlined in white (G)",
    "hypotheses": "where each hypothesis stands; click one for its history",
    "camera image": "the photo with a score map on it, before the sensor; click for a pixel's numbers",
    "path": "the simulated poses, see Physics",
}


# The sentence above the breakpoints: where a run stops now.

NAMES = {
    "simulated_rejected": "simulated pose rejected",
    "refined_rejected": "refined pose rejected",
    "arm_switched": "other hypothesis",
    "unstable": "unstable",
    "physics_worse": "physics made it worse",
    "empty_render": "empty render",
}
"""Breakpoints without a number, in words."""
CHANGES = {
    "score_falls_by": "score fell by",
    "jump_mm": "moved",
    "jump_deg": "turned",
    "error_grows_by_mm": "error grew",
}
"""The others."""


def breakpoint_words(settings: BreakpointSettings) -> str:
    """As in: A run stops where: moved more than 25 mm, unstable."""
    over = [
        f"{words} more than {value:g}{UNITS[name]}"
        for name, words in CHANGES.items()
        if (value := getattr(settings, name)) is not None
    ]
    ticked = [words for name, words in NAMES.items() if getattr(settings, name)]
    if not over and not ticked:
        return "A run stops nowhere before its end: tick what should stop it."
    return f"A run stops where: {', '.join((*over, *ticked))}."


# The sentence above the settings: what holds now that is not usual, and what a change that was typed will do.

MOST = 3
"""Settings that are named; of more only how many."""


def settings_words(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any], cursor: int) -> str:
    """As in: As recommended, but c 0.4, not 0.7. Changes wait for Restart or Fork.

    Args:
        session: the settings that hold.
        labels: by dotted name of a setting, what the panel calls it.
        typed: values in the fields by dotted name.
        cursor: the iteration that a fork would go on from.
    """
    held = current_values(session, tuple(labels))
    changes = waiting(session, labels, typed)
    if mistake := _mistake(session, labels, typed):
        return f"{mistake}. Restart and Fork would refuse it."
    if changes:
        kept = (
            f"keeps iterations 1 to {cursor}" if cursor > 1 else "keeps iteration 1" if cursor else "is the same here"
        )
        return f"Not in use yet: {first_of(changes, MOST)}. Restart starts again with it; Fork {kept}."
    usual = current_values(resolve({"preset": session.preset}), tuple(labels))
    other = [
        f"{labels[name]} {_shown(held[name])}, not {_shown(usual[name])}"
        for name in labels
        if held[name] != usual[name]
    ]
    of = "as published" if session.preset == "published" else "as recommended"
    if not other:
        return f"All {of}. Changes wait for Restart or Fork."
    return f"{of.capitalize()}, but {first_of(other, MOST, '; ')}. Changes wait for Restart or Fork."


def waiting(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> tuple[str, ...]:
    """What was typed and is not in use yet, as in: c 0.7 → 0.4. Takes what :func:`settings_words` does."""
    held = current_values(session, tuple(labels))
    return tuple(
        f"{labels[name]} {_shown(held[name])} → {_shown(value)}" for name, value in typed.items() if value != held[name]
    )


def _mistake(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> str | None:
    """What is wrong with the first value that no run can have, as in: K = -3: input should be greater than …"""
    held = current_values(session, tuple(labels))
    for name, value in typed.items():
        try:
            if value != held[name]:
                changed(session, nested(((name, value),)), (*AT_ITS_START, "hypotheses"))
        except SettingsError as error:
            return str(error).removeprefix("changed settings: ").replace(name, labels[name])
    return None


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, int | float) else str(value)
