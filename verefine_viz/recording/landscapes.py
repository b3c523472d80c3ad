"""The score around each answer of a finished run: a curve for each axis, and in words what is undetermined."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.evaluation.pose_axes import AXIS_WORDS
from verefine_viz.evaluation.pose_landscape import Curve, Landscape
from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recording_file import RecordingFile

BOX = (160.0, 100.0)
"""Width and height in which a curve is drawn."""


def log_landscape(file: RecordingFile, branch_name: str, around: Landscape) -> None:
    """The landscape of one object's answer."""
    for k, curve in enumerate(around.curves):
        numbers = rr.AnyValues(offsets=curve.offsets, scores=curve.scores)
        file.log(entities.landscape(branch_name, k), *_drawn(curve), numbers)
    least_certain = around.allowed.least_certain
    widest = sorted(around.allowed.extents, key=lambda extent: extent is not least_certain)
    words = "\n".join(f"- {extent.describe()}" for extent in widest)
    file.log(entities.landscape_words(branch_name), rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN))


def _drawn(curve: Curve) -> tuple[rr.LineStrips2D, rr.Points2D]:
    """The curve in a box of fixed size, with its ends named: rerun has no chart over anything but time."""
    offsets, scores, unit = curve.offsets, curve.scores, curve.axis.unit
    lowest, highest = float(np.nanmin(scores)), float(np.nanmax(scores))
    x = BOX[0] * (offsets - offsets[0]) / max(offsets[-1] - offsets[0], 1e-12)
    y = BOX[1] * (highest - scores) / max(highest - lowest, 1e-12)
    zero = float(np.interp(0.0, offsets, x))
    line = rr.LineStrips2D(
        [np.column_stack([x, y]), [[zero, 0.0], [zero, BOX[1]]]], colors=[STAGE_COLORS["best"], (90, 90, 90)]
    )
    places = [[0.0, BOX[1]], [BOX[0], BOX[1]], [zero, 0.0]]
    labels = [f"{offsets[0]:.3g} {unit}", f"{offsets[-1]:.3g} {unit}", f"{highest:.3f}, lowest {lowest:.3f}"]
    return line, rr.Points2D(places, radii=0.5, colors=(150, 150, 150), labels=labels, show_labels=True)


def landscape_tab(layout: Layout) -> rrb.Container:
    """A tab of the whole window: for each object its words and its curves."""
    return rrb.Tabs(*(_object_view(name) for name in layout.names), name="Landscape")


def _object_view(branch_name: str) -> rrb.Container:
    words = rrb.TextDocumentView(origin=entities.landscape_words(branch_name), name="Undetermined")
    charts = [
        rrb.Spatial2DView(origin=entities.landscape(branch_name, k), name=name) for k, name in enumerate(AXIS_WORDS)
    ]
    return rrb.Horizontal(words, rrb.Grid(*charts, grid_columns=4), column_shares=[1, 3], name=branch_name)
