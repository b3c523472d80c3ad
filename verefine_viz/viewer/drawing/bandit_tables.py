"""Tables of hypotheses, plays and passes: what the bandit counted when it chose."""

from __future__ import annotations

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import (
    NONE,
    Column,
    Row,
    arms_legend,
    cut,
    number,
    swatch,
    table,
    table_of,
    text,
)
from verefine_viz.viewer.drawing.pose_tables import other_scale_note
from verefine_viz.viewer.snapshot.scene_state import ObjectState
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.display_names import TERMS, arm_color, has_several_sources, in_focus
from verefine_viz.viewer.text.pose_words import shift_mm, turn

TIME_MEANS = (
    "computing time of all its plays so far, added up [ms]. The first play on an object also prepares it, once for all "
    "hypotheses and runs: the simulator gets its shape, the refiner its search structure. After a restart that is done."
)


def plays_text(plays: float) -> str:
    """A count of plays, which may be discounted."""
    return f"{plays:.0f}" if plays == round(plays) else f"{plays:.2f}"


def n_means(snapshot: Snapshot) -> str:
    """What n counts, for a tooltip."""
    method = method_of(snapshot.session.method.name)
    if not method.chooses:
        return "iterations spent on it"
    meaning = (
        "n_j, the plays that the bandit counted when it chose: the initial pose is one of them, and its score part of "
        "the mean μ_j. The Pulls curves count choices only, up to and with this iteration."
    )
    if any(edit.instance == snapshot.target.instance.instance_id for edit in snapshot.edits):
        meaning += " An edited pose starts again at 1."
    if method.has_passes and snapshot.session.method.discount < 1:
        meaning += f" Earlier plays fade, ×{snapshot.session.method.discount:g} a pass."
    return meaning


def mean_of(snapshot: Snapshot) -> str:
    """What μ is the mean of, for a tooltip: the score of whole scenes where those reward the hypotheses."""
    o, method = in_focus(snapshot), snapshot.session.method
    together = sum(p.cluster == o.cluster and bool(p.target.instance.hypotheses) for p in snapshot.scene.objects)
    if not method_of(method.name).has_passes or together < 2:
        return "μ_j, mean over the plays: the score of the initial pose, and of each play the highest of its poses"
    whole = "all objects together" if snapshot.scene.n_clusters < 2 else f"cluster {o.cluster} as a whole"
    at = "its poses" if method.scene_reward == "current_pass" else "the best pose of each object so far"
    meaning = (
        "μ_j, mean over the plays, not of this object alone as “best” is. Each pass counts for the hypotheses it "
        f"chose: the score of {whole} at {at}"
    )
    if any(c.after_iteration and "name" in c.settings.get("method", {}) for c in snapshot.session.changes):
        return f"{meaning}. Plays before vf_depth took over count the object's own score."
    if method.scene_prior == "object":
        return f"{meaning}. The first play counts the score of the object's initial pose alone."
    return (
        f"{meaning}. The first play counts that score with this initial pose and the best initial poses of the others."
    )


def arms_table(snapshot: Snapshot) -> str:
    """The bandit's numbers as they were when it chose; before the first choice, as they will be."""
    state, shown = snapshot.state, snapshot.shown
    if state is None:
        return ""
    choice = shown.choice if shown else None
    if shown is None and method_of(snapshot.session.method.name).has_ucb:
        choice = next_choice(Ucb(snapshot.exploration), state)
    taken = shown.arm if shown else choice.arm if choice else None
    plays = choice.plays if choice else [arm.plays for arm in state.arms]
    mean = choice.mean if choice else [arm.mean for arm in state.arms]
    bonus = choice.exploration.tolist() if choice else [None] * len(state.arms)
    ucb = choice.ucb.tolist() if choice else [None] * len(state.arms)
    ms = [sum(i.ms for i in snapshot.own_iterations if i.arm == j and i.index <= snapshot.cursor)
          for j in range(len(state.arms))]  # fmt: skip

    def start_deg(j: int) -> str:
        error = snapshot.initial_errors[j]
        return number(error.rotation_deg if error else None, 0, "°")

    columns: list[Column] = [
        ("arm", "hypothesis; ◂ = chosen; click a row for its history",
         lambda j: f"{swatch(arm_color(j))}{j + 1}{' ◂' if j == taken else ''}"),
        ("n", n_means(snapshot), lambda j: plays_text(float(plays[j]))),
        ("μ", mean_of(snapshot), lambda j: f"{mean[j]:.3f}"),
        ("bonus", "exploration term c·√(ln Σn / n_j); c: weight in Settings, the larger the more is tried",
         lambda j: number(bonus[j], 3)),
        ("UCB", "mean + bonus; the largest is chosen", lambda j: number(ucb[j], 3)),
        ("best", "best score of any of its poses so far",
         lambda j: f"{max(e.score.score for e in state.arms[j].entries):.3f}"),
        ("start", "rotation error of its initial pose against ground truth", start_deg),
        ("Σ ms", TIME_MEANS, lambda j: f"{ms[j]:.0f}"),
    ]  # fmt: skip
    names = f'<p class="legend">{arms_legend(snapshot.target)}</p>' if has_several_sources(snapshot.target) else ""
    return names + table_of(range(len(state.arms)), columns, c.SelectArm, lambda j: j == snapshot.arm)


# What became of one hypothesis, play by play.


