"""A model as it would look at a pose: answer to the want ``shaded``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.page.answers_to_wants import ShadedAnswer
from verefine_viz.page.frame_messages import Box
from verefine_viz.page.protocol import pose_matrix

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.protocol import ShadedWanted
    from verefine_viz.page.workspace import Workspace

PictureOf = Callable[[Target, Float], tuple[Box, bytes] | None]
"""Draws a model at a pose (4, 4): ``pictures/shaded_models.py``."""


def shaded(space: Workspace, want: ShadedWanted, blobs: Blobs, picture_of: PictureOf) -> ShadedAnswer:
    """The answer to a want of a shaded model: a PNG with transparency over a region; no url where nothing shows.

    Raises:
        InputError: there is no such object.
    """
    drawn = picture_of(space.problem.target(want.obj), pose_matrix(want.T))
    if drawn is None:
        return ShadedAnswer((0, 0, 0, 0), None)
    region, picture = drawn
    return ShadedAnswer(region, f"/blob/{blobs.put(picture, 'image/png')}")
