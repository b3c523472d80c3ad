"""The timeline: every iteration, its marks, and a slider to any of them."""

from __future__ import annotations

import viser

from verefine_viz.core.palette import ARM_COLORS, RGB
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.markup import carries, text
from verefine_viz.viewer.tables import where
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block, Send, by_person

_WIDTH, _HEIGHT = 860, 40


class TimelinePanel:
    """A strip of iterations coloured by hypothesis, marks above, the slider below."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._line = Block(gui, "line")
        self.slider = gui.add_slider("Iteration", 0, 1, 1, 0, hint="0 = before the first; Home, End, PageUp, PageDown")
        self.slider.on_update(by_person(lambda v: send(c.Seek(int(v)))))

    def show(self, view: View, hand_is_ahead: bool = False) -> None:
        """Draws the strip; leaves the slider alone while a hand moves it further."""
        self._line.show(strip(view))
        self.slider.max = max(view.progress.total, 1)
        if not hand_is_ahead:
            self.slider.value = min(view.cursor, int(self.slider.max))


def strip(view: View) -> str:
    """The iterations as an SVG: a cell each, coloured by hypothesis; red, blue, orange and green marks above."""
    total = max(view.progress.total, 1)
    cell = _WIDTH / total
    parts = []
    for iteration in view.iterations:
        x = (iteration.index - 1) * cell
        title = f"iteration {iteration.index}: hypothesis {iteration.arm + 1}, {iteration.accepted} kept"
        score = iteration.accepted_stage.score
        if score is not None:
            title += f", score {score.score:.3f}"
        color = ARM_COLORS[iteration.arm % len(ARM_COLORS)]
        parts.append(
            f'<g {carries(c.Seek(iteration.index))}><rect x="{x:.1f}" y="14" width="{max(cell - 1, 1):.1f}" '
            f'height="12" rx="1.5" fill="rgb{color}"/><title>{text(title)}</title></g>'
        )
    parts += _objects(view, cell)
    for mark in sorted(view.marks, key=lambda m: m.is_red):
        x = (mark.iteration - 0.5) * cell
        parts.append(_triangle(x, mark.color, mark.iteration, mark.text, small=mark.kind == "new_best"))
    x = view.cursor * cell - cell / 2 if view.cursor else 0
    parts.append(f'<rect x="{x - 1:.1f}" y="10" width="2.5" height="20" fill="currentColor"/>')
    rest = f'<rect x="0" y="19" width="{_WIDTH}" height="2" fill="currentColor" opacity="0.15"/>'
    box = f'viewBox="0 0 {_WIDTH} {_HEIGHT}" height="{_HEIGHT}" preserveAspectRatio="none"'
    return f'<div style="font-size:12px">{where(view)}</div><svg {box}>{rest}{"".join(parts)}</svg>'


def _objects(view: View, cell: float) -> list[str]:
    """Where the run goes on to another object: a line, and the object's name below its iterations."""
    if len(view.problem.instances) < 2:
        return []
    names = {i.instance_id: view.problem.models[i.obj_id].name for i in view.problem.instances}
    parts = []
    for k, iteration in enumerate(view.iterations):
        if k and view.iterations[k - 1].instance_id == iteration.instance_id:
            continue
        x = k * cell
        parts.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="12" y2="38" stroke="currentColor" stroke-width="1.5"/>'
            f'<text x="{x + 3:.1f}" y="37" font-size="10" fill="currentColor">'
            f"{text(names[iteration.instance_id])}</text>"
        )
    return parts


def _triangle(x: float, color: RGB, iteration: int, title: str, small: bool) -> str:
    half, top = (3, 6) if small else (5.5, 1)
    points = f"{x - half:.1f},{top} {x + half:.1f},{top} {x:.1f},12"
    return (
        f'<g {carries(c.Seek(iteration))}><polygon points="{points}" fill="rgb{color}"/>'
        f"<title>iteration {iteration}: {text(title)}</title></g>"
    )
