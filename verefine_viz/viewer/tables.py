"""The panels' tables, as HTML. Names that come from data are escaped by :mod:`markup`."""

from __future__ import annotations

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.evaluation.turning import turning_on
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.physics.standing import PLANE_ID
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.arms import arm_color, arms_legend, have_names, source_of
from verefine_viz.viewer.long_names import cut
from verefine_viz.viewer.look import STAGES
from verefine_viz.viewer.markup import Row, swatch, table, text, with_hints
from verefine_viz.viewer.plays import (
    N_MEANS,
    TIME_MEANS,
    WITH_UCB,
    mean_of,
    plays_text,
    what_n_counts,
    what_the_mean_is_of,
    what_the_time_holds,
)
from verefine_viz.viewer.pose_words import shift_mm, turn
from verefine_viz.viewer.revealing import is_revealed
from verefine_viz.viewer.scales import other_branch_sign, other_branches_note
from verefine_viz.viewer.scene_words import TERMS
from verefine_viz.viewer.view import View

NONE = "–"
"""What stands where there is no number."""


def number(value: float | None, digits: int, unit: str = "") -> str:
    """A number with its unit, or a dash."""
    return NONE if value is None else f"{value:.{digits}f}{unit}"


def arms_table(view: View) -> str:
    """The bandit's numbers as they were when it chose; before the first choice, as they will be."""
    state = view.state
    if state is None:
        return ""
    shown = view.shown
    choice = shown.choice if shown and shown.choice else None
    if choice is None and shown is None and view.session.method.name in WITH_UCB:
        choice = next_choice(Ucb(view.exploration), state)
    taken = shown.arm if shown else (choice.arm if choice else None)
    rows = []
    for j, arm in enumerate(state.arms):
        own = [i for i in view.own_iterations if i.arm == j and i.index <= view.cursor]
        best = max(e.score.score for e in arm.entries)
        ms = sum(i.ms for i in own)
        plays, mean, bonus, ucb = (
            (choice.plays[j], choice.mean[j], choice.exploration[j], choice.ucb[j])
            if choice
            else (arm.plays, arm.mean, None, None)
        )
        error = view.initial_errors[j]
        cells = [
            f"{swatch(arm_color(j))}{j + 1}{' ◂' if j == taken else ''}",
            plays_text(float(plays)),
            f"{mean:.3f}",
            number(bonus, 3),
            number(ucb, 3),
            f"{best:.3f}",
            number(error.rotation_deg if error else None, 0, "°"),
            f"{ms:.0f}",
        ]
        rows.append(Row(cells, c.SelectArm(j), marked=j == view.arm))
    head = [
        ("arm", "hypothesis; ◂ = chosen; click a row for its history"),
        ("n", N_MEANS),
        ("μ", mean_of(view)),
        ("bonus", "exploration term c·√(ln Σn / n_j)"),
        ("UCB", "mean + bonus; the largest is chosen"),
        ("best", "best score of any of its poses so far"),
        ("start", "rotation error of its first pose against ground truth"),
        ("Σ ms", TIME_MEANS),
    ]
    names = f'<p class="legend">{arms_legend(view.target)}</p>' if have_names(view.target) else ""
    return names + table(head, rows) + what_the_mean_is_of(view) + what_n_counts(view) + what_the_time_holds(view)


def changes_table(view: View) -> str:
    """What each stage did to the pose before it."""
    shown = view.shown
    if shown is None:
        return ""
    points = view.target.model.points
    rows = []
    for before, stage in zip(shown.stages, shown.stages[1:]):  # noqa: B905
        if not is_revealed(view, stage.name):
            break
        angle, axis = turn(before.T_cam_obj, stage.T_cam_obj)
        cells = [
            f"{swatch(STAGE_COLORS[stage.name])}{stage.name}",
            f"{angle:.2f}°",
            axis or NONE,
            f"{shift_mm(before.T_cam_obj, stage.T_cam_obj, points):.2f}",
            f"{stage.ms:.1f}",
        ]
        rows.append(Row(cells))
    head = [
        ("stage", "against the stage before"), ("turned", "angle between the two poses"),
        ("axis", "in the object's frame"),
        ("mm", "how far the object's middle moved"), ("ms", "time to compute it"),
    ]  # fmt: skip
    return table(head, rows) if rows else ""


