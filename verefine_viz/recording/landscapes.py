"""The score around each answer of a finished run: a bar chart for each axis, and in words what is undetermined."""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.evaluation.pose_axes import AXIS_WORDS
from verefine_viz.evaluation.pose_landscape import Landscape
from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recording_file import RecordingFile


def log_landscape(file: RecordingFile, branch_name: str, around: Landscape) -> None:
    """The landscape of one object's answer."""
    for k, curve in enumerate(around.curves):
        chart = rr.BarChart(curve.scores, abscissa=curve.offsets, color=STAGE_COLORS["best"])
        file.log(entities.landscape(branch_name, k), chart)
    least_certain = around.allowed.least_certain
    widest = sorted(around.allowed.extents, key=lambda extent: extent is not least_certain)
    words = "\n".join(f"- {extent.describe()}" for extent in widest)
    file.log(entities.landscape_words(branch_name), rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN))


def landscape_tab(layout: Layout) -> rrb.Container:
    """A tab of the whole window: for each object its words and its curves."""
    return rrb.Tabs(*(_object_view(name) for name in layout.names), name="Landscape")


def _object_view(branch_name: str) -> rrb.Container:
    words = rrb.TextDocumentView(origin=entities.landscape_words(branch_name), name="Undetermined")
    charts = [
        rrb.BarChartView(origin=entities.landscape(branch_name, k), name=name) for k, name in enumerate(AXIS_WORDS)
    ]
    return rrb.Horizontal(words, rrb.Grid(*charts, grid_columns=4), column_shares=[1, 3], name=branch_name)
