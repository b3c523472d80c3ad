"""The panels' tables, as HTML. Names that come from data are escaped by :mod:`markup`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.evaluation.turning import turning_on
from verefine_viz.physics.standing import PLANE_ID
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import NONE, Row, cut, number, swatch, table, text, with_hints
from verefine_viz.viewer.snapshot.snapshot import BranchSummary, EvaluatedPose, Probe, Snapshot, is_revealed
from verefine_viz.viewer.state.view_options import STAGES
from verefine_viz.viewer.text.display_names import TERMS, arm_color, source_of
from verefine_viz.viewer.text.pose_words import score_digits, shift_mm, turn

# The tables of a score: its parts pose by pose, and what one pixel adds to it.

CLASS_MEANING = {
    "explained": "rendered and observed depth agree within τ",
    "missed": "the object's mask was measured here, but the pose leaves it empty or puts it behind what was measured",
    "protruding": "the pose puts surface where the sensor saw through, or outside the mask onto another surface",
    "hidden": "something nearer stands in front, outside the mask or known from a placed object; does not count",
    "unknown": "rendered, but nothing was measured there; does not count",
}


def score_table(poses: Sequence[EvaluatedPose | None], short: bool = False) -> str:
    """The parts of the score of some poses, a column each; ``short``: the pixels as bars only."""
    known = [p for p in poses if p is not None]
    head = [("", ""), *((p.label, f"the {p.label} pose") for p in known)]
    scores = [p.score for p in known]

    def row(label: str, tip: str, cells: Iterable[str], marked: bool = False) -> Row:
        return Row([f'<span title="{text(tip)}">{label}</span>', *cells], marked=marked)

    def part(pick: Any, digits: int) -> list[str]:
        return [NONE if s is None else f"{pick(s):.{digits}f}" for s in scores]

    rows = [
        row("score f̄", "mean of depth fit and normal fit: (f_d + f_n) / 2",
            part(lambda s: s.score, score_digits(scores)), marked=True),
        row("depth fit f_d", "mean over the counted pixels; 1 = same depth, 0 = off by τ or more",
            part(lambda s: s.depth_fit, 3)),
        row("normal fit f_n", "mean over the counted pixels; 1 = same direction", part(lambda s: s.normal_fit, 3)),
    ]  # fmt: skip
    if not short:
        rows.append(row("pixels N", "how many pixels count", part(lambda s: s.n_pixels, 0)))
    for name in () if short else PIXEL_CLASSES:
        cells = [NONE if s is None else f"{s.shares[name]:.1%}" for s in scores]
        rows.append(row(f"{swatch(CLASS_COLORS[name])}{name}", CLASS_MEANING[name], cells))
    return table(head, rows) + "".join(_shares_bar(p.label, p.score) for p in known if p.score)


def _shares_bar(name: str, score: PoseScore) -> str:
    parts = "".join(
        f'<i class="bar" style="width:{share * 96:.1f}%;background:rgb{CLASS_COLORS[k]}" '
        f'title="{text(name)}: {share:.1%} {k}"></i>'
        for k, share in score.shares.items()
        if share > 0.004
    )
    return f'<div style="white-space:nowrap;font-size:0" title="{text(name)}">{parts}</div>'


def probe_table(a: tuple[str, Probe | None], b: tuple[str, Probe | None]) -> str:
    """One pixel in numbers, for both stages."""
    sides = [(name, p) for name, p in (a, b) if p is not None]
    if not sides:
        return ""
    first = sides[0][1]

    def row(label: str, tip: str, pick: Any) -> Row:
        return Row([f'<span title="{text(tip)}">{label}</span>', *(text(pick(p)) for _, p in sides)])

    rows = [
        row("observed", "depth that the sensor measured", lambda p: number(p.observed_m, 4, " m")),
        row("rendered", "depth of the model", lambda p: number(p.rendered_m, 4, " m")),
        row("Δ depth, angle", "observed − rendered; between the normals",
            lambda p: f"{number(p.difference_mm, 1, ' mm')}, {number(p.angle_deg, 1, '°')}"),
        row("f_d, f_n", "depth and normal fit", lambda p: f"{p.f_d:.2f}, {p.f_n:.2f}"),
        row("class", "why it counts as it does", lambda p: p.pixel_class),
        row("adds", "what this pixel adds to the score", lambda p: f"{p.contribution:.5f}"),
    ]  # fmt: skip
    head = [(f"pixel {first.u}, {first.v}", "column u, row v"), *((name, "") for name, _ in sides)]
    return table(head, rows)


# Where the score's settings changed on the way: scores before and after are not to be compared.

NOT_COMPARABLE = "not comparable"


def last_of_old_scale(snapshot: Snapshot) -> int | None:
    """The last iteration up to the cursor that was scored by other settings than those at the cursor."""
    return max((k for k in _ends(snapshot) if k < snapshot.cursor), default=None)


def other_scale_note(snapshot: Snapshot) -> str:
    """A line above numbers of both scales; empty where there is one."""
    said = _said(snapshot)
    return f'<p class="legend dim">{text(said)}</p>' if said else ""


def other_scale_sign(snapshot: Snapshot) -> str:
    """The same where there is room for a sign only."""
    said = _said(snapshot)
    return f'<span title="{text(said)}" style="cursor:help">⚠</span>' if said else ""


def one_scale_note(snapshot: Snapshot) -> str:
    """A line above numbers that are all of one scale, where the iterations up to the cursor, or the next, have two."""
    k = max((k for k in _ends(snapshot) if k <= snapshot.cursor), default=None)
    if k is None:
        return ""
    # At the end of a finished run its answer is judged, by the last settings.
    is_later = snapshot.cursor > k or snapshot.at_end
    said = f"{_changed(k)} All here are by the {'later' if is_later else 'earlier'} settings."
    return f'<p class="legend dim">{text(said)}</p>'


def other_branch_sign(branch: BranchSummary) -> str:
    """A sign behind a branch's score; empty where it is by the settings of the shown branch."""
    said = f"by other score settings than the shown branch's: {NOT_COMPARABLE}"
    return f' <span title="{said}" style="cursor:help">⚠</span>' if branch.has_other_scale else ""


