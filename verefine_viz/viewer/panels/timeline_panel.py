"""The timeline: every iteration, its marks, and a slider to any of them."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from verefine_viz.core.palette import RGB
from verefine_viz.core.records import Iteration
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import arms_legend, carries, link, text
from verefine_viz.viewer.panels.widgets import Block, Send, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot, visit
from verefine_viz.viewer.state.timeline_marks import MEANINGS, Mark
from verefine_viz.viewer.text.display_names import arm_color, counted, in_focus, shortened
from verefine_viz.viewer.text.headline import place_in_run
from verefine_viz.viewer.web.viser_internals import compact, without_ends

# The sentence above the timeline: where the cursor is, what was worked on there, and where trouble is marked.


def timeline_words(snapshot: Snapshot, marks: Sequence[Mark]) -> str:
    """As in: Iteration 17 of 25 · 3 problems · next: 21.

    Args:
        snapshot: what is on the screen.
        marks: those that the timeline shows.
    """
    p = snapshot.progress
    parts = [f'<span title="{text(_what(snapshot))}">Iteration {snapshot.cursor} of {p.total}</span>']
    if p.done != snapshot.cursor:
        parts.append(link(f"{p.done} made", c.SeekEnd()))
    place = place_in_run(snapshot.scene, snapshot.shown) if snapshot.shown and snapshot.is_current else ""
    if place and not snapshot.is_answer:
        parts.append(text(place))
    return " · ".join([*parts, *_problems(snapshot, marks)])


def _what(snapshot: Snapshot) -> str:
    """What the iteration worked on, for a tooltip."""
    if snapshot.is_answer:
        return _the_answer(snapshot)
    if snapshot.cursor == 0:
        return "the start" if snapshot.progress.done else "nothing has run yet"
    if snapshot.is_current and snapshot.shown is not None:
        who, stage = (
            f"{snapshot.name}, hypothesis {snapshot.shown.arm + 1} of {snapshot.n_arms}",
            snapshot.options.stage,
        )
        return ", ".join(filter(None, (who, f"up to the {stage} pose" if stage else "")))
    if snapshot.cursor > len(snapshot.iterations):
        return "shown stage by stage"
    worked_on = snapshot.at(snapshot.cursor)
    return f"it worked on {snapshot.scene.object(worked_on.instance_id).label}, hypothesis {worked_on.arm + 1}"


def _the_answer(snapshot: Snapshot) -> str:
    """As in: the answer, of iteration 16. The objects of a frame are each of another."""
    o = in_focus(snapshot)
    if snapshot.is_whole_scene:
        return "the answer"
    if o.answer is None:
        return "no answer"
    origin = f"of iteration {o.answer.iteration}" if o.answer.iteration else "an initial pose"
    return f"the answer; {o.label}: {origin}" if len(snapshot.scene.objects) > 1 else f"the answer, {origin}"


def _problems(snapshot: Snapshot, marks: Sequence[Mark]) -> list[str]:
    """How many iterations are marked red, and the way to the nearest ones."""
    red = sorted({mark.iteration for mark in marks if mark.is_red})
    if not red:
        return []
    after, before = [k for k in red if k > snapshot.cursor], [k for k in red if k < snapshot.cursor]
    here = ", one here" if snapshot.cursor in red and len(red) > 1 else ""
    parts = [f'<span title="iterations with a red mark">{counted(len(red), "problem")}{here}</span>']
    for which, nearest in (("previous", before[-1:]), ("next", after[:1])):
        parts += [f"{which}: {link(str(k), visit(snapshot, snapshot.at(k)), 'go there')}" for k in nearest]
    return parts


_WIDTH, _HEIGHT = 860, 43
_NAME_PX, _PASS_PX = 36, 30
_ASIDE_PX = 6
ROW_PX = 25
MOST_CELLS = 240
"""A longer run is drawn in fewer pieces."""


class TimelinePanel:
    """A strip of iterations coloured by hypothesis, marks above, the slider below."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._line = Block(gui, "line tight")
        self.slider = gui.add_slider("Iteration", 0, 1, 1, 0, hint="0 = before the first; Home, End, PageUp, PageDown")
        self.slider.on_update(by_user(lambda v: send(c.Seek(int(v)))))
        add_style(gui, compact(self.slider, ROW_PX), without_ends(self.slider))

    def show(self, snapshot: Snapshot, slider_is_ahead: bool = False) -> None:
        """Draws the strip; leaves the slider alone while the user moves it further."""
        self._line.show(strip(snapshot))
        self.slider.max = max(snapshot.progress.total, 1)
        if not slider_is_ahead:
            self.slider.value = min(snapshot.cursor, int(self.slider.max))


