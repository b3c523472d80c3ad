"""The Run panel: what happened, what to do next, and on what."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import hinted, link, note, sentence, swatch, text, warning
from verefine_viz.viewer.drawing.pose_tables import branches_table, event_lines
from verefine_viz.viewer.panels.widgets import Block, Send, by_person
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.text.findings import Finding, findings
from verefine_viz.viewer.text.headline import HINTS, headline
from verefine_viz.viewer.text.sentences import remaining
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
    "does not judge. The last iteration may have tried another."
)
CANCEL = f'<p class="dim {CANCEL_CLASS}">{link("Cancel", c.Cancel(), "everything stays as it was before")} (Escape)</p>'


ROW_PX = 26


class RunPanel:
    """The choice of frame and the buttons first, where they never move; then headline, findings, branches and notes."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        gui.add_html(f"<style>{asset('page.css')}</style>")
        # Above the words, so that they can push it off the screen no more than the buttons.
        self.frame = gui.add_dropdown("Frame", [""], visible=False)
        self.frame.on_update(by_person(lambda v: send(c.OpenFrame(v))))
        self.demo = gui.add_dropdown("Scene", [""], visible=False)
        self.demo.on_update(by_person(lambda v: send(c.OpenDemo(v))))
        gui.add_html(f"<style>{compact(self.frame, ROW_PX)}{compact(self.demo, ROW_PX)}</style>")
        # No hints: they would cover what is below while the pointer rests on a button that was pressed.
        self.moves = gui.add_button_group("Move", list(MOVES))
        self.moves.on_click(by_person(lambda label: send(MOVES[label])))
        self.runs = gui.add_button_group("Run", list(RUNS))
        self.runs.on_click(by_person(lambda label: send(RUNS[label])))
        self._words = Block(gui)
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._below = Block(gui)
        self._branches = Block(gui)
        Block(gui).show(KEYS_LINE)

    def tell(self, doing: str, share: float | None, can_cancel: bool) -> None:
        """What is being done, how much of it [0 to 1], and how to end it, until the next picture."""
        self._words.show(sentence(doing) + (CANCEL if can_cancel else ""))
        self._progress.visible = share is not None
        self._progress.value = 100.0 * (share or 0.0)

    def show(self, snapshot: Snapshot) -> None:
        """Everything in place."""
        found = findings(snapshot)
        said = hinted(headline(snapshot), HINTS) + event_lines(snapshot) + of_the_end(snapshot)
        self._words.show(on_top(snapshot, found) + said)
        p = snapshot.progress
        self._progress.visible = p.running
        self._progress.value = 100.0 * p.done / max(p.total, 1)
        below = "".join(_box(f) for f in found if not f.on_top)
        if p.running:
            below = f'<p class="dim">{p.done} of {p.total} iterations, {text(remaining(p.remaining_s))}</p>' + below
        self._below.show(below)
        _options(self.frame, snapshot.frames, snapshot.frame)
        self.frame.visible = len(snapshot.frames) > 1
        _options(self.demo, snapshot.demos, snapshot.session.scene.demo)
        self.demo.visible = snapshot.session.scene.source == "demo" and bool(snapshot.demos)
        notes = "".join(f'<p class="dim">Note: {text(note)}</p>' for note in snapshot.notes)
        self._branches.show(branches_table(snapshot) + notes)


def on_top(snapshot: Snapshot, found: Sequence[Finding]) -> str:
    """What stands above the words about the iteration. Of several boxes one is whole, to leave room for those words."""
    said, boxes = "", [f for f in found if f.on_top]
    if snapshot.message:
        extra = link(*snapshot.offer) if snapshot.offer else ""
        said = warning(snapshot.message, extra) if snapshot.refused else note(snapshot.message)
    whole = None if said or not boxes else boxes[-1]
    return f'{said}<div class="top">{"".join(_box(f, folded=f is not whole) for f in boxes)}</div>'


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
