"""Tables of hypotheses, plays and passes: what the bandit counted when it chose."""

from __future__ import annotations

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import Row, arms_legend, cut, number, swatch, table, text
from verefine_viz.viewer.drawing.pose_tables import other_scale_note
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.display_names import TERMS, arm_color, have_names
from verefine_viz.viewer.text.pose_words import shift_mm, turn

N_MEANS = (
    "n_j, the plays that the bandit counted when it chose: the initial pose is one of them, and its score part of the "
    "mean μ_j. The Pulls curves count choices only, up to and with this iteration."
)
TIME_MEANS = (
    "computing time of all its plays so far, added up [ms]. The first play on an object also prepares it, once for all "
    "hypotheses and runs: the simulator gets its shape, the refiner its search structure. After a restart that is done."
)


def plays_text(plays: float) -> str:
    """A count of plays, which may be discounted."""
    return f"{plays:.0f}" if plays == round(plays) else f"{plays:.2f}"


def what_n_counts(snapshot: Snapshot) -> str:
    """A line below a table of plays, which are not the pulls of the curves; empty where nothing is chosen."""
    if not method_of(snapshot.session.method.name).chooses:
        return ""
    said = "n: 1 for the initial pose, and 1 for each pull before this choice"
    if any(edit.instance == snapshot.target.instance.instance_id for edit in snapshot.edits):
        said += "; a pose moved by hand starts again at 1"
    if method_of(snapshot.session.method.name).has_passes and snapshot.session.method.discount < 1:
        said += f"; earlier ones fade, ×{snapshot.session.method.discount:g} a pass"
    return f'<p class="legend dim" title="{text(N_MEANS)}">{text(said)}.</p>'


def mean_of(snapshot: Snapshot) -> str:
    """What μ is the mean of, for a tooltip."""
    if not _counts_scenes(snapshot):
        return "μ_j, mean over the plays: the score of the initial pose, and of each play the highest of its poses"
    method = snapshot.session.method
    at = "its poses" if method.scene_reward == "current_pass" else "the best pose of each object so far"
    said = f"μ_j, mean over the plays. Each pass counts for the hypotheses it chose: the score of {_whole(snapshot)} at {at}"
    if _took_over(snapshot):
        return f"{said}. Plays before vf_depth took over count the object's own score."
    if method.scene_prior == "object":
        return f"{said}. The first play counts the score of the object's initial pose alone."
    return f"{said}. The first play counts that score with this initial pose and the best initial poses of the others."


def what_the_mean_is_of(snapshot: Snapshot) -> str:
    """A line below a table of plays, where μ is of more than the object; empty elsewhere."""
    if not _counts_scenes(snapshot):
        return ""
    said = f"μ: mean score of {_whole(snapshot)}, not of this object alone as “best” is"
    if not _took_over(snapshot):
        alone = snapshot.session.method.scene_prior == "object"
        said += f"; first play: {'this initial pose alone' if alone else 'together with this initial pose'}"
    return f'<p class="legend dim" title="{text(mean_of(snapshot))}">{text(said)}.</p>'


def _counts_scenes(snapshot: Snapshot) -> bool:
    """Whether the scores of whole scenes reward the hypotheses of the object in focus."""
    if not method_of(snapshot.session.method.name).has_passes:
        return False
    cluster = snapshot.scene.object(snapshot.target.instance.instance_id).cluster
    return sum(o.cluster == cluster and bool(o.target.instance.hypotheses) for o in snapshot.scene.objects) > 1


def _whole(snapshot: Snapshot) -> str:
    """The scene whose score is counted."""
    if snapshot.scene.n_clusters < 2:
        return "all objects together"
    return f"cluster {snapshot.scene.object(snapshot.target.instance.instance_id).cluster} as a whole"


def _took_over(snapshot: Snapshot) -> bool:
    """Whether another method began the run."""
    return any(
        change.after_iteration and "name" in change.settings.get("method", {}) for change in snapshot.session.changes
    )


def what_the_time_holds(snapshot: Snapshot) -> str:
    """A line below a table of times, where the object's first play is among them."""
    if not any(i.index <= snapshot.cursor for i in snapshot.own_iterations):
        return ""
    j = snapshot.own_iterations[0].arm + 1
    said = f"Σ ms: all plays together; the first, on hypothesis {j}, also prepares the object, once."
    return f'<p class="legend dim" title="{text(TIME_MEANS)}">{text(said)}</p>'


# The table of what became of one hypothesis, play by play.