def strip(snapshot: Snapshot) -> str:
    """The iterations as an SVG: a cell each, coloured by hypothesis; red, blue, orange and green marks above.

    With several objects a band below the cells has each object's colour, and the whole cell where the scene is shown.
    Cells and marks of other objects are faint while the page is filtered to one.
    """
    total = max(snapshot.progress.total, 1)
    cell = _WIDTH / total
    cells = _cells(snapshot, cell) if total <= MOST_CELLS else _runs(snapshot, cell)
    parts = _objects(snapshot, cell) + _passes(snapshot, cell)
    marks = [m for m in snapshot.marks if is_shown(snapshot, snapshot.at(m.iteration))]
    aside = _aside(marks)
    for mark in sorted(marks, key=lambda m: (m.kind == "new_best_scene", m.is_red)):
        dx = aside[mark.iteration, mark.color]
        shape = _star(dx) if mark.kind == "new_best_scene" else _triangle(dx, small=mark.kind == "new_best")
        title = text(f"iteration {mark.iteration}: {mark.text}")
        to = carries(visit(snapshot, snapshot.at(mark.iteration)))
        drawn = f'<g {to}><polygon points="{shape}" fill="rgb{mark.color}"/><title>{title}</title></g>'
        parts.append(_at((mark.iteration - 0.5) * cell, drawn))
    x = snapshot.cursor * cell - cell / 2 if snapshot.cursor else 0
    parts.append(_at(x, '<rect x="-1" y="10" width="2.5" height="20" fill="currentColor"/>'))
    rest = f'<rect x="0" y="19" width="{_WIDTH}" height="2" fill="currentColor" opacity="0.15"/>'
    box = f'viewBox="0 0 {_WIDTH} {_HEIGHT}" height="{_HEIGHT}" preserveAspectRatio="none"'
    stretched = f"<svg {box}>{rest}{''.join(cells)}</svg>"
    head = f'<div class="head">{timeline_words(snapshot, marks)}</div>'
    colors = f'<div class="colors">{_blocks_legend(snapshot)}{legend(marks)}</div>'
    return f'{head}<svg height="{_HEIGHT}">{stretched}{"".join(parts)}</svg>{colors}'


def _at(x: float, drawn: str) -> str:
    """What is drawn around 0, at a place of the strip; unlike the cells it is not stretched with the window."""
    return f'<svg x="{100 * x / _WIDTH:.3f}%" overflow="visible">{drawn}</svg>'


def _blocks_legend(snapshot: Snapshot) -> str:
    """What the colours of the blocks below the marks mean."""
    if snapshot.is_whole_scene:
        return '<div class="blocks" title="Blocks in the colours of the list of objects."></div>'
    tip = "Colours of the blocks: hypotheses"
    if len(snapshot.scene.objects) > 1:
        tip += f" of {in_focus(snapshot).label}. The line below the blocks has the colours of the objects."
    return f'<div class="blocks" title="{text(tip)}">{arms_legend(snapshot.target, brief=True)}</div>'


def legend(marks: Sequence[Mark]) -> str:
    """What the colours of these marks mean, in one short line."""
    kinds = {mark.kind for mark in marks}
    meanings = [
        f'<span title="{text(m.hint)}"><span style="color:rgb{m.color}">{m.sign}</span> {text(m.words)}</span>'
        for m in MEANINGS
        if m.kinds & kinds
    ]
    return f'<span class="legend">{" ".join(meanings)}</span>' if meanings else ""


def is_shown(snapshot: Snapshot, iteration: Iteration) -> bool:
    """Whether an iteration is about what the page is filtered to."""
    return snapshot.options.focus is None or snapshot.is_whole_scene or iteration.instance_id == snapshot.options.focus


def _color(snapshot: Snapshot, iteration: Iteration) -> RGB:
    if snapshot.is_whole_scene:
        return snapshot.scene.object(iteration.instance_id).color
    return arm_color(iteration.arm)


def _cells(snapshot: Snapshot, cell: float) -> list[str]:
    """A box per iteration."""
    parts = []
    several = len(snapshot.scene.objects) > 1
    for iteration in snapshot.iterations:
        x, width = (iteration.index - 1) * cell, max(cell - 1, 0.8)
        title = f"iteration {iteration.index}: "
        title += f"{snapshot.scene.object(iteration.instance_id).label}, " if several else ""
        title += f"hypothesis {iteration.arm + 1}, {iteration.accepted} accepted"
        score = iteration.accepted_stage.score
        if score is not None:
            title += f", score {score.score:.3f}"
        faint = "" if is_shown(snapshot, iteration) else ' opacity="0.18"'
        color = _color(snapshot, iteration)
        box = f'<rect x="{x:.1f}" y="14" width="{width:.1f}" height="12" rx="1.5" fill="rgb{color}"/>'
        if several:
            band = snapshot.scene.object(iteration.instance_id).color
            box += f'<rect x="{x:.1f}" y="26.5" width="{width:.1f}" height="3" fill="rgb{band}"/>'
        parts.append(f"<g {carries(visit(snapshot, iteration))}{faint}>{box}<title>{text(title)}</title></g>")
    return parts


