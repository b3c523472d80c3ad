"""The table of what became of one hypothesis, play by play."""

from __future__ import annotations

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.answer import visit
from verefine_viz.viewer.markup import Row, swatch, table, text
from verefine_viz.viewer.pose_words import shift_mm, turn
from verefine_viz.viewer.scales import other_scale_note
from verefine_viz.viewer.tables import number
from verefine_viz.viewer.view import View


def arm_history(view: View, most: int = 12) -> str:
    """What became of the hypothesis in focus: ``most`` of its plays around the cursor, the latest first."""
    if view.state is None:
        return ""
    j = view.arm
    hypothesis = view.target.instance.hypotheses[j]
    own = [(i, e) for i, e, _ in view.error_series if i.arm == j and not (view.is_partial and i.index == view.cursor)]
    done = sum(i.index <= view.cursor for i, _ in own)
    begin = max(0, min(done - most // 2, len(own) - most))
    end = min(begin + most, len(own))
    rows = [_left_out(view, f"{len(own) - end} later", own[end][0])] if end < len(own) else []
    for iteration, errors in reversed(own[begin:end]):
        before, after = iteration.stages[0], iteration.accepted_stage
        cells = [
            f"{iteration.index}",
            f"{swatch(STAGE_COLORS[iteration.accepted])}{iteration.accepted}",
            number(after.score.score if after.score else None, 3),
            f"{turn(before.T_cam_obj, after.T_cam_obj)[0]:.1f}°",
            f"{shift_mm(before.T_cam_obj, after.T_cam_obj, view.target.model.points):.1f}",
            number(errors.add_s_mm if errors else None, 1),
        ]
        rows.append(Row(cells, visit(view, iteration), marked=iteration.index == view.cursor))
        if any(event.kind == "edited" for event in iteration.events):
            score = number(before.score.score if before.score else None, 3)
            put = ["", f"{swatch(STAGE_COLORS['edited'])}by hand", score, "", "", ""]
            rows.append(Row(put, c.Seek(iteration.index - 1)))
    if begin:
        rows.append(_left_out(view, f"{begin} earlier", own[begin - 1][0]))
    first = view.begun.arms[j].entries[0]
    error = view.initial_errors[j]
    start = [
        "0", f"{swatch(STAGE_COLORS['initial'])}initial", f"{first.score.score:.3f}", "", "",
        number(error.add_s_mm if error else None, 1),
    ]  # fmt: skip
    rows.append(Row(start, c.Seek(0)))
    head = [
        ("it.", "iteration; click to go there"), ("kept", "stage that was kept"), ("score", "of the kept pose"),
        ("turn", "how far it turned"), ("mm", "how far it moved"), ("ADD(-S)", "error against ground truth [mm]"),
    ]  # fmt: skip
    named = f"<p><b>Hypothesis {j + 1}</b> ({text(hypothesis.source)})</p>"
    return named + other_scale_note(view) + table(head, rows)


def _left_out(view: View, how_many: str, nearest: Iteration) -> Row:
    """A row in place of plays that are not listed; a click goes to the nearest of them."""
    return Row(["…", how_many, "", "", "", ""], visit(view, nearest))