def arm_history(snapshot: Snapshot, most: int = 12) -> str:
    """What became of the hypothesis in focus: ``most`` of its plays around the cursor, the latest first."""
    if snapshot.state is None:
        return ""
    j = snapshot.arm
    hypothesis = snapshot.target.instance.hypotheses[j]
    own = [
        (i, e)
        for i, e, _ in snapshot.error_series
        if i.arm == j and not (snapshot.is_partial and i.index == snapshot.cursor)
    ]
    done = sum(i.index <= snapshot.cursor for i, _ in own)
    begin = max(0, min(done - most // 2, len(own) - most))
    end = min(begin + most, len(own))
    rows = [_left_out(snapshot, f"{len(own) - end} later", own[end][0])] if end < len(own) else []
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
        rows.append(Row(cells, visit(snapshot, iteration), marked=iteration.index == snapshot.cursor))
        if any(event.kind == "edited" for event in iteration.events):
            score = number(before.score.score if before.score else None, 3)
            put = ["", f"{swatch(STAGE_COLORS['edited'])}by hand", score, "", "", ""]
            rows.append(Row(put, c.Seek(iteration.index - 1)))
    if begin:
        rows.append(_left_out(snapshot, f"{begin} earlier", own[begin - 1][0]))
    first = snapshot.begun.arms[j].entries[0]
    error = snapshot.initial_errors[j]
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
    named = f"<p><b>Hypothesis {j + 1}</b> ({text(hypothesis.source)})</p>"
    return named + other_scale_note(snapshot) + table(head, rows)


def _left_out(snapshot: Snapshot, how_many: str, nearest: Iteration) -> Row:
    """A row in place of plays that are not listed; a click goes to the nearest of them."""
    return Row(["…", how_many, "", "", "", ""], visit(snapshot, nearest))


def arms_table(snapshot: Snapshot) -> str:
    """The bandit's numbers as they were when it chose; before the first choice, as they will be."""
    state = snapshot.state
    if state is None:
        return ""
    shown = snapshot.shown
    choice = shown.choice if shown and shown.choice else None
    if choice is None and shown is None and method_of(snapshot.session.method.name).has_ucb:
        choice = next_choice(Ucb(snapshot.exploration), state)
    taken = shown.arm if shown else (choice.arm if choice else None)
    rows = []
    for j, arm in enumerate(state.arms):
        own = [i for i in snapshot.own_iterations if i.arm == j and i.index <= snapshot.cursor]
        best = max(e.score.score for e in arm.entries)
        ms = sum(i.ms for i in own)
        plays, mean, bonus, ucb = (
            (choice.plays[j], choice.mean[j], choice.exploration[j], choice.ucb[j])
            if choice
            else (arm.plays, arm.mean, None, None)
        )
        error = snapshot.initial_errors[j]
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
        rows.append(Row(cells, c.SelectArm(j), marked=j == snapshot.arm))
    head = [
        ("arm", "hypothesis; ◂ = chosen; click a row for its history"),
        ("n", N_MEANS),
        ("μ", mean_of(snapshot)),
        ("bonus", "exploration term c·√(ln Σn / n_j)"),
        ("UCB", "mean + bonus; the largest is chosen"),
        ("best", "best score of any of its poses so far"),
        ("start", "rotation error of its initial pose against ground truth"),
        ("Σ ms", TIME_MEANS),
    ]
    names = f'<p class="legend">{arms_legend(snapshot.target)}</p>' if have_names(snapshot.target) else ""
    return (
        names
        + table(head, rows)
        + what_the_mean_is_of(snapshot)
        + what_n_counts(snapshot)
        + what_the_time_holds(snapshot)
    )


# Tables about several objects at once, as HTML. Names that come from data are escaped by :mod:`markup`.


def scene_arms_table(snapshot: Snapshot) -> str:
    """A row per object: the hypothesis of its latest iteration, and what each one has got."""
    rows = []
    past = snapshot.iterations[: snapshot.cursor]
    chooses = method_of(snapshot.session.method.name).chooses
    for o in snapshot.scene.objects:
        latest = next((i for i in reversed(past) if i.instance_id == o.instance_id), None)
        spent = [0] * len(o.target.instance.hypotheses)
        for i in past:
            if i.instance_id == o.instance_id and i.arm < len(spent):
                spent[i.arm] += 1
        choice = latest.choice if latest else None
        counted = choice.plays.tolist() if choice else [1.0] * len(spent) if chooses else spent
        plays = " · ".join(plays_text(n) for n in counted)
        cells = [
            f"{swatch(o.color)}{cut(o.label)}",
            f"{latest.arm + 1}" if latest else "–",
            cut(plays, 215),
            number(o.answer.score.score if o.answer else None, 3),
        ]
        rows.append(Row(cells, c.Focus(o.instance_id)))
    head = [
        ("object", "click a row for its hypotheses"),
        ("last", "hypothesis of its latest iteration"),
        ("n by hypothesis" if chooses else "iterations by hypothesis", N_MEANS if chooses else "spent on each of them"),
        ("best", "score of the answer so far"),
    ]
    return table(head, rows) + what_n_counts(snapshot)


def passes_table(snapshot: Snapshot, newest: int = 8) -> str:
    """The latest passes that were closed at the cursor."""
    closed = [p for p in snapshot.scene.closed if p.iteration <= snapshot.cursor]
    if not closed:
        return ""
    rows = []
    for p in reversed(closed[-newest:]):
        cells = [
            f"{p.cluster}.{p.number}" if snapshot.scene.n_clusters > 1 else f"{p.number}",
            f"{p.record.score.score:.3f}",
            f"{p.record.best_known.score:.3f}",
            f"{p.record.incumbent_score:.3f}{' ★' if p.best_pass == p.number else ''}",
            f"{p.record.reward:.3f}",
        ]
        rows.append(Row(cells, visit(snapshot, snapshot.at(p.iteration)), marked=p.iteration == snapshot.cursor))
    head = [
        ("no.", "click to go to the iteration that closed it; cluster.pass"),
        ("pass", TERMS["pass score"]),
        ("best known", "each object's own best pose so far, rendered together"),
        ("incumbent", f"{TERMS['incumbent']}; ★ = found in this pass"),
        ("reward", "what the hypotheses of this pass got"),
    ]
    return "<p><b>Passes</b></p>" + table(head, rows)