def other_branches_note(branches: Sequence[BranchSummary]) -> str:
    """What that sign says, as a line; empty where no branch has it."""
    said = f"⚠ scored by other settings than the shown branch: scores are {NOT_COMPARABLE}."
    return f'<p class="legend dim">{said}</p>' if any(b.has_other_scale for b in branches) else ""


def _ends(snapshot: Snapshot) -> list[int]:
    """The iterations after which settings of the score changed."""
    ends = (c.after_iteration for c in snapshot.session.changes if "score" in c.settings)
    return [k for k in ends if k > 0]


def _said(snapshot: Snapshot) -> str:
    k = last_of_old_scale(snapshot)
    return "" if k is None else _changed(k)


def _changed(k: int) -> str:
    return f"The score's settings changed after iteration {k}: scores up to there are {NOT_COMPARABLE} with later ones."


def changes_table(snapshot: Snapshot) -> str:
    """What each stage did to the pose before it."""
    shown = snapshot.shown
    if shown is None:
        return ""
    points = snapshot.target.model.points
    rows = []
    for before, stage in zip(shown.stages, shown.stages[1:]):  # noqa: B905
        if not is_revealed(snapshot, stage.name):
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


def contacts_table(snapshot: Snapshot, most: int = 8) -> str:
    """The contacts at the pose of the simulated path that is shown."""
    path = snapshot.shown.path if snapshot.shown else None
    if path is None or not path.contacts:
        return ""
    k = snapshot.options.path_pose if snapshot.options.path_pose is not None else len(path.contacts)
    if k == 0:
        return '<p class="dim">Pose 0 is the start: contacts are known from step 1 on.</p>'
    contacts = path.contacts[min(k, len(path.contacts)) - 1]
    names = {i.instance_id: snapshot.problem.models[i.obj_id].name for i in snapshot.problem.instances}
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


def errors_table(snapshot: Snapshot) -> str:
    """Errors of every stage at the cursor; click a row to see it beside the best."""
    rows = []
    for name in STAGES:
        pose = snapshot.poses.get(name)
        if pose is None or pose.errors is None:
            continue
        e = pose.errors
        is_truth, way = name == "ground truth", turning_on(snapshot.target, pose.T_cam_obj)
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
        rows.append(Row(cells, c.Compare(b=name), marked=name == snapshot.options.b))
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


def starts_table(snapshot: Snapshot) -> str:
    """Errors of the initial poses."""
    rows = []
    for j, (h, e) in enumerate(zip(snapshot.target.instance.hypotheses, snapshot.initial_errors, strict=True)):
        if e is None:
            return ""
        score = snapshot.state.initial[j].score if snapshot.state is not None else None
        cells = [
            f"{swatch(arm_color(j))}{j + 1}", cut(source_of(h)), f"{e.rotation_deg:.1f}°",
            f"{e.translation_mm:.1f}", f"{e.add_s_mm:.1f}", number(score, 3),
        ]  # fmt: skip
        rows.append(Row(cells, c.SelectArm(j)))
    head = [
        ("arm", "hypothesis"), ("from", "where it comes from"), ("rot.", "rotation error"),
        ("mm", "translation error"), ("ADD(-S)", "[mm]"), ("score", "of the initial pose"),
    ]  # fmt: skip
    return "<p><b>Initial poses</b></p>" + table(head, rows)


def branches_table(snapshot: Snapshot) -> str:
    """The runs on this frame, and how the object in focus fared in each."""
    if len(snapshot.branches) < 2:
        return ""
    ids = [i.instance_id for i in snapshot.problem.instances]
    k = ids.index(snapshot.target.instance.instance_id)
    rows = []
    for i, branch in enumerate(snapshot.branches):
        best, errors = branch.best[k], branch.errors[k]
        cells = [
            cut(branch.name, 170),
            f"{branch.length}/{branch.n_iterations}",
            number(best.score.score if best else None, 3) + other_branch_sign(branch),
            number(errors.add_s_mm if errors else None, 1),
        ]
        rows.append(Row(cells, c.ShowBranch(i), marked=i == snapshot.branch))
    head = [
        ("branch", "click a row to switch to it"), ("made", "iterations"), ("best", "best score of this object"),
        ("ADD(-S)", "error of that pose [mm]"),
    ]  # fmt: skip
    return table(head, rows) + other_branches_note(snapshot.branches)


def event_lines(snapshot: Snapshot) -> str:
    """The marks of the iteration that is shown; none where the answer is."""
    if snapshot.is_answer:
        return ""
    own = [m for m in snapshot.marks if snapshot.shown is not None and m.iteration == snapshot.shown.index]
    return "".join(f"<p>{swatch(m.color)}{with_hints(m.text, TERMS)}</p>" for m in own)