def _runs(snapshot: Snapshot, cell: float) -> list[str]:
    """Many iterations: one path per colour, and one surface to click, so that long runs stay light."""
    paths: dict[tuple[RGB, float, bool], list[str]] = {}
    several = len(snapshot.scene.objects) > 1
    for iteration in snapshot.iterations:
        x, faint = (iteration.index - 1) * cell, not is_shown(snapshot, iteration)
        paths.setdefault((_color(snapshot, iteration), 20.0, faint), []).append(f"M{x:.1f} 20h{cell:.2f}")
        if several:
            band = snapshot.scene.object(iteration.instance_id).color
            paths.setdefault((band, 28.0, faint), []).append(f"M{x:.1f} 28h{cell:.2f}")
    parts = [
        f'<path d="{"".join(lines)}" stroke="rgb{color}" stroke-width="{12 if y == 20.0 else 3}" fill="none"'
        f"{' opacity=' + chr(34) + '0.18' + chr(34) if faint else ''}/>"
        for (color, y, faint), lines in paths.items()
    ]
    width = len(snapshot.iterations) * cell
    parts.append(
        f'<rect x="0" y="12" width="{width:.1f}" height="18" fill="transparent" {carries(c.Seek(0))} '
        f'data-cells="{len(snapshot.iterations)}"><title>click to go to an iteration</title></rect>'
    )
    return parts


def _objects(snapshot: Snapshot, cell: float) -> list[str]:
    """Where the run goes on to another object: a line, and where it fits the object's name below."""
    if len(snapshot.scene.objects) < 2 or not snapshot.iterations:
        return []
    starts = [
        k
        for k, i in enumerate(snapshot.iterations)
        if k == 0 or snapshot.iterations[k - 1].instance_id != i.instance_id
    ]
    parts, passes = [], {closed.iteration for closed in snapshot.scene.closed}
    for k, end in zip(starts, [*starts[1:], snapshot.progress.total], strict=True):
        # The number of a pass stands at the right end of its last object.
        width_px = (end - k) * cell - (_PASS_PX if end in passes else 0.0)
        if width_px < _NAME_PX:
            continue
        x, name = k * cell, snapshot.scene.object(snapshot.iterations[k].instance_id).label
        drawn = (
            '<line y1="12" y2="39" stroke="currentColor" stroke-width="1.5"/>'
            f'<text x="3" y="39" font-size="10" fill="currentColor">{text(shortened(name, width_px))}'
            f"<title>{text(name)}</title></text>"
        )
        parts.append(_at(x, drawn))
    return parts


def _passes(snapshot: Snapshot, cell: float) -> list[str]:
    """Where passes were closed: a tick each, and numbers as far as they fit."""
    parts, free = [], 0.0
    for closed in snapshot.scene.closed:
        x = closed.iteration * cell
        parts.append(_at(x, '<path d="M0 30v3" stroke="currentColor" opacity="0.6"/>'))
        if x >= free:
            label = f"pass {closed.number}" if closed.number == 1 else f"{closed.number}"
            # The first stands at the left end, where a long run leaves it no space.
            at = max(x, _PASS_PX)
            parts.append(_at(at, f'<text y="40" font-size="9" text-anchor="end" fill="currentColor">{label}</text>'))
            free = at + _PASS_PX
    return parts


def _aside(marks: Sequence[Mark]) -> dict[tuple[int, RGB], float]:
    """By iteration and colour, how far right of the middle [px]: marks of different colours lie beside each other."""
    order = [meaning.color for meaning in MEANINGS]
    colors: dict[int, set[RGB]] = {}
    for mark in marks:
        colors.setdefault(mark.iteration, set()).add(mark.color)
    return {
        (iteration, color): (k - (len(mine) - 1) / 2) * _ASIDE_PX
        for iteration, mine in colors.items()
        for k, color in enumerate(sorted(mine, key=order.index))
    }


def _star(x: float) -> str:
    return " ".join(f"{x + dx:.1f},{6 + dy}" for dx, dy in ((0, -6), (4, 0), (0, 6), (-4, 0)))


def _triangle(x: float, small: bool) -> str:
    half, top = (3, 6) if small else (5.5, 1)
    return f"{x - half:.1f},{top} {x + half:.1f},{top} {x:.1f},12"
