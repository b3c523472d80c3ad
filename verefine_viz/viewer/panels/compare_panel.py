"""The A/B panel: two runs of the same frame, where they part, and who comes nearer."""

from __future__ import annotations

from typing import Any

import viser

from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.comparison_tables import (
    legend,
    now_table,
    outcome_table,
    parting,
    scores_note,
    settings_list,
    where,
)
from verefine_viz.viewer.drawing.markup import link, sentence, text
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, add_style, by_user
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.branch import current_values
from verefine_viz.viewer.web.viser_internals import compact, unlabelled

MOVES: dict[str, c.Command] = {
    "◀": c.StepMoment(-1),
    "▶": c.StepMoment(1),
    "First difference": c.SeekDifference(),
    "Swap": c.SwapSides(),
}
POSES: dict[str, c.SidePose] = {"best so far": "best", "accepted now": "kept"}
OPEN_RECORDING = {"Open as B": c.CompareRecording, "Open as A": c.OpenRecording}
AS_A = "as A"
ROW_PX = 25
"""So that the answers of six objects fit into the panel."""
HINTS: dict[c.Side, str] = {"A": "solid", "B": "as an outline (T)"}
NOTHING = "Choose what B is: other settings, another branch, or a recording."


class ComparePanel:
    """B is chosen at the bottom; all else appears once there is one."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui, "tight")
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        hint = "along the iterations; First difference F, Swap X, B on/off T"
        self.moves = add_buttons(gui, "Both", MOVES, send, hint, visible=False)
        self.slider = gui.add_slider(
            "Moment", 0, 1, 1, 0, visible=False, hint="an object after the same number of its iterations in both runs"
        )
        self.slider.on_update(by_user(lambda v: send(c.SeekMoment(int(v)))))
        add_style(gui, compact(self.moves, ROW_PX), unlabelled(self.moves), compact(self.slider, ROW_PX))
        self._now = Block(gui, "errors tight")
        self._outcome = Block(gui, "names")
        self.poses = gui.add_dropdown("In 3D", tuple(POSES), visible=False, hint="which poses of A and B are drawn")
        self.poses.on_update(by_user(lambda v: send(c.ShowSidePoses(POSES[v]))))
        self.shown: dict[c.Side, viser.GuiCheckboxHandle] = {
            side: gui.add_checkbox(f"Show {side}", True, visible=False, hint=hint) for side, hint in HINTS.items()
        }
        for side, box in self.shown.items():
            box.on_update(by_user(lambda on, side=side: send(c.ShowSide(side, on))))
        self._settings = Block(gui)
        self.choice = ChoiceOfB(gui, send)

    def show(self, snapshot: Snapshot) -> None:
        """The comparison, or how to begin one."""
        v = snapshot.comparison
        self.choice.show(snapshot)
        for handle in (self.moves, self.slider, self.poses, *self.shown.values()):
            handle.visible = v is not None
        self._progress.visible = v is not None and v.running
        if v is None:
            self._words.show(sentence(NOTHING))
            for block in (self._now, self._outcome, self._settings):
                block.show("")
            return
        b = v.effort_b
        self._progress.value = 100.0 * b.iterations / max(b.planned, 1)
        self._words.show(sentence(parting(v)) + legend(v) + computing(v, snapshot.progress.running))
        self.slider.max = max(len(v.pairs), 1)
        self.slider.value = min(v.place, int(self.slider.max))
        self._now.show(f'<p class="dim">{text(where(v))}</p>{scores_note(v)}{now_table(v)}')
        self._outcome.show(outcome_table(v))
        self.poses.value = next(label for label, which in POSES.items() if which == v.which)
        for side, box in self.shown.items():
            box.value = side in v.shown
        self._settings.show(settings_list(v))


def computing(v: ComparisonSnapshot, a_is_running: bool) -> str:
    """How far B is, and what can be done about it."""
    b = v.effort_b
    if v.running and a_is_running:
        return f"<p>B begins when A is through, or paused. {link('Leave B for later', c.PauseB())}</p>"
    if v.running:
        return f"<p>B: {b.iterations} of {b.planned} iterations. {link('Pause', c.PauseB())}</p>"
    if b.iterations < b.planned:
        return f"<p>B has made {b.iterations} of {b.planned} iterations. {link('Compute the rest', c.RunB())}</p>"
    return ""


class ChoiceOfB:
    """What B is: settings that differ from A's, a branch, or a file. Edits are a draft until a button is pressed."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._known: dict[str, Any] = {}
        self._branches: tuple[str, ...] = ()
        with gui.add_folder("Compare with …", expand_by_default=True):
            self.fields: dict[str, Any] = {
                "method.name": gui.add_dropdown("Method of B", METHOD_NAMES, hint="the algorithm"),
                "preset": gui.add_dropdown(
                    "Preset of B",
                    (AS_A, "recommended", "published"),
                    hint="published: as the authors' code has it",
                ),
                "method.iterations": gui.add_number("Budget of B", 5, step=1, hint="K: refiner calls per hypothesis"),
                "method.exploration": gui.add_number("c of B", 0.1, step=0.01, hint="weight of UCB's bonus"),
            }
            self.more = gui.add_text(
                "More settings",
                "",
                hint="any other settings, as in a session file: score.tau_m = 0.01; physics.steps = 60",
            )
            self.run = gui.add_button("Run B with these", hint="from the start, on this frame; looking around goes on")
            self.branch = gui.add_dropdown("Branch", [""], visible=False, hint="a run of this frame as B")
            self.path = gui.add_text("Path (.rrd)", "", hint="a recording of this frame, as B")
            self.recording = gui.add_button_group("Recording", list(OPEN_RECORDING))
        self.run.on_click(by_user(lambda _: send(c.CompareRun(self.changes(), self.more.value))))
        self.branch.on_update(by_user(lambda label: self._choose(send, label)))
        self.recording.on_click(by_user(lambda label: send(OPEN_RECORDING[label](self.path.value))))

    def _choose(self, send: Send, label: str) -> None:
        if label in self._branches[1:]:
            send(c.CompareBranch(self._branches.index(label) - 1))

    def changes(self) -> c.Changes:
        """What is set otherwise than in A."""
        values = {name: field.value for name, field in self.fields.items()}
        return tuple((name, v) for name, v in values.items() if v != self._known.get(name))

    def show(self, snapshot: Snapshot) -> None:
        """Drafts are kept until the settings of A change."""
        names = tuple(n for n in self.fields if n != "preset")
        values = {**current_values(snapshot.session, names), "preset": AS_A}
        if values != self._known:
            self._known = values
            for name, field in self.fields.items():
                # A may be a trace, which is no method to run.
                if isinstance(field, viser.GuiDropdownHandle) and values[name] not in field.options:
                    field.options = (*field.options, values[name])
                field.value = values[name]
        labels = ("", *(f"{k + 1}: {b.name}" for k, b in enumerate(snapshot.branches)))
        if labels != self._branches:
            self._branches = labels
            self.branch.options = labels
        self.branch.visible = len(snapshot.branches) > 1
        self.branch.value = labels[snapshot.comparison.index_b + 1] if snapshot.comparison is not None else ""
