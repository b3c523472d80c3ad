"""The Run panel: what to do next, on what, and what happened in a few words; the verdict has the rest."""

from __future__ import annotations

import json

import viser

from verefine_viz.core.records import Iteration
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.frame_strip import frame_strip
from verefine_viz.viewer.drawing.markup import link, sentence, swatch, text, warning, with_hints
from verefine_viz.viewer.drawing.pose_tables import branches_table
from verefine_viz.viewer.drawing.recorded_scores import recorded_line
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.display_names import TERMS, in_focus
from verefine_viz.viewer.text.headline import brief, headline
from verefine_viz.viewer.web.viser_internals import CANCEL_CLASS, compact, side_by_side, unlabelled

MOVES: dict[str, c.Command] = {
    "◀ Back": c.Back(),
    "Stage": c.StepStage(),
    "Step ▶": c.Step(),
}
RUNS: dict[str, c.Command] = {
    "Run": c.RunUntil("end"),
    "Pause": c.Pause(),
    "To event": c.RunUntil("event"),
    "Restart": c.Restart(),
}

BUTTON_HINTS = {
    "◀ Back": "one iteration back (B)",
    "Stage": "one stage of an iteration (M)",
    "Step ▶": "one iteration (N)",
    "Run": "to the end (Space)",
    "Pause": "after the iteration at hand (Space)",
    "To event": "to the next mark on the timeline",
    "Restart": "from the beginning, with what Settings shows",
}
"""Shown by page.js where the pointer rests, as the browser shows a title: viser's hints would cover what is below."""
ANSWER = (
    "What the run hands on for each object: of all poses on the way the best one, or the last one where the method "
    "does not score. The last iteration may have tried another."
)
CANCEL = f'<p class="dim {CANCEL_CLASS}">{link("Cancel", c.Cancel(), "everything stays as it was before")} (Escape)</p>'
USE_HULLS = "Start with hulls now"
HULLS = (
    f'<p class="dim">{link(USE_HULLS, c.UseHulls(), "physics takes every model for its convex hull: no waiting")}</p>'
)

ROW_PX, SECOND_FROM_PX, LABEL_PX = 26, 158, 46
"""Height of a row, where its second list begins, and width of the word before each [px]."""


class RunPanel:
    """The choice of frame and the buttons first, where they never move; then what happened, branches and notes."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        add_style(gui, asset("page.css"))
        # Above the words, so that they can push it off the screen no more than the buttons.
        self.frame = gui.add_dropdown("Frame", [""], visible=False)
        self.frame.on_update(by_user(lambda v: send(c.OpenFrame(v))))
        self.demo = gui.add_dropdown("Scene", [""], visible=False)
        self.demo.on_update(by_user(lambda v: send(c.OpenDemo(v))))
        add_style(gui, compact(self.frame, ROW_PX), compact(self.demo, ROW_PX))
        add_style(gui, side_by_side(self.frame, self.demo, ROW_PX, SECOND_FROM_PX, LABEL_PX))
        # No hints: they would cover what is below while the pointer rests on a button that was pressed.
        self.moves = add_buttons(gui, "Move", MOVES, send)
        self.runs = add_buttons(gui, "Run", RUNS, send)
        add_style(gui, unlabelled(self.moves), unlabelled(self.runs))
        self._words = Block(gui)
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._branches = Block(gui)
        Block(gui, "tight").show(f'<i hidden data-hints="{text(json.dumps(BUTTON_HINTS))}"></i>')

    def tell(self, doing: str, share: float | None, can_cancel: bool, offers_hulls: bool) -> None:
        """What is being done, how much of it [0 to 1], and how to end or shorten it, until the next picture."""
        self._words.show(sentence(doing) + (HULLS if offers_hulls else "") + (CANCEL if can_cancel else ""))
        self._progress.visible = share is not None
        self._progress.value = 100.0 * (share or 0.0)

    def show(self, snapshot: Snapshot) -> None:
        """Everything in place."""
        words = f'<p title="{text(headline(snapshot))}">{text(brief(snapshot))}</p>'
        self._words.show(
            message_html(snapshot) + words + recorded_line(snapshot) + event_lines(snapshot) + of_the_end(snapshot)
        )
        self._progress.visible = False
        self.show_frames(snapshot)
        _options(self.demo, snapshot.demos, snapshot.session.scene.demo)
        self.demo.visible = snapshot.session.scene.source == "demo" and bool(snapshot.demos)
        notes = "".join(f'<p class="dim fold folded" title="{text(n)}">Note: {text(n)}</p>' for n in snapshot.notes)
        self._branches.show(frame_strip(snapshot.track, snapshot.frame) + branches_table(snapshot) + notes)

    def show_frames(self, snapshot: Snapshot) -> None:
        """Those that can be chosen."""
        _options(self.frame, snapshot.frames, snapshot.frame)
        self.frame.visible = len(snapshot.frames) > 1


def event_lines(snapshot: Snapshot) -> str:
    """The marks of the iteration that is shown; none where the answer is."""
    if snapshot.is_answer or snapshot.shown is None:
        return ""
    own = [m for m in snapshot.marks if m.iteration == snapshot.shown.index]
    return "".join(f"<p>{swatch(m.color)}{with_hints(m.text, TERMS)}</p>" for m in own)


def message_html(snapshot: Snapshot) -> str:
    """What the last command came to, where that has to be said."""
    if snapshot.message and snapshot.refused:
        return warning(snapshot.message, link(*snapshot.offer) if snapshot.offer else "")
    return f'<p class="note">{text(snapshot.message)}</p>' if snapshot.message else ""


def of_the_end(snapshot: Snapshot) -> str:
    """What is shown at the end of a finished run, and the way to what it is not."""
    last = snapshot.iterations[-1] if snapshot.iterations else None
    if last is None or not snapshot.at_end:
        return ""
    if not snapshot.is_answer:
        return f'<p class="dim">Last iteration · {link("answer", c.SeekEnd())}</p>'
    answer, shown = in_focus(snapshot).answer, f'<span class="term" title="{text(ANSWER)}">Answer</span>'
    if not snapshot.is_whole_scene and answer is not None:
        last = snapshot.shown or last
        shown += f": {_to(snapshot, snapshot.at(answer.iteration)) if answer.iteration else 'an initial pose'}"
    which = "" if snapshot.is_whole_scene else f"of {snapshot.name}"
    return f'<p class="dim">{shown}. <span title="{text(which)}">Last</span>: {_to(snapshot, last)}.</p>'


def _to(snapshot: Snapshot, iteration: Iteration) -> str:
    return link(f"iteration {iteration.index}", visit(snapshot, iteration))


def _options(dropdown: viser.GuiDropdownHandle[str], options: tuple[str, ...], value: str) -> None:
    if tuple(dropdown.options) != options and options:
        dropdown.options = options
    if value in options:
        dropdown.value = value
