"""The Grasp panel: how a simulated grasp by the pose ends, and by the ground truth, moment by moment."""

from __future__ import annotations

from typing import get_args

import viser

from verefine_viz.core.palette import GRASP_COLORS
from verefine_viz.viewer.drawing.grasp_picture import grasp_picture, moment_table
from verefine_viz.viewer.drawing.markup import carries, link, sentence, swatch, text
from verefine_viz.viewer.grasp_commands import GraspedBy, PlayGrasp, ShowGrasp, TryGrasp
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.empty_tabs import no_grasp

HINT = "Carries out, in simulation, the best free grasp of the pose, and that of the ground truth"


class GraspPanel:
    """Carried out when it is asked for; a chip per pose says how its grasp ends, and shows it."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._ends = Block(gui)
        self.moment = gui.add_slider("Moment", 0, 1, 1, 0, visible=False)
        self.moment.on_update(by_user(lambda v: send(ShowGrasp(int(v)))))
        self.play = add_buttons(gui, "Grasp", {"Play": PlayGrasp(), "Hide": ShowGrasp()}, send, visible=False)
        self._moment = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """What is known by now of the pose in focus."""
        self._ends.show(ends_html(snapshot))
        shown = snapshot.shown_grasp
        pair = snapshot.grasp
        self.play.visible = pair is not None and any((pair.answer.path, pair.ground_truth.path))
        self.moment.visible = shown is not None and shown.n_moments > 1
        if shown is not None and self.moment.visible:
            self.moment.max = shown.n_moments - 1
            self.moment.value = shown.moment
        self._moment.show("" if shown is None else grasp_picture(shown) + moment_table(shown, snapshot))


def ends_html(snapshot: Snapshot) -> str:
    """Both outcomes side by side with how many grasps were free, or how to get them."""
    missing = no_grasp(snapshot)
    if missing:
        return sentence(missing)
    pair = snapshot.grasp
    if pair is None:
        answer = "the answer" if snapshot.is_answer else "the answer so far"
        which = "the edited pose" if "edited" in snapshot.poses else answer
        return f"<p>{link(f'Grasp {snapshot.name} by {which}', TryGrasp(), HINT)}</p>"
    own = "this pose" if "edited" in snapshot.poses else "answer"
    chips = []
    for by, name, attempt in zip(
        get_args(GraspedBy), (own, "ground truth"), (pair.answer, pair.ground_truth), strict=True
    ):
        good = attempt.verdict == "success"
        on = snapshot.options.grasp_moment is not None and snapshot.options.grasp_by == by
        chips.append(
            f'<button class="end {"good" if good else "ill"}{" on" if on else ""}" {carries(ShowGrasp(by=by))}>'
            f"<span>{text(name)}</span><b>{'✓' if good else '✗'} {text(attempt.verdict)}</b></button>"
        )
    return f'<div class="ends">{"".join(chips)}</div>{_counts(snapshot)}'


def _counts(snapshot: Snapshot) -> str:
    pair = snapshot.grasp
    assert pair is not None
    attempt = pair.answer if snapshot.options.grasp_by == "pose" else pair.ground_truth
    n_free, n = int(attempt.is_free.sum()), len(attempt.is_free)
    parts = [f"{swatch(GRASP_COLORS['free'])}{n_free} free", f"{swatch(GRASP_COLORS['blocked'])}{n - n_free} blocked"]
    if attempt.chosen is not None:
        parts.append(f"{swatch(GRASP_COLORS['chosen'])}chosen")
    return f'<p class="dim">{attempt.grasps.source}: {" &nbsp; ".join(parts)}</p>'