def contacts_table(view: View, most: int = 8) -> str:
    """The contacts at the pose of the simulated path that is shown."""
    path = view.shown.path if view.shown else None
    if path is None or not path.contacts:
        return ""
    k = view.look.path_pose if view.look.path_pose is not None else len(path.contacts)
    if k == 0:
        return '<p class="dim">Pose 0 is the start: contacts are known from step 1 on.</p>'
    contacts = path.contacts[min(k, len(path.contacts)) - 1]
    names = {i.instance_id: view.problem.models[i.obj_id].name for i in view.problem.instances}
    order = sorted(range(len(contacts.depths_m)), key=lambda i: -float(contacts.forces_n[i]))
    rows = [
        Row(
            [
                "table" if contacts.others[i] == PLANE_ID else text(names.get(int(contacts.others[i]), "object")),
                f"{contacts.depths_m[i] * 1000:.2f}",
                f"{contacts.forces_n[i]:.1f}",
            ]
        )
        for i in order[:most]
    ]
    n, total = len(order), float(contacts.forces_n.sum())
    cut = f" ({most} of {n} shown)" if n > most else ""
    title = f"<p>After step {min(k, len(path.contacts))}: {n} contact{'s' * (n != 1)}, {total:.1f} N in all{cut}.</p>"
    head = [
        ("with", ""), ("depth mm", "penetration; negative = a gap within Bullet's margin"),
        ("force N", "normal force"),
    ]  # fmt: skip
    return title + (table(head, rows) if rows else "")


def errors_table(view: View) -> str:
    """Errors of every stage at the cursor; click a row to see it beside the best."""
    rows = []
    for name in STAGES:
        pose = view.poses.get(name)
        if pose is None or pose.errors is None:
            continue
        e = pose.errors
        is_truth, way = name == "ground truth", turning_on(view.target, pose.T_cam_obj)
        cells = [
            f"{swatch(STAGE_COLORS[name])}{'truth' if is_truth else pose.label}",
            NONE if is_truth else _angle(e.rotation_deg),
            NONE if is_truth or way is None else _angle(way.tilt_deg),
            NONE if is_truth or way is None else _angle(way.turn_deg),
            NONE if is_truth else f"{e.translation_mm:.1f}",
            NONE if is_truth else f"{e.add_s_mm:.1f}",
            NONE if is_truth else f"{e.relative:.0%}",
            number(pose.score.score if pose.score else None, 3),
        ]
        rows.append(Row(cells, c.Compare(b=name), marked=name == view.look.b))
    head = [
        ("stage", "click a row to compare it with stage A"),
        ("rot.", "angle to the nearest of the poses that look the same"),
        ("tilt", "of that: how far the object leans against its support plane"),
        ("turn", "of that: how far it is turned on its support plane, about the plane's normal"),
        ("mm", "distance of the object's origin"),
        ("ADD(-S)", "mean distance of model points [mm]; ADD-S if symmetric"),
        ("of ∅", "ADD(-S) as a share of the diameter; below 10 % counts as correct"),
        ("score", "verification score"),
    ]
    return table(head, rows)


def _angle(degrees: float) -> str:
    """Narrow: eight columns have to fit."""
    return f"{degrees:.1f}°" if degrees < 9.95 else f"{degrees:.0f}°"


def starts_table(view: View) -> str:
    """Errors of the first poses."""
    rows = []
    for j, (h, e) in enumerate(zip(view.target.instance.hypotheses, view.initial_errors, strict=True)):
        if e is None:
            return ""
        score = view.state.initial[j].score if view.state is not None else None
        cells = [
            f"{swatch(arm_color(j))}{j + 1}", cut(source_of(h)), f"{e.rotation_deg:.1f}°",
            f"{e.translation_mm:.1f}", f"{e.add_s_mm:.1f}", number(score, 3),
        ]  # fmt: skip
        rows.append(Row(cells, c.SelectArm(j)))
    head = [
        ("arm", "hypothesis"), ("from", "where it comes from"), ("rot.", "rotation error"),
        ("mm", "translation error"), ("ADD(-S)", "[mm]"), ("score", "of the first pose"),
    ]  # fmt: skip
    return "<p><b>First poses</b></p>" + table(head, rows)


def branches_table(view: View) -> str:
    """The runs on this frame, and how the object in focus fared in each."""
    if len(view.branches) < 2:
        return ""
    ids = [i.instance_id for i in view.problem.instances]
    k = ids.index(view.target.instance.instance_id)
    rows = []
    for i, branch in enumerate(view.branches):
        best, errors = branch.best[k], branch.errors[k]
        cells = [
            cut(branch.name, 170),
            f"{branch.length}/{branch.n_iterations}",
            number(best.score.score if best else None, 3) + other_branch_sign(branch),
            number(errors.add_s_mm if errors else None, 1),
        ]
        rows.append(Row(cells, c.ShowBranch(i), marked=i == view.branch))
    head = [
        ("branch", "click a row to switch to it"), ("made", "iterations"), ("best", "best score of this object"),
        ("ADD(-S)", "error of that pose [mm]"),
    ]  # fmt: skip
    return table(head, rows) + other_branches_note(view.branches)


def event_lines(view: View) -> str:
    """The marks of the iteration that is shown; none where the answer is."""
    if view.is_answer:
        return ""
    own = [m for m in view.marks if view.shown is not None and m.iteration == view.shown.index]
    return "".join(f"<p>{swatch(m.color)}{with_hints(m.text, TERMS)}</p>" for m in own)
