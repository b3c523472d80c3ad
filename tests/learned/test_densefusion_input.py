"""What DenseFusion sees, against the official preparation written down step by step."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from verefine_viz.core.camera import Camera
from verefine_viz.learned.densefusion_input import BORDER_PX, MEAN, STD, crop_of, window_around

SEEDS = st.integers(0, 2**32 - 1)
SIZES = (40, 80, 120, 160, 200, 240, 280, 320, 360, 400, 440, 480, 520, 560, 600, 640, 680)
CAMERA = Camera(np.array([[1066.778, 0, 312.9869], [0, 1067.487, 241.3109], [0, 0, 1]]), 640, 480)


def official_window(mask: np.ndarray) -> tuple[int, int, int, int]:
    """First and last row and column + 1, as the official implementation goes about it, for images of 480 × 640."""
    rows, columns = np.nonzero(mask)
    spans = []
    for first, end, length in ((rows.min(), rows.max() + 1, 480), (columns.min(), columns.max() + 1, 640)):
        size = next(s for s in SIZES if end - first <= s)
        middle = int((first + end) / 2)
        low, high = middle - int(size / 2), middle + int(size / 2)
        if low < 0:
            low, high = 0, high - low
        if high > length:
            low, high = low - (high - length), length
        spans += [low, high]
    return tuple(int(s) for s in spans)  # type: ignore[return-value]


def random_mask(rng: np.random.Generator) -> np.ndarray:
    mask = np.zeros((480, 640), bool)
    top, left = int(rng.integers(470)), int(rng.integers(630))
    height, width = (int(np.exp(rng.uniform(0, np.log(600)))) for _ in range(2))
    mask[top : top + height, left : left + width] = True
    mask &= rng.random(mask.shape) < rng.uniform(0.2, 1)
    mask[top, left] = True
    return mask


def random_frame(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    rgb = rng.integers(0, 256, (480, 640, 3)).astype(np.uint8)
    depth_m = rng.uniform(0.3, 1.5, (480, 640)).astype(np.float32)
    depth_m[rng.random(depth_m.shape) < 0.1] = 0
    return rgb, depth_m


@given(SEEDS)
def test_the_window_is_the_official_one(seed: int) -> None:
    mask = random_mask(np.random.default_rng(seed))
    window = window_around(mask)
    top, bottom, left, right = official_window(mask)
    assert (window.top, window.top + window.height) == (top, bottom)
    assert (window.left, window.left + window.width) == (left, right)


@settings(max_examples=50)
@given(SEEDS, st.sampled_from([10, 500, 1000]))
def test_points_lie_where_their_pixels_do(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    mask, (rgb, depth_m) = random_mask(rng), random_frame(rng)
    crop = crop_of(rgb, depth_m, mask, CAMERA, n, 0)
    usable = mask & (depth_m > 0)
    if crop is None:
        assert not usable.any()
        return
    assert crop.points.shape == (1, n, 3)
    assert crop.n_distinct == min(n, usable.sum())
    window = window_around(mask)
    rows, columns = crop.chosen // window.width + window.top, crop.chosen % window.width + window.left
    assert usable[rows, columns].all()
    np.testing.assert_allclose(crop.points[0], CAMERA.back_project(depth_m)[rows, columns], atol=1e-6)
    # Their colours are those of the image, 0 … 255, shifted and scaled.
    flat = crop.image[0].reshape(3, -1)[:, crop.chosen]
    np.testing.assert_allclose(flat.T * STD + MEAN, rgb[rows, columns], atol=1e-3)
    first = crop.chosen[: crop.n_distinct]
    assert (np.diff(first) > 0).all()
    assert np.array_equal(crop.chosen, np.resize(first, n))


def test_a_large_mask_gives_a_choice_that_its_seed_decides() -> None:
    rng = np.random.default_rng(0)
    (rgb, depth_m), mask = random_frame(rng), np.zeros((480, 640), bool)
    mask[100:300, 200:400] = True
    one, same, other = (crop_of(rgb, depth_m, mask, CAMERA, 500, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.chosen, same.chosen)
    assert not np.array_equal(one.chosen, other.chosen)


def test_without_depth_there_is_nothing_to_see() -> None:
    rgb, depth_m = random_frame(np.random.default_rng(0))
    for bad in (0.0, np.nan, np.inf, -1.0):
        assert crop_of(rgb, np.full_like(depth_m, bad), np.ones((480, 640), bool), CAMERA, 10, 0) is None


def test_an_image_smaller_than_the_window_is_continued_in_black() -> None:
    camera = Camera(np.array([[50.0, 0, 24.5], [0, 50.0, 14.5], [0, 0, 1]]), 50, 30)
    rgb, depth_m, mask = np.full((30, 50, 3), 255, np.uint8), np.ones((30, 50), np.float32), np.ones((30, 50), bool)
    crop = crop_of(rgb, depth_m, mask, camera, 1500, 0)
    assert crop.image.shape == (1, 3, BORDER_PX, 2 * BORDER_PX)
    shown = crop.image[0] * STD[:, None, None] + MEAN[:, None, None]
    np.testing.assert_allclose(shown[:, :30, :50], 255, atol=1e-3)
    np.testing.assert_allclose(shown[:, 30:], 0, atol=1e-3)
    np.testing.assert_allclose(shown[:, :, 50:], 0, atol=1e-3)
