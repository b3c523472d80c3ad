"""Maps at some pixels are those pixels of the maps of the whole image."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from tests.fakes import seen_at
from tests.rendering.conftest import MakeVerifier
from tests.rendering.test_scene_score import MODES, combinations, targets_of
from tests.rendering.witness import CAMERA, T_BOX, box
from verefine_viz.core.problem import Placed
from verefine_viz.core.scores import PixelGrid, ScoreMaps


def assert_same(some: ScoreMaps, whole: ScoreMaps, at: PixelGrid) -> None:
    expected = seen_at(whole, at)
    for field in fields(whole):
        np.testing.assert_array_equal(getattr(some, field.name), getattr(expected, field.name), field.name)


def test_in_any_order_and_more_than_once(make: MakeVerifier) -> None:
    targets, Ts = targets_of(), combinations(3)
    placed = (Placed(9, box(), T_BOX),)
    for pixels in MODES:
        verifier = make(pixels=pixels)
        rng = np.random.default_rng(4)
        for k in range(3):
            at = PixelGrid(rng.integers(0, CAMERA.height, 90), rng.integers(0, CAMERA.width, 70))
            for others in ((), placed):
                some, whole = (verifier.maps(targets[k], Ts[k, k], others, grid) for grid in (at, None))
                assert (some.classes > 0).any(), pixels
                assert_same(some, whole, at)
                assert_same(
                    verifier.scene_maps(targets, Ts[k], others, at=at), verifier.scene_maps(targets, Ts[k], others), at
                )
