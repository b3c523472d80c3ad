"""Outlines in the photo: each object's best pose so far, and its ground truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import RGB, STAGE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Iteration
from verefine_viz.pictures.silhouettes import outline
from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recording_file import RecordingFile

WIDTH, TRUTH_WIDTH = -1.5, -0.7
"""In points of the screen, which rerun takes negative radii for."""


class Contours:
    """Follows the best poses from iteration to iteration."""

    def __init__(self, layout: Layout, targets: Mapping[int, Target]) -> None:
        self._layout, self._targets = layout, targets
        self._best: dict[int, Float] = {}
        self._rows: dict[int, tuple[list[int], list[list[Float]]]] = {}

    def start(self, file: RecordingFile) -> None:
        """Colours, and the outlines of the ground truth."""
        for branch in self._layout.branches:
            color: RGB = self._layout.colors[branch.instance_id] if self._layout.is_scene else STAGE_COLORS["best"]
            file.log(entities.contour(branch.name), rr.LineStrips2D.from_fields(colors=[color], radii=[WIDTH]))
            T_gt = self._targets[branch.instance_id].instance.T_cam_obj_gt
            if T_gt is not None:
                lines, white = self._lines(branch.instance_id, T_gt), STAGE_COLORS["ground truth"]
                strips = rr.LineStrips2D(lines, colors=[(*white, 140)], radii=[TRUTH_WIDTH])
                file.log(entities.contour_of_truth(branch.name), strips)

    def add(self, iteration: Iteration) -> None:
        """Takes the next one."""
        own, T = iteration.instance_id, iteration.best.T_cam_obj
        if own not in self._best or not np.array_equal(self._best[own], T):
            self._best[own] = T
            indices, lines = self._rows.setdefault(own, ([], []))
            indices.append(iteration.index)
            lines.append(self._lines(own, T))

    def send(self, file: RecordingFile) -> None:
        """What changed since the last call."""
        for instance_id, (indices, lines) in self._rows.items():
            strips = rr.LineStrips2D.columns(strips=[line for some in lines for line in some])
            file.send(
                entities.contour(self._layout.branch(instance_id).name), indices, strips.partition([*map(len, lines)])
            )
        self._rows.clear()

    def _lines(self, instance_id: int, T_cam_obj: Float) -> list[Float]:
        """Closed lines (n, 2); in rerun a pixel's centre is at a half."""
        target = self._targets[instance_id]
        flat = outline(target.model, T_cam_obj, target.observation.camera)
        return [np.array(line).reshape(-1, 2) + 0.5 for line in flat]
