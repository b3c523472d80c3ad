"""Makes an exported 3D scene tell what it shows: a title, and a legend of what is drawn beside the scene.

Whoever opens the file next week has no panels beside it. All text from data is escaped; nothing is loaded.
"""

from __future__ import annotations

from verefine_viz.core.palette import CLASS_COLORS, SIDE_COLORS, STAGE_COLORS
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import arms_legend, swatch, text
from verefine_viz.viewer.drawing.tables import CLASS_MEANING
from verefine_viz.viewer.snapshot.scene_state import ObjectState
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.names import method_name, verdict_mark
from verefine_viz.viewer.text.sentences import HINTS

ANSWER = "what the run hands on, solid"


def scene_page(page: str, view: Snapshot) -> str:
    """The library's page of a scene with its title and legend.

    Args:
        page: what ``server.scene.as_html`` gives.
        view: what the scene shows.
    """
    name = view.session.title or view.session.scene.demo or "3D scene"
    titled = page.replace("<title>Viser</title>", f"<title>{text(f'{name}, frame {view.frame}')}</title>", 1)
    head, end, rest = titled.rpartition("</body>")
    return f"{head}<style>{asset('scene_page.css')}</style>{legend(view, name)}{end}{rest}"


def legend(view: Snapshot, name: str) -> str:
    """Which moment of which run it is, and what each colour means."""
    facts = f"Frame {view.frame}, {method_name(view.session.method.name)}, {moment(view)}."
    parts = [_objects(view), _sides(view), _stages(view), _surroundings(view)]
    return f'<details id="legend" open><summary>{text(name)}</summary><p>{text(facts)}</p>{"".join(parts)}</details>'


def moment(view: Snapshot) -> str:
    """As in: iteration 4 of 25."""
    if view.is_answer:
        return f"the answer after {view.progress.done} iteration{'s' if view.progress.done != 1 else ''}"
    if view.cursor == 0:
        return "before iteration 1"
    told = f" up to its stage “{view.options.stage}”" if view.options.stage and view.is_partial else ""
    return f"iteration {view.cursor} of {view.progress.total}{told}"


def _objects(view: Snapshot) -> str:
    """Every object with its answer so far."""
    several = len(view.scene.objects) > 1
    rows = "".join(
        f"<tr><td>{swatch(o.color) if several else ''}{text(o.label)} {verdict_mark(o.errors)}</td>"
        f"<td>{text(_found(o))}</td></tr>"
        for o in view.scene.objects
    )
    what = "The answer" if view.is_answer else "Best pose so far"
    return f'<p class="dim">{what}{", by object" if several else ""}:</p><table>{rows}</table>'


def _found(o: ObjectState) -> str:
    if o.answer is None:
        return "no pose"
    off = "" if o.errors is None else f", ADD(-S) {o.errors.add_s_mm:.1f} mm"
    return f"score {o.answer.score.score:.2f}{off}"


def _stages(view: Snapshot) -> str:
    """The poses that are drawn of the object in focus."""
    rows = ""
    for name, color in STAGE_COLORS.items():
        pose = view.poses.get(name)
        if pose is None or (name not in view.options.layers and name != "edited"):
            continue
        score = f"{pose.score.score:.2f}" if pose.score is not None else ""
        meaning = ANSWER if name == "best" and view.is_answer else HINTS[name].partition(" (")[0].partition(";")[0]
        rows += f"<tr><td>{swatch(color)}{text(pose.label)}</td><td>{score}</td><td>{text(meaning)}</td></tr>"
    if "hypotheses" in view.options.layers and view.n_arms:
        rows += f'<tr><td colspan="3">hypotheses, faint: {arms_legend(view.target)}</td></tr>'
    whose = f" of {view.scene.object(view.target.instance.instance_id).label}"
    return f'<p class="dim">Poses{text(whose)}, with their scores:</p><table>{rows}</table>' if rows else ""


def _sides(view: Snapshot) -> str:
    """Which run is which, where two are compared."""
    sides = view.comparison
    if sides is None:
        return ""
    drawn = (("A", sides.name_a, "solid"), ("B", sides.name_b, "as an outline"))
    rows = "".join(
        f"<tr><td>{swatch(SIDE_COLORS[side])}{side}</td><td>{text(name)}, {how}</td></tr>"
        for side, name, how in drawn
        if side in sides.shown
    )
    which = "best pose so far" if sides.which == "best" else "pose accepted last"
    return f'<p class="dim">Two runs, the {which} of each:</p><table>{rows}</table>'


def _surroundings(view: Snapshot) -> str:
    """The cloud's colours, and what is drawn of the ground."""
    layers, said = view.options.layers, []
    if "cloud" in layers and view.options.cloud == "class":
        classes = ", ".join(f"{swatch(c, CLASS_MEANING[k])}{text(k)}" for k, c in CLASS_COLORS.items())
        said.append(f"cloud: the observed depth; its pixels {classes}")
    elif "cloud" in layers and view.options.cloud == "residual":
        said.append("cloud: the observed depth, coloured by its difference from the rendered one")
    elif "cloud" in layers:
        said.append("cloud: the observed depth, in the colours of the photo")
    if view.problem.observation.support is not None:
        said += ["yellow arrow: gravity"] if "gravity" in layers else []
        said += ["blue-grey sheet: support plane, lines every 5 cm"] if "plane" in layers else []
    return f'<p class="dim">{"; ".join(said)}.</p>' if said else ""
