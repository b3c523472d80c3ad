"""Score maps as pictures, the probe, and which pixel a click in 3D means."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from tests.fakes import FakeVerifier, box_problem
from verefine_viz.core.palette import CLASS_COLORS, EMPTY
from verefine_viz.core.scores import COLOUR_MAPS, MAP_NAMES, PoseScore, ScoreMaps
from verefine_viz.viewer.drawing.pose_tables import score_table
from verefine_viz.viewer.drawing.score_maps import Crop, crop_around, indexed_png, map_names, map_over, scales_for
from verefine_viz.viewer.panels.score_panel import probe_table
from verefine_viz.viewer.scene3d.frame_nodes import clicked_pixel, cloud_colors, cloud_of
from verefine_viz.viewer.snapshot.compared_poses import probe
from verefine_viz.viewer.snapshot.snapshot import EvaluatedPose

PROBLEM = box_problem()
TARGET = PROBLEM.targets[0]
MAPS = FakeVerifier().maps(TARGET, np.asarray(TARGET.instance.T_cam_obj_gt))
TAU_M = 0.02
WHOLE = Crop(0, 0, 80, 60)
V, U = (int(x) for x in np.argwhere(TARGET.instance.mask).mean(axis=0))


def test_a_part_of_a_map_is_that_part_of_the_whole() -> None:
    crop = Crop(10, 5, 50, 45)
    for name in MAP_NAMES:
        whole = WHOLE.images(MAPS, TARGET, TAU_M).rgb(name)
        assert whole.shape == (60, 80, 3)
        assert np.array_equal(crop.images(MAPS, TARGET, TAU_M).rgb(name), whole[5:45, 10:50]), name


def test_over_a_photo_a_map_hides_what_belongs_to_the_score_and_nothing_else() -> None:
    photo = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    for name in MAP_NAMES:
        for maps in (MAPS, replace(MAPS, classes=np.zeros_like(MAPS.classes))):
            whole = WHOLE.images(maps, TARGET, TAU_M).rgb(name)
            shown = map_over(photo, name, maps, TARGET, TAU_M)
            assert np.array_equal(shown, np.where((maps.classes > 0)[..., None], whole, photo)), name


def test_scales_depend_on_the_frame_only() -> None:
    scales = scales_for(TARGET, TAU_M)
    assert scales == scales_for(TARGET, TAU_M)
    assert scales.keys() == set(MAP_NAMES) - {"classes", "observed_colour", "rendered_colour"}
    difference = scales["difference"]
    assert (difference.low, difference.high, difference.unit) == (-40.0, 40.0, "mm")


def test_classes_have_their_own_colours_and_nothing_else() -> None:
    image = WHOLE.images(MAPS, TARGET, TAU_M).rgb("classes")
    assert tuple(image[V, U]) == CLASS_COLORS["explained"]
    assert tuple(image[0, 0]) == EMPTY


@given(
    st.integers(0, 59), st.integers(0, 79), st.integers(1, 59), st.integers(1, 79), st.sampled_from([0.8, 0.95, 1.25])
)
def test_the_crop_holds_the_mask_and_keeps_its_shape(v: int, u: int, h: int, w: int, aspect: float) -> None:
    mask = np.zeros((60, 80), bool)
    mask[v : v + h, u : u + w] = True
    rows, columns = np.nonzero(mask)
    crop = crop_around(mask, aspect)
    assert crop.u0 <= columns.min()
    assert columns.max() < crop.u1
    assert crop.v0 <= rows.min()
    assert rows.max() < crop.v1
    assert crop.width / crop.height == pytest.approx(aspect, rel=0.1)


def test_beyond_the_image_a_crop_is_filled_and_of_an_empty_mask_it_is_the_whole_image() -> None:
    crop = crop_around(np.zeros((60, 80), bool), 1.0)
    assert crop.u0 <= 0 < 80 <= crop.u1
    assert crop.v0 <= 0 < 60 <= crop.v1
    crop = Crop(-10, -10, 10, 10)
    out = crop.of(np.ones((60, 80, 3), np.uint8), 7)
    assert (out[:10] == 7).all()
    assert (out[10:, 10:] == 1).all()
    assert (Crop(200, 200, 210, 210).of(np.ones((60, 80))) == 0).all()


def test_the_probe_gives_the_numbers_of_the_pixel() -> None:
    inside, outside = probe(MAPS, TARGET, U, V), probe(MAPS, TARGET, 0, 0)
    assert inside.observed_m == pytest.approx(float(TARGET.observation.depth_m[V, U]))
    assert inside.rendered_m == pytest.approx(inside.observed_m)
    assert inside.difference_mm == pytest.approx(0.0)
    assert inside.pixel_class == "explained"
    assert inside.contribution == pytest.approx(1 / MAPS.counted.sum())
    assert outside.rendered_m is None
    assert outside.difference_mm is None
    assert outside.pixel_class == "not scored"
    assert outside.contribution == 0.0


def test_the_contributions_of_all_pixels_are_the_score() -> None:
    h, w = TARGET.observation.camera.shape
    total = sum(probe(MAPS, TARGET, u, v).contribution for v in range(h) for u in range(w))
    n = MAPS.counted.sum()
    assert total == pytest.approx((MAPS.f_d[MAPS.counted].sum() + MAPS.f_n[MAPS.counted].sum()) / 2 / n)


@given(st.integers(0, 79), st.integers(0, 59))
def test_a_ray_of_the_sensor_means_its_own_pixel(u: int, v: int) -> None:
    observation = PROBLEM.observation
    camera = observation.camera
    direction = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
    pixel = clicked_pixel(observation, np.zeros(3), direction, None)
    assert pixel == ((u, v) if observation.depth_m[v, u] > 0 else None)
    assert clicked_pixel(observation, np.zeros(3), direction, 0.12) == (u, v)


def test_a_click_from_behind_the_camera_image_still_meets_it() -> None:
    pixel = clicked_pixel(PROBLEM.observation, np.array([0.0, 0, -1.0]), np.array([0.0, 0, 1.0]), 0.12)
    assert pixel == (40, 30)
    assert clicked_pixel(PROBLEM.observation, np.array([0.0, 0, -1.0]), np.array([0.0, 0, -1.0]), 0.12) is None


def test_the_cloud_is_what_was_measured() -> None:
    cloud = cloud_of(PROBLEM.observation)
    depth = PROBLEM.observation.depth_m
    assert len(cloud.points_cam) == (depth > 0).sum()
    assert np.allclose(cloud.points_cam[:, 2], depth[cloud.rows, cloud.columns])


def test_cloud_colours_by_class_only_where_there_is_one() -> None:
    cloud = cloud_of(PROBLEM.observation)
    colors = cloud_colors(cloud, "class", MAPS, TAU_M)
    inside = TARGET.instance.mask[cloud.rows, cloud.columns]
    assert (colors[inside] == CLASS_COLORS["explained"]).all()
    assert not (colors[~inside] == CLASS_COLORS["explained"]).all(axis=1).any()
    assert cloud_colors(cloud, "colour", MAPS, TAU_M) is cloud.natural
    assert cloud_colors(cloud, "residual", None, TAU_M) is cloud.natural


def test_a_cloud_without_a_photo_shows_what_faces_the_camera_brighter() -> None:
    observation = replace(TARGET.observation, rgb=None)
    cloud = cloud_of(observation)
    facing = np.abs(observation.normals_cam[cloud.rows, cloud.columns, 2])
    brightness = cloud.natural.astype(float).mean(axis=1)
    assert brightness[facing > 0.9].min() > brightness[facing < 0.1].max() + 50


def coloured(f_c: float = 0.6) -> ScoreMaps:
    """Maps with those of the colour term."""
    explained = MAPS.classes == 1
    photo = np.random.default_rng(1).integers(0, 256, (60, 80, 3), np.uint8)
    correlation = np.where(explained, np.float32(f_c), np.float32(np.nan))
    drawn = np.where((MAPS.rendered_m > 0)[..., None], 255 - photo, 0).astype(np.uint8)
    return replace(MAPS, observed_rgb=photo, rendered_rgb=drawn, correlation=correlation)


def test_maps_of_colours_show_where_the_model_is_and_have_no_value_elsewhere() -> None:
    images = WHOLE.images(coloured(), TARGET, TAU_M)
    assert (images.indices("observed_colour") > 0).all()
    assert np.array_equal(images.indices("rendered_colour") > 0, MAPS.rendered_m > 0)
    assert np.array_equal(images.indices("correlation") > 0, MAPS.classes == 1)
    for name in COLOUR_MAPS:
        assert not WHOLE.images(MAPS, TARGET, TAU_M).indices(name).any(), "without the term there is nothing"


def test_maps_of_colours_are_listed_only_where_the_term_counts() -> None:
    assert map_names([MAPS, None]) == tuple(name for name in MAP_NAMES if name not in COLOUR_MAPS)
    assert map_names([MAPS, coloured()]) == MAP_NAMES


def test_a_pixel_has_its_colours_and_its_share_of_the_correlation() -> None:
    maps = coloured()
    at = probe(maps, TARGET, U, V, 0.25)
    assert at.correlation == pytest.approx(0.6)
    assert at.observed_rgb == tuple(maps.observed_rgb[V, U])
    assert at.rendered_rgb == tuple(maps.rendered_rgb[V, U])
    assert at.contribution == pytest.approx(0.75 * probe(MAPS, TARGET, U, V).contribution)
    shown = probe_table(("refined", at), ("best", None))
    assert "0.60" in shown
    assert "#{:02x}{:02x}{:02x}".format(*at.observed_rgb) in shown
    away = probe(maps, TARGET, 0, 0, 0.25)
    assert away.correlation is None
    assert away.rendered_rgb is None
    assert "f_c" not in probe_table(("refined", probe(MAPS, TARGET, U, V)), ("best", None))


def test_the_score_s_table_has_the_part_of_colour_only_where_the_term_counts() -> None:
    def pose(**colour: float) -> EvaluatedPose:
        score = PoseScore(0.8, 0.9, 0.7, 100, 100, (100, 0, 0, 0, 0), **colour)  # pyright: ignore[reportArgumentType]
        return EvaluatedPose("refined", np.eye(4), score, None)

    without = score_table(pose(), pose(), "mug")
    with_colour = score_table(pose(colour_fit=0.5, colour_weight=0.2), pose(colour_fit=-0.4, colour_weight=0.2), "mug")
    assert "colour f_c" not in without
    assert "0.500" in with_colour
    assert "0.100" in with_colour
    assert "0.8 × mean of depth fit" in with_colour


IMAGES = arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40)))
PALETTES = st.binary(min_size=768, max_size=768)


@given(IMAGES, PALETTES)
def test_others_read_the_places_and_the_palette(image: NDArray[np.uint8], palette: bytes) -> None:
    with Image.open(io.BytesIO(indexed_png(image, palette))) as read:
        read.verify()
    with Image.open(io.BytesIO(indexed_png(image, palette))) as read:
        assert read.mode == "P"
        np.testing.assert_array_equal(np.asarray(read), image)
        colors = np.frombuffer(palette, np.uint8).reshape(256, 3)
        np.testing.assert_array_equal(np.asarray(read.convert("RGB")), colors[image])


def test_a_smooth_picture_takes_a_fraction_of_its_pixels() -> None:
    image = np.add.outer(np.arange(128), np.arange(256)).astype(np.uint8)
    assert len(indexed_png(image, bytes(768))) < image.size / 20
