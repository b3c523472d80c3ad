"""Makes an exported 3D scene say what it shows: a title, and a legend of what is drawn beside the scene.

Nothing is loaded from elsewhere: the file is opened without the page's panels and perhaps without a network.
"""

from __future__ import annotations

from verefine_viz.core.palette import CLASS_COLORS, RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import arms_legend, swatch, text
from verefine_viz.viewer.drawing.tables import CLASS_MEANING
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
    return f"{head}{legend(view, name)}{end}{rest}"


def legend(view: Snapshot, name: str) -> str:
    """Which moment of which run it is, and what each colour means."""
    from verefine_viz.viewer.drawing.templates import filled, ready  # The page starts without jinja2.

    has_ghosts = "hypotheses" in view.options.layers and view.n_arms
    return filled(
        "scene_legend.html",
        style=ready(asset("scene_page.css")),
        name=name,
        facts=f"Frame {view.frame}, {method_name(view.session.method.name)}, {moment(view)}.",
        view=view,
        several=len(view.scene.objects) > 1,
        mark=verdict_mark,
        side_colors=SIDE_COLORS,
        focus=view.scene.object(view.target.instance.instance_id).label,
        poses=_poses(view),
        hypotheses=ready(arms_legend(view.target)) if has_ghosts else "",
        surroundings=ready("; ".join(_surroundings(view))),
    )


def moment(view: Snapshot) -> str:
    """As in: iteration 4 of 25."""
    if view.is_answer:
        return f"the answer after {view.progress.done} iteration{'s' if view.progress.done != 1 else ''}"
    if view.cursor == 0:
        return "before iteration 1"
    part = f" up to its stage “{view.options.stage}”" if view.options.stage and view.is_partial else ""
    return f"iteration {view.cursor} of {view.progress.total}{part}"


def _poses(view: Snapshot) -> list[tuple[RGB, str, str, str]]:
    """(colour, name, score, meaning) of the poses that are drawn of the object in focus."""
    drawn = []
    for name, color in STAGE_COLORS.items():
        pose = view.poses.get(name)
        if pose is not None and (name in view.options.layers or name == "edited"):
            score = f"{pose.score.score:.2f}" if pose.score is not None else ""
            meaning = HINTS[name].partition(" (")[0].partition(";")[0]
            drawn.append((color, pose.label, score, ANSWER if name == "best" and view.is_answer else meaning))
    return drawn


def _surroundings(view: Snapshot) -> list[str]:
    """The cloud's colours, and what is drawn of the ground."""
    layers, drawn = view.options.layers, []
    if "cloud" in layers and view.options.cloud == "class":
        classes = ", ".join(f"{swatch(c, CLASS_MEANING[k])}{text(k)}" for k, c in CLASS_COLORS.items())
        drawn.append(f"cloud: the observed depth; its pixels {classes}")
    elif "cloud" in layers and view.options.cloud == "residual":
        drawn.append("cloud: the observed depth, coloured by its difference from the rendered one")
    elif "cloud" in layers:
        drawn.append("cloud: the observed depth, in the colours of the photo")
    if view.problem.observation.support is not None:
        drawn += ["yellow arrow: gravity"] if "gravity" in layers else []
        drawn += ["blue-grey sheet: support plane, lines every 5 cm"] if "plane" in layers else []
    return drawn