def arm_history(snapshot: Snapshot, most: int = 12) -> str:
    """What became of the hypothesis in focus: ``most`` of its plays around the cursor, the latest first."""
    if snapshot.state is None:
        return ""
    j, cursor = snapshot.arm, snapshot.cursor
    partial = cursor if snapshot.is_partial else None
    own = [(i, e) for i, e, _ in snapshot.error_series if i.arm == j and i.index != partial]
    done = sum(i.index <= cursor for i, _ in own)
    begin = max(0, min(done - most // 2, len(own) - most))
    end = min(begin + most, len(own))
    rows = [_not_listed(snapshot, f"{len(own) - end} later", own[end][0])] if end < len(own) else []
    for iteration, errors in reversed(own[begin:end]):
        before, after = iteration.stages[0], iteration.accepted_stage
        cells = [
            f"{iteration.index}",
            f"{swatch(STAGE_COLORS[iteration.accepted])}{iteration.accepted}",
            number(after.score.score if after.score else None, 3),
            f"{turn(before.T_cam_obj, after.T_cam_obj)[0]:.1f}°",
            f"{shift_mm(before.T_cam_obj, after.T_cam_obj, snapshot.target.model.points):.1f}",
            number(errors.add_s_mm if errors else None, 1),
        ]
        rows.append(Row(cells, visit(snapshot, iteration), marked=iteration.index == cursor))
        if any(event.kind == "edited" for event in iteration.events):
            score = number(before.score.score if before.score else None, 3)
            edited = ["", f"{swatch(STAGE_COLORS['edited'])}edited", score, "", "", ""]
            rows.append(Row(edited, c.Seek(iteration.index - 1)))
    if begin:
        rows.append(_not_listed(snapshot, f"{begin} earlier", own[begin - 1][0]))
    first, error = snapshot.begun.arms[j].entries[0], snapshot.initial_errors[j]
    start = [
        "0", f"{swatch(STAGE_COLORS['initial'])}initial", f"{first.score.score:.3f}", "", "",
        number(error.add_s_mm if error else None, 1),
    ]  # fmt: skip
    rows.append(Row(start, c.Seek(0)))
    head = [
        ("it.", "iteration; click to go there"), ("accepted", "stage that was accepted"),
        ("score", "of the accepted pose"),
        ("turn", "how far it turned"), ("mm", "how far it moved"), ("ADD(-S)", "error against ground truth [mm]"),
    ]  # fmt: skip
    name = f"<p><b>Hypothesis {j + 1}</b> ({text(snapshot.target.instance.hypotheses[j].source)})</p>"
    return name + other_scale_note(snapshot) + table(head, rows)


def _not_listed(snapshot: Snapshot, how_many: str, nearest: Iteration) -> Row:
    """A row in place of plays; a click goes to the nearest of them."""
    return Row(["…", how_many, "", "", "", ""], visit(snapshot, nearest))


# Several objects at once.


def scene_arms_table(snapshot: Snapshot) -> str:
    """A row per object: the hypothesis of its latest iteration, and what each one has got."""
    past = snapshot.iterations[: snapshot.cursor]
    chooses = method_of(snapshot.session.method.name).chooses
    latest = {i.instance_id: i for i in past}

    def spent(o: ObjectState) -> str:
        iteration, arms = latest.get(o.instance_id), range(len(o.target.instance.hypotheses))
        if iteration is not None and iteration.choice is not None:
            counts = iteration.choice.plays.tolist()
        elif chooses:
            counts = [1.0 for _ in arms]
        else:
            counts = [sum(i.instance_id == o.instance_id and i.arm == j for i in past) for j in arms]
        return cut(" · ".join(map(plays_text, counts)), 215)

    columns: list[Column] = [
        ("object", "click a row for its hypotheses", lambda o: f"{swatch(o.color)}{cut(o.label)}"),
        ("last", "hypothesis of its latest iteration",
         lambda o: f"{latest[o.instance_id].arm + 1}" if o.instance_id in latest else NONE),
        ("n by hypothesis" if chooses else "iterations by hypothesis", n_means(snapshot), spent),
        ("answer", "score of the answer so far", lambda o: number(o.answer.score.score if o.answer else None, 3)),
    ]  # fmt: skip
    return table_of(snapshot.scene.objects, columns, lambda o: c.Focus(o.instance_id))


def passes_table(snapshot: Snapshot, newest: int = 8) -> str:
    """The latest passes that were closed at the cursor."""
    closed = [p for p in snapshot.scene.closed if p.iteration <= snapshot.cursor]
    if not closed:
        return ""
    columns: list[Column] = [
        ("no.", "click to go to the iteration that closed it; cluster.pass",
         lambda p: f"{p.cluster}.{p.number}" if snapshot.scene.n_clusters > 1 else f"{p.number}"),
        ("pass", TERMS["pass score"], lambda p: f"{p.record.score.score:.3f}"),
        ("best known", "each object's own best pose so far, rendered together",
         lambda p: f"{p.record.best_known.score:.3f}"),
        ("incumbent", f"{TERMS['incumbent']}; ★ = of this pass",
         lambda p: f"{p.record.incumbent_score:.3f}{' ★' if p.best_pass == p.number else ''}"),
        ("reward", "what the hypotheses of this pass got", lambda p: f"{p.record.reward:.3f}"),
    ]  # fmt: skip
    return "<p><b>Passes</b></p>" + table_of(
        reversed(closed[-newest:]),
        columns,
        lambda p: visit(snapshot, snapshot.at(p.iteration)),
        lambda p: p.iteration == snapshot.cursor,
    )
