"""Hidden parts, borders and bad masks are not taken for objects of another size, and hide none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage

from tests.calibration.sizes import Depth, Objects, fitting, objects, scene, verdict, with_focal
from verefine_viz.calibration import camera_check
from verefine_viz.calibration.camera_check import CameraVerdict
from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Problem

SHAPES = "too few masks are large enough, and of the shape of their model's outline, to compare sizes"


def cropped(problem: Problem, left: int, top: int, width: int, height: int) -> tuple[Objects, Camera, Depth]:
    """A part of a frame whose border cuts objects."""
    part = slice(top, top + height), slice(left, left + width)
    camera = problem.observation.camera
    K = camera.K - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    return (
        [(model, T, mask[part]) for model, T, mask in objects(problem) if mask[part].any()],
        Camera(K, width, height),
        problem.observation.depth_m[part],
    )


def hidden(problem: Problem, seed: int) -> tuple[Objects, Camera, Depth]:
    """Bars that nobody annotated in front of everything."""
    observation = problem.observation
    v, u = np.indices(observation.camera.shape)
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, np.pi)
    bars = (u * np.cos(angle) + v * np.sin(angle) + rng.uniform(0, 90)) % 90 < 18
    depth_m = np.where(bars, 0.3, observation.depth_m)
    return [(model, T, mask & ~bars) for model, T, mask in objects(problem)], observation.camera, depth_m


def test_parts_that_are_hidden_or_beyond_the_border_change_nothing() -> None:
    frames = [cropped(scene(), 200, 150, 250, 200), cropped(scene(), 140, 100, 280, 180)]
    frames += [hidden(scene(), seed) for seed in range(3)]
    for focal in (0.85, 1.0, 1.18):
        for of, camera, depth_m in frames:
            said = verdict(of, with_focal(camera, focal), depth_m)
            if focal == 1:
                assert not said.advice, focal
            else:
                assert said.cause == "focal length", focal
                assert fitting(said) == pytest.approx(1 / focal, rel=0.03), focal


def wide(mask: Mask, rng: np.random.Generator, by_px: float) -> Mask:
    return ndimage.distance_transform_edt(~mask) - ndimage.distance_transform_edt(mask) <= by_px  # pyright: ignore


def rough(mask: Mask, rng: np.random.Generator) -> Mask:
    """Its border wanders by some 6 px."""
    waves = ndimage.gaussian_filter(rng.normal(size=mask.shape), 8)
    return wide(mask, rng, 6 * waves / waves.std())


def boxed(mask: Mask, rng: np.random.Generator) -> Mask:
    rows, columns = np.nonzero(mask)
    box = np.zeros_like(mask)
    box[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    return box


def cut(mask: Mask, rng: np.random.Generator) -> Mask:
    """A fifth of it is missing, on one side."""
    rows, columns = np.nonzero(mask)
    angle = rng.uniform(0, 2 * np.pi)
    along = columns * np.cos(angle) + rows * np.sin(angle)
    left = mask.copy()
    left[rows[along < np.quantile(along, 0.2)], columns[along < np.quantile(along, 0.2)]] = False
    return left


BAD_MASKS: dict[str, Callable[[Mask, np.random.Generator], Mask]] = {
    "3 px too wide": lambda mask, rng: wide(mask, rng, 3.0),
    "2 px too narrow": lambda mask, rng: wide(mask, rng, -2.5),
    "rough": rough,
    "boxes": boxed,
    "cut": cut,
    "displaced": lambda mask, rng: np.roll(mask, rng.integers(-15, 16, 2), axis=(0, 1)),
}


@pytest.mark.parametrize("kind", BAD_MASKS)
def test_bad_masks_say_nothing(kind: str) -> None:
    for seed, frame in enumerate(("0/0", "0/1")):
        rng, problem = np.random.default_rng(seed), scene("clutter", frame)
        bad = [(model, T, BAD_MASKS[kind](mask, rng)) for model, T, mask in objects(problem)]
        assert not verdict(bad, problem.observation.camera, problem.observation.depth_m).advice


def test_a_wrong_focal_length_is_noticed_beside_some_bad_masks() -> None:
    rng = np.random.default_rng(4)
    some = [(m, T, cut(mask, rng) if k in (1, 4) else mask) for k, (m, T, mask) in enumerate(objects(scene()))]
    said = verdict(some, with_focal(scene().observation.camera, 0.85), scene().observation.depth_m)
    assert said.cause == "focal length"


def test_objects_of_few_pixels_say_nothing() -> None:
    step = 8
    camera = scene().observation.camera
    small = Camera(np.diag([1 / step, 1 / step, 1]) @ camera.K, camera.width // step, camera.height // step)
    of = [(model, T, mask[::step, ::step]) for model, T, mask in objects(scene())]
    said = verdict(of, with_focal(small, 0.8), scene().observation.depth_m[::step, ::step])
    assert said == CameraVerdict(SHAPES)
    assert camera_check.verdict([]) == CameraVerdict(SHAPES)
