"""The Run panel: what happened, what to do next, and on what."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import link, sentence, swatch, text, warning, with_hints
from verefine_viz.viewer.drawing.pose_tables import branches_table
from verefine_viz.viewer.panels.widgets import Block, Send, add_buttons, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.display_names import TERMS
from verefine_viz.viewer.text.findings import Finding, findings
from verefine_viz.viewer.text.headline import HINTS, headline
from verefine_viz.viewer.web.viser_internals import CANCEL_CLASS, compact

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

KEYS_LINE = (
    '<p class="legend dim">Keys: Step N, Stage M, Back B, Run and Pause Space. To event: to the next mark on the '
    "timeline. Restart: from the beginning, with what Settings shows. All of them: Ctrl+K.</p>"
)
ANSWER = (
    "What the run hands on for each object: of all poses on the way the best one, or the last one where the method "
    "does not score. The last iteration may have tried another."
)
CANCEL = f'<p class="dim {CANCEL_CLASS}">{link("Cancel", c.Cancel(), "everything stays as it was before")} (Escape)</p>'
USE_HULLS = "Start with hulls now"
HULLS = (
    f'<p class="dim">{link(USE_HULLS, c.UseHulls(), "physics takes every model for its convex hull: no waiting")}</p>'
)

ROW_PX = 26


class RunPanel:
    """The choice of frame and the buttons first, where they never move; then headline, findings, branches and notes."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        add_style(gui, asset("page.css"))
        # Above the words, so that they can push it off the screen no more than the buttons.
        self.frame = gui.add_dropdown("Frame", [""], visible=False)
        self.frame.on_update(by_user(lambda v: send(c.OpenFrame(v))))
        self.demo = gui.add_dropdown("Scene", [""], visible=False)
        self.demo.on_update(by_user(lambda v: send(c.OpenDemo(v))))
        add_style(gui, compact(self.frame, ROW_PX), compact(self.demo, ROW_PX))
        # No hints: they would cover what is below while the pointer rests on a button that was pressed.
        self.moves = add_buttons(gui, "Move", MOVES, send)
        self.runs = add_buttons(gui, "Run", RUNS, send)
        self._words = Block(gui)
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._below = Block(gui)
        self._branches = Block(gui)
        Block(gui).show(KEYS_LINE)

    def tell(self, doing: str, share: float | None, can_cancel: bool, offers_hulls: bool) -> None:
        """What is being done, how much of it [0 to 1], and how to end or shorten it, until the next picture."""
        self._words.show(sentence(doing) + (HULLS if offers_hulls else "") + (CANCEL if can_cancel else ""))
        self._progress.visible = share is not None
        self._progress.value = 100.0 * (share or 0.0)

    def show(self, snapshot: Snapshot) -> None:
        """Everything in place."""
        boxes, p = findings(snapshot), snapshot.progress
        headline_html = sentence(headline(snapshot), HINTS)
        self._words.show(on_top(snapshot, boxes) + headline_html + event_lines(snapshot) + of_the_end(snapshot))
        self._progress.visible = p.running
        self._progress.value = 100.0 * p.done / max(p.total, 1)
        below = f'<p class="dim">{p.done} of {p.total} iterations, {_remaining(p.remaining_s)}</p>' if p.running else ""
        self._below.show(below + "".join(_box(f) for f in boxes if not f.on_top))
        _options(self.frame, snapshot.frames, snapshot.frame)
        self.frame.visible = len(snapshot.frames) > 1
        _options(self.demo, snapshot.demos, snapshot.session.scene.demo)
        self.demo.visible = snapshot.session.scene.source == "demo" and bool(snapshot.demos)
        notes = "".join(f'<p class="dim">Note: {text(note)}</p>' for note in snapshot.notes)
        self._branches.show(branches_table(snapshot) + notes)


def event_lines(snapshot: Snapshot) -> str:
    """The marks of the iteration that is shown; none where the answer is."""
    if snapshot.is_answer or snapshot.shown is None:
        return ""
    own = [m for m in snapshot.marks if m.iteration == snapshot.shown.index]
    return "".join(f"<p>{swatch(m.color)}{with_hints(m.text, TERMS)}</p>" for m in own)


def _remaining(seconds: float | None) -> str:
    """As in: about 12 s left."""
    if seconds is None:
        return ""
    return f"about {seconds:.0f} s left" if seconds < 90 else f"about {seconds / 60:.0f} min left"


def on_top(snapshot: Snapshot, findings: Sequence[Finding]) -> str:
    """What stands above the words about the iteration. Of several boxes one is whole, to leave room for those words."""
    message, boxes = "", [f for f in findings if f.on_top]
    if snapshot.message and snapshot.refused:
        message = warning(snapshot.message, link(*snapshot.offer) if snapshot.offer else "")
    elif snapshot.message:
        message = f'<p class="note">{text(snapshot.message)}</p>'
    whole = None if message or not boxes else boxes[-1]
    return f'{message}<div class="top">{"".join(_box(f, folded=f is not whole) for f in boxes)}</div>'


def of_the_end(snapshot: Snapshot) -> str:
    """What is shown at the end of a finished run, and the way to what it is not."""
    last = snapshot.iterations[-1] if snapshot.iterations else None
    if last is None or not snapshot.at_end:
        return ""
    if not snapshot.is_answer:
        return f'<p class="dim">Shown: the last iteration. {link("show the answer", c.SeekEnd())}</p>'
    drawn = (
        f"{swatch(STAGE_COLORS['best'])}solid in 3D"
        if len(snapshot.scene.objects) == 1
        else "every object where it ends up"
    )
    answer = snapshot.scene.objects[0].answer
    shown = f'<span class="term" title="{text(ANSWER)}">the answer</span>'
    if len(snapshot.scene.objects) == 1 and answer is not None and answer.iteration:
        made = snapshot.at(answer.iteration)
        shown += f" of {link(f'iteration {made.index}', visit(snapshot, made))}"
    return f'<p class="dim">Shown: {shown}, {drawn}. {link("show the last iteration", visit(snapshot, last))}</p>'


def _box(finding: Finding, folded: bool = False) -> str:
    extra = link(finding.label, finding.command) if finding.command else ""
    if finding.calm:
        return f'<p class="dim">{text(finding.text)} {extra}</p>'
    return warning(finding.text, extra, finding.red, folded)


def _options(dropdown: viser.GuiDropdownHandle[str], options: tuple[str, ...], value: str) -> None:
    if tuple(dropdown.options) != options and options:
        dropdown.options = options
    if value in options:
        dropdown.value = value
