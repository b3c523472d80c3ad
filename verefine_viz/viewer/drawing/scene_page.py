"""Makes an exported 3D scene say what it shows: a title, and a legend of what is drawn beside the scene.

Nothing is loaded from elsewhere: the file is opened without the page's panels and perhaps without a network.
"""

from __future__ import annotations

from verefine_viz.core.palette import CLASS_COLORS, RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import arms_legend, filled, ready, swatch, text
from verefine_viz.viewer.drawing.pose_tables import CLASS_MEANING
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import STAGE_MEANINGS, counted, in_focus, method_name, verdict_mark

ANSWER = "what the run hands on, solid"


def scene_page(page: str, snapshot: Snapshot) -> str:
    """The library's page of a scene with its title and legend.

    Args:
        page: what ``server.scene.as_html`` gives.
        snapshot: what the scene shows.
    """
    name = snapshot.session.title or snapshot.session.scene.demo or "3D scene"
    titled = page.replace("<title>Viser</title>", f"<title>{text(f'{name}, frame {snapshot.frame}')}</title>", 1)
    head, end, rest = titled.rpartition("</body>")
    return f"{head}{legend(snapshot, name)}{end}{rest}"


def legend(snapshot: Snapshot, name: str) -> str:
    """Which moment of which run it is, and what each colour means."""
    has_ghosts = "hypotheses" in snapshot.options.layers and snapshot.n_arms
    return filled(
        "scene_legend.html",
        style=ready(asset("scene_page.css")),
        name=name,
        facts=f"Frame {snapshot.frame}, {method_name(snapshot.session.method.name)}, {moment(snapshot)}.",
        snapshot=snapshot,
        several=len(snapshot.scene.objects) > 1,
        mark=verdict_mark,
        side_colors=SIDE_COLORS,
        focus=in_focus(snapshot).label,
        poses=_poses(snapshot),
        hypotheses=ready(arms_legend(snapshot.target)) if has_ghosts else "",
        surroundings=ready("; ".join(_surroundings(snapshot))),
    )


def moment(snapshot: Snapshot) -> str:
    """As in: iteration 4 of 25."""
    if snapshot.is_answer:
        return f"the answer after {counted(snapshot.progress.done, 'iteration')}"
    if snapshot.cursor == 0:
        return "before iteration 1"
    part = f" up to its stage “{snapshot.options.stage}”" if snapshot.options.stage and snapshot.is_partial else ""
    return f"iteration {snapshot.cursor} of {snapshot.progress.total}{part}"


def _poses(snapshot: Snapshot) -> list[tuple[RGB, str, str, str]]:
    """(colour, name, score, meaning) of the poses that are drawn of the object in focus."""
    drawn = []
    for name, color in STAGE_COLORS.items():
        pose = snapshot.poses.get(name)
        if pose is not None and (name in snapshot.options.layers or name == "edited"):
            score = f"{pose.score.score:.2f}" if pose.score is not None else ""
            meaning = STAGE_MEANINGS[name].partition(" (")[0].partition(";")[0]
            drawn.append((color, pose.label, score, ANSWER if name == "best" and snapshot.is_answer else meaning))
    return drawn


def _surroundings(snapshot: Snapshot) -> list[str]:
    """The cloud's colours, and what is drawn of the ground."""
    layers, drawn = snapshot.options.layers, []
    if "cloud" in layers and snapshot.options.cloud == "class":
        classes = ", ".join(f"{swatch(c, CLASS_MEANING[k])}{text(k)}" for k, c in CLASS_COLORS.items())
        drawn.append(f"cloud: the observed depth; its pixels {classes}")
    elif "cloud" in layers and snapshot.options.cloud == "residual":
        drawn.append("cloud: the observed depth, coloured by its difference from the rendered one")
    elif "cloud" in layers and snapshot.options.cloud == "error":
        drawn.append("cloud: the observed depth, coloured by its distance to the posed model")
    elif "cloud" in layers:
        drawn.append("cloud: the observed depth, in the colours of the photo")
    if snapshot.problem.observation.support is not None:
        drawn += ["yellow arrow: gravity"] if "gravity" in layers else []
        sheet = "support plane, lines every 5 cm"
        if snapshot.problem.observation.support.surroundings is not None:
            sheet = "what supports; brown: what else stands there; pink: unknown objects"
        drawn += [f"blue-grey sheet: {sheet}"] if "plane" in layers else []
    return drawn
