"""Tables about the poses of the object in focus: scores, changes, contacts, errors, branches. Names are escaped."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.core.records import Stage
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.evaluation.pose_errors import turning_on
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import NONE, Column, Row, cut, number, small, swatch, table_of, text
from verefine_viz.viewer.snapshot.snapshot import BranchSummary, EvaluatedPose, Snapshot, is_revealed
from verefine_viz.viewer.state.view_options import STAGES
from verefine_viz.viewer.text.display_names import arm_color, counted, is_correct, source_of, without_model
from verefine_viz.viewer.text.pose_words import score_digits, shift_mm, turn

# The parts of a score, pose by pose.

CLASS_MEANING = {
    "explained": "rendered and observed depth agree within τ",
    "missed": "the object's mask was measured here, but the pose leaves it empty or puts it behind what was measured",
    "protruding": "the pose puts surface where the sensor saw through, or outside the mask onto another surface",
    "hidden": "something nearer stands in front, outside the mask or known from a placed object; does not count",
    "unknown": "rendered, but nothing was measured there; does not count",
}


def score_table(
    a: EvaluatedPose | None, b: EvaluatedPose | None, of: str = "", short: bool = False, rule: str = ""
) -> str:
    """The parts of the scores of two poses, and by how much they differ.

    Args:
        a: the initial pose, None = there is none.
        b: the second pose.
        of: whose they are, as ready HTML.
        short: with the pixels as bars only.
        rule: what the scores are by, for the tooltip.
    """
    poses = [p for p in (a, b) if p is not None]
    scores = [p.score for p in poses]
    known = [s for s in scores if s is not None]
    by = f". {rule}" if rule else ""

    def row(label: str, tip: str, pick: Callable[[PoseScore], float], spec: str, marked: bool = False) -> Row:
        cells = [NONE if s is None else f"{pick(s):{spec}}" for s in scores]
        if len(known) == 2:
            cells.append(f"{pick(known[1]) - pick(known[0]):+{spec}}".replace("-", "−"))
        return Row([f'<span title="{text(tip)}">{label}</span>', *cells], marked=marked)

    colour = max((s.colour_weight for s in known), default=0.0)
    formula = "mean of depth fit and normal fit: (f_d + f_n) / 2"
    if colour:
        formula = f"{1 - colour:.2g} × {formula}, and {colour:.2g} × colour fit f_c where it is positive"
    rows = [
        row("score f̄", f"{formula}{by}", lambda s: s.score,
            f".{score_digits(scores)}f", marked=True),
        row("depth f_d", f"depth fit, mean over the counted pixels; 1 = same depth, 0 = off by τ or more{by}",
            lambda s: s.depth_fit, ".3f"),
        row("normal f_n", f"normal fit, mean over the counted pixels; 1 = same direction{by}",
            lambda s: s.normal_fit, ".3f"),
    ]  # fmt: skip
    if colour:
        rows.append(row("colour f_c", "correlation of the model's and the image's colours over the explained pixels",
                        lambda s: s.colour_fit or 0.0, ".3f"))  # fmt: skip
        rows.append(row("adds", "what colour adds to the score: w max(f_c, 0)", lambda s: s.colour_part, ".3f"))
    if not short:
        rows.append(row("pixels N", "how many pixels count", lambda s: s.n_pixels, ".0f"))
        for name in PIXEL_CLASSES:
            label = f"{swatch(CLASS_COLORS[name])}{name}"
            rows.append(row(label, CLASS_MEANING[name], lambda s, name=name: s.shares[name], ".1%"))
    head = "".join(f'<th title="the {text(p.label)} pose">{text(p.label)}</th>' for p in poses)
    head += '<th title="how much more the second has">B − A</th>' if len(known) == 2 else ""
    body = "".join(r.html for r in rows)
    bars = "".join(_shares_bar(p.label, p.score) for p in poses if p.score)
    return f"<table><thead><tr><th>{of}</th>{head}</tr></thead><tbody>{body}</tbody></table>{bars}"


def _shares_bar(name: str, score: PoseScore) -> str:
    parts = "".join(
        f'<i class="bar" style="width:{share * 96:.1f}%;background:rgb{CLASS_COLORS[k]}" '
        f'title="{text(name)}: {share:.1%} {k}"></i>'
        for k, share in score.shares.items()
        if share > 0.004
    )
    return f'<div style="white-space:nowrap;font-size:0" title="{text(name)}">{parts}</div>'


# Where the score's settings changed on the way: scores before and after are not to be compared.

NOT_COMPARABLE = "not comparable"


def last_of_old_scale(snapshot: Snapshot) -> int | None:
    """The last iteration up to the cursor that was scored by other settings than those at the cursor."""
    return max((k for k in _scale_ends(snapshot) if k < snapshot.cursor), default=None)


def other_scale_note(snapshot: Snapshot) -> str:
    """A line above numbers of both scales; empty where there is one."""
    return small(_changed(last_of_old_scale(snapshot)))


def other_scale_sign(snapshot: Snapshot) -> str:
    """The same where there is room for a sign only."""
    return _sign(_changed(last_of_old_scale(snapshot)))


def one_scale_note(snapshot: Snapshot) -> str:
    """A line above numbers that are all of one scale, where the iterations up to the cursor, or the next, have two."""
    k = max((k for k in _scale_ends(snapshot) if k <= snapshot.cursor), default=None)
    if k is None:
        return ""
    # The answer at the end of a finished run is scored by the last settings.
    which = "later" if snapshot.cursor > k or snapshot.at_end else "earlier"
    return small(f"{_changed(k)} All here are by the {which} settings.")


def _scale_ends(snapshot: Snapshot) -> list[int]:
    """The iterations after which settings of the score changed."""
    ends = (c.after_iteration for c in snapshot.session.changes if "score" in c.settings)
    return [k for k in ends if k > 0]


def _changed(k: int | None) -> str:
    if k is None:
        return ""
    return f"The score's settings changed after iteration {k}: scores up to there are {NOT_COMPARABLE} with later ones."


def _sign(why: str) -> str:
    return f' <span title="{text(why)}" style="cursor:help">⚠</span>' if why else ""


# What the iteration did.


def changes_table(snapshot: Snapshot) -> str:
    """What each stage did to the pose before it."""
    if snapshot.shown is None:
        return ""
    stages = snapshot.shown.stages
    n_shown = next((k for k, s in enumerate(stages) if k and not is_revealed(snapshot, s.name)), len(stages))

    def turned(steps: tuple[Stage, Stage]) -> tuple[float, str]:
        return turn(steps[0].T_cam_obj, steps[1].T_cam_obj)

    def moved_mm(steps: tuple[Stage, Stage]) -> float:
        return shift_mm(steps[0].T_cam_obj, steps[1].T_cam_obj, snapshot.target.model.points)

    columns: list[Column] = [
        ("stage", "against the stage before", lambda s: f"{swatch(STAGE_COLORS[s[1].name])}{s[1].name}"),
        ("turned", "angle between the two poses", lambda s: f"{turned(s)[0]:.2f}°"),
        ("axis", "in the object's frame", lambda s: turned(s)[1] or NONE),
        ("mm", "how far the object's middle moved", lambda s: f"{moved_mm(s):.2f}"),
        ("ms", "time to compute it", lambda s: f"{s[1].ms:.1f}"),
    ]
    return table_of(pairwise(stages[:n_shown]), columns) if n_shown > 1 else ""


def contacts_table(snapshot: Snapshot, most: int = 8) -> str:
    """The contacts at the pose of the simulated path that is shown."""
    path = snapshot.shown.path if snapshot.shown else None
    if path is None or not path.contacts:
        return ""
    k = len(path.contacts) if snapshot.options.path_pose is None else snapshot.options.path_pose
    if k == 0:
        return '<p class="dim">Pose 0 is the start: contacts are known from step 1 on.</p>'
    k = min(k, len(path.contacts))
    contacts = path.contacts[k - 1]
    names = {i.instance_id: snapshot.problem.models[i.obj_id].name for i in snapshot.problem.instances}
    order = sorted(range(len(contacts.depths_m)), key=lambda i: -float(contacts.forces_n[i]))
    columns: list[Column] = [
        ("with", "", lambda i: text(names.get(other := int(contacts.others[i])) or without_model(other) or "object")),
        ("depth mm", "penetration; negative = a gap within Bullet's margin",
         lambda i: f"{contacts.depths_m[i] * 1000:.2f}"),
        ("force N", "normal force", lambda i: f"{contacts.forces_n[i]:.1f}"),
    ]  # fmt: skip
    n, total_n = len(order), float(contacts.forces_n.sum())
    part = f" ({most} of {n} shown)" if n > most else ""
    title = f"<p>After step {k}: {counted(n, 'contact')}, {total_n:.1f} N in all{part}.</p>"
    return title + (table_of(order[:most], columns) if order else "")


# Errors against ground truth.


def errors_table(snapshot: Snapshot) -> str:
    """Errors of every stage at the cursor; click a row to see it beside the best."""
    measured = [p for name in STAGES if (p := snapshot.poses.get(name)) is not None and p.errors is not None]

    def of_estimate(say: Callable[[Any], str]) -> Callable[[EvaluatedPose], str]:
        return lambda pose: NONE if pose.name == "ground truth" else say(pose)

    ways = {pose.name: turning_on(snapshot.target, pose.T_cam_obj) for pose in measured if pose.name != "ground truth"}

    def turning(pose: EvaluatedPose, part: str) -> str:
        way = ways[pose.name]
        return NONE if way is None else _angle(getattr(way, part))

    def share(pose: EvaluatedPose) -> str:
        assert pose.errors is not None
        percent = f"{pose.errors.relative:.0%}"
        return f"<b>{percent}</b>" if is_correct(pose.errors) else percent

    columns: list[Column] = [
        ("stage", "click a row to compare it with stage A", lambda p: f"{swatch(STAGE_COLORS[p.name])}{p.label}"),
        ("rot.", "angle to the nearest of the poses that look the same",
         of_estimate(lambda p: _angle(p.errors.rotation_deg))),
        ("tilt", "of that: how far the object leans against its support plane",
         of_estimate(lambda p: turning(p, "tilt_deg"))),
        ("turn", "of that: how far it is turned on its support plane, about the plane's normal",
         of_estimate(lambda p: turning(p, "turn_deg"))),
        ("mm", "distance of the object's origin", of_estimate(lambda p: f"{p.errors.translation_mm:.1f}")),
        ("ADD(-S)", "mean distance of model points [mm]; ADD-S if symmetric",
         of_estimate(lambda p: f"{p.errors.add_s_mm:.1f}")),
        ("diam.", "ADD(-S) as a share of the diameter; bold = below 10 %, which counts as correct", of_estimate(share)),
        ("score", "verification score", lambda p: number(p.score.score if p.score else None, 3)),
    ]  # fmt: skip
    return table_of(measured, columns, lambda p: c.Compare(b=p.name), lambda p: p.name == snapshot.options.b)


def _angle(degrees: float) -> str:
    """Narrow: eight columns have to fit."""
    return f"{degrees:.1f}°" if degrees < 9.95 else f"{degrees:.0f}°"


def starts_table(snapshot: Snapshot) -> str:
    """Errors of the initial poses; empty where they are unknown."""
    hypotheses, errors = snapshot.target.instance.hypotheses, [e for e in snapshot.initial_errors if e is not None]
    if len(errors) < len(hypotheses):
        return ""
    columns: list[Column] = [
        ("hyp.", "hypothesis", lambda j: f"{swatch(arm_color(j))}{j + 1}"),
        ("from", "where it comes from", lambda j: cut(source_of(hypotheses[j]))),
        ("rot.", "rotation error", lambda j: f"{errors[j].rotation_deg:.1f}°"),
        ("mm", "translation error", lambda j: f"{errors[j].translation_mm:.1f}"),
        ("ADD(-S)", "[mm]", lambda j: f"{errors[j].add_s_mm:.1f}"),
        ("score", "of the initial pose",
         lambda j: number(snapshot.state.initial[j].score if snapshot.state is not None else None, 3)),
    ]  # fmt: skip
    return "<p><b>Initial poses</b></p>" + table_of(range(len(hypotheses)), columns, c.SelectArm)


# The runs on this frame.


def other_branch_sign(branch: BranchSummary) -> str:
    """A sign behind a branch's score; empty where it is by the settings of the shown branch."""
    why = f"by other score settings than the shown branch's: {NOT_COMPARABLE}"
    return _sign(why if branch.has_other_scale else "")


def branches_table(snapshot: Snapshot) -> str:
    """The runs on this frame, and how the object in focus fared in each."""
    branches = snapshot.branches
    if len(branches) < 2:
        return ""
    k = [i.instance_id for i in snapshot.problem.instances].index(snapshot.target.instance.instance_id)

    def score(i: int) -> str:
        best = branches[i].best[k]
        return number(best.score.score if best else None, 3) + other_branch_sign(branches[i])

    def add_s(i: int) -> str:
        errors = branches[i].errors[k]
        return number(errors.add_s_mm if errors else None, 1)

    columns: list[Column] = [
        ("branch", "click a row to switch to it", lambda i: cut(branches[i].name, 170)),
        ("made", "iterations", lambda i: f"{branches[i].length}/{branches[i].n_iterations}"),
        ("answer", "score of this object's answer so far", score),
        ("ADD(-S)", "error of that pose [mm]", add_s),
    ]
    note = ""
    if any(b.has_other_scale for b in branches):
        note = small(f"⚠ scored by other settings than the shown branch: scores are {NOT_COMPARABLE}.")
    return table_of(range(len(branches)), columns, c.ShowBranch, lambda i: i == snapshot.branch) + note
