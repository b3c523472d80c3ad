"""The score around the answer: six curves, a heat map over two axes, and what the observation cannot tell."""

from __future__ import annotations

import json

import viser

from verefine_viz.diagnosis.ambiguity import in_words
from verefine_viz.evaluation.landscape import Curve, Landscape, Slice
from verefine_viz.pictures.landscape_picture import curve_svg, slice_svg
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import carries, choice, link, sentence, small, warning
from verefine_viz.viewer.drawing.near_symmetry_picture import near_symmetries_html
from verefine_viz.viewer.panels.widgets import Block
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.empty_tabs import no_landscape

CURVE_PX, CURVE_HEIGHT_PX = 150, 52
SLICE_PX = 116

HINT = (
    "Shaded: there the score does not tell a pose from the answer. Grey band: twice the score's noise, by which that "
    "is decided."
)


class LandscapePanel:
    """Worked out when the run is over, or on demand; a click on a curve or on the map edits the pose there."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """What is known by now; it does not change while the pose around which it was scored stays the best."""
        self._block.show(landscape_html(snapshot))


def landscape_html(snapshot: Snapshot) -> str:
    """The whole panel, or how to get it."""
    around, missing = snapshot.landscape, no_landscape(snapshot)
    if missing:
        wanted = (
            link("Score the poses around the answer so far", c.ShowLandscape())
            if "best" in snapshot.poses and not snapshot.is_whole_scene
            else ""
        )
        return sentence(missing) + f"<p>{wanted}</p>" * bool(wanted)
    if around is None:
        return sentence("Scoring the poses around the answer …")
    parts = verdict_html(snapshot, around), curves_html(snapshot, around), _slice_html(snapshot, around)
    known = snapshot.near_symmetries
    return "".join(parts) + (near_symmetries_html(snapshot.target.model, known) if known is not None else "")


def verdict_html(snapshot: Snapshot, around: Landscape) -> str:
    """The least certain axis, and a pose that fits as well as the answer."""
    words = around.least_certain.in_words()
    verdict = sentence(f"Answer of {snapshot.name}: {words}.")
    other = snapshot.other_pose
    if other is None:
        return verdict
    return verdict + warning(in_words(snapshot.name, around, other), link("edit it", c.EditOtherPose()), folded=True)


def curves_html(snapshot: Snapshot, around: Landscape) -> str:
    """The six curves of the chosen axes."""
    frame = snapshot.options.curves_of
    drawn = "".join(_curve(k, curve) for k, curve in enumerate(around.curves) if curve.axis.frame == frame)
    return f'<div style="display:grid;grid-template-columns:1fr 1fr;gap:2px 4px;margin-bottom:4px">{drawn}</div>'


def _curve(k: int, curve: Curve) -> str:
    area = json.dumps([0, 0, len(curve.offsets), 1])
    click = f'{carries(c.EditPoseOnCurve(k, 0))} data-crop="{area}" style="cursor:crosshair;width:100%;height:auto"'
    return curve_svg(curve, CURVE_PX, CURVE_HEIGHT_PX, click)


def _slice_html(snapshot: Snapshot, around: Landscape) -> str:
    across, up = snapshot.options.slice_axes
    names = [(k, curve.axis.words) for k, curve in enumerate(around.curves)]
    lists = choice(
        "whose axes",
        [("the table's axes", c.ShowLandscape("table")), ("its own axes", c.ShowLandscape("object"))],
        c.ShowLandscape(snapshot.options.curves_of),
    )
    lists += choice(
        "across", [(f"→ {name}", c.ShowLandscape(across=k)) for k, name in names], c.ShowLandscape(across=across)
    )
    lists += choice("up", [(f"↑ {name}", c.ShowLandscape(up=k)) for k, name in names], c.ShowLandscape(up=up))
    two = snapshot.score_slice
    picture = _map(two) if two is not None else f'<div style="height:{SLICE_PX}px"></div>'
    hint = small("A click edits the pose there.", HINT)
    side = f'<div style="flex:1;min-width:0;display:grid;gap:4px;align-content:start">{lists}{hint}</div>'
    return f'<div style="display:flex;gap:8px">{picture}{side}</div>'


def _map(two: Slice) -> str:
    area = json.dumps([0, 0, len(two.scores), len(two.scores)])
    click = f'{carries(c.EditPoseInSlice(0, 0))} data-crop="{area}" style="cursor:crosshair;flex:none"'
    return slice_svg(two, SLICE_PX, click)
