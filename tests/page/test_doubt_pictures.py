"""What shows a doubt about the data in the image: models as they are, and as they look once the data are put right."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.calibration.sizes import scene
from tests.calibration.spoiled import SPOILED, with_depth
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.corrected_data import corrected
from verefine_viz.calibration.edges import depth_edges
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import SceneSettings
from verefine_viz.page.answers_to_wants import DoubtShape
from verefine_viz.page.protocol import DoubtWanted
from verefine_viz.page.views.doubt_picture import doubt
from verefine_viz.pictures.silhouettes import outline


def shapes(problem: Problem, index: int = 0) -> dict[tuple[str, int | None], DoubtShape]:
    branch = SimpleNamespace(run=SimpleNamespace(problem=problem), doubts=lambda: data_doubts(problem))
    space: Any = SimpleNamespace(branch=lambda _: branch)
    drawn = doubt(space, DoubtWanted(index=index), None, outline_of=outline, edges_of=depth_edges)  # type: ignore[arg-type]
    return {(shape.role, shape.obj): shape for shape in drawn.shapes}


def filled(shape: DoubtShape) -> np.ndarray:
    """The box around the outline of a shape, [u0, v0, u1, v1]."""
    points = np.concatenate([np.reshape(polygon, (-1, 2)) for polygon in shape.polygons])
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize(
    "name", ["models × 0.1", "translations × 1000", "OpenGL", "inverse", "K of another camera", "K of another size"]
)
def test_models_are_drawn_as_they_look_in_the_frame_that_is_put_right(name: str) -> None:
    problem = SPOILED[name]()
    (one,) = data_doubts(problem)
    assert one.remedy is not None
    right, drawn = corrected(problem, one.remedy, SceneSettings()), shapes(problem)
    for target in right.targets:
        own = target.instance.instance_id
        T, camera = target.instance.hypotheses[0].T_cam_obj, right.observation.camera
        # A model in another unit is simplified by another share, so that its outline is a pixel elsewhere.
        box = filled(drawn["fits", own]) - filled(DoubtShape("fits", "", own, outline(target.model, T, camera)))
        assert np.abs(box).max() < 1.5, name
        before = problem.target(own)
        as_it_is = outline(before.model, before.instance.hypotheses[0].T_cam_obj, problem.observation.camera)
        assert drawn["given", own].polygons == as_it_is


def test_depth_in_another_unit_draws_models_as_far_away_as_it_says() -> None:
    drawn = shapes(SPOILED["depth × 10"]())
    for instance in scene("clutter", "0/0").instances:
        given, fits = (filled(drawn[role, instance.instance_id]) for role in ("given", "fits"))
        ratio = (given[2:] - given[:2]) / (fits[2:] - fits[:2])
        assert ratio == pytest.approx([0.1, 0.1], rel=0.25)


def test_displaced_depth_draws_its_edges_and_where_they_would_be() -> None:
    drawn = shapes(SPOILED["depth beside"]())
    edges, fits = (
        np.concatenate([np.reshape(p, (-1, 2)) for p in drawn[role, None].polygons]) for role in ("edges", "fits")
    )
    assert np.median(edges[:, 0]) - np.median(fits[:, 0]) == pytest.approx(25, abs=8)


def test_a_doubt_that_is_there_no_more_is_refused() -> None:
    with pytest.raises(InputError, match="no more"):
        shapes(with_depth(scene("clutter", "0/0"), 1.0))
