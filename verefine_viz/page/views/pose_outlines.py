"""The outlines of a model in the image at many poses: answer to the want ``outlines``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.page.answers_to_wants import OutlinesAnswer
from verefine_viz.page.protocol import pose_matrix

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.protocol import OutlinesWanted
    from verefine_viz.page.workspace import Workspace

OutlineOf = Callable[[ObjectModel, Float, Camera], list[list[float]]]
"""Draws the outline of a model at a pose (4, 4): ``pictures/silhouettes.py``."""


def outlines(space: Workspace, want: OutlinesWanted, _blobs: Blobs, outline_of: OutlineOf) -> OutlinesAnswer:
    """The answer to a want of outlines: for each pose its polygons [u, v, u, v, …] in pixels; pixel centres are whole.

    Raises:
        InputError: there is no such object.
    """
    target = space.problem.target(want.obj)
    camera = target.observation.camera
    return OutlinesAnswer([outline_of(target.model, pose_matrix(T), camera) for T in want.poses])
