import numpy as np

from tests.fakes import box_problem
from verefine_viz.observation.observed_frame import segment_cloud

CAMERA = box_problem().observation.camera
DEPTH = box_problem().observation.depth_m
MASK = box_problem().instances[0].mask


def test_all_points_where_they_are_few() -> None:
    cloud = segment_cloud(DEPTH, CAMERA, MASK, 10_000, 0)
    assert np.array_equal(cloud, CAMERA.back_project(DEPTH)[MASK & (DEPTH > 0)])


def test_a_subset_without_repeats_in_reading_order_that_the_seed_decides() -> None:
    everything = segment_cloud(DEPTH, CAMERA, MASK, 10_000, 0)
    some, same, other = (segment_cloud(DEPTH, CAMERA, MASK, 50, seed) for seed in (3, 3, 4))
    assert np.array_equal(some, same)
    assert not np.array_equal(some, other)
    assert some.shape == (50, 3)
    places = [int(np.flatnonzero((everything == p).all(axis=1))[0]) for p in some]
    assert places == sorted(set(places))


def test_pixels_without_depth_are_left_out() -> None:
    depth = DEPTH.copy()
    depth[MASK & (np.mgrid[0:60, 0:80][1] % 2 == 0)] = 0
    cloud = segment_cloud(depth, CAMERA, MASK, 10_000, 0)
    assert len(cloud) == np.count_nonzero(MASK & (depth > 0))
    assert (cloud[:, 2] > 0).all()
    assert segment_cloud(np.zeros_like(DEPTH), CAMERA, MASK, 100, 0).shape == (0, 3)
    assert segment_cloud(DEPTH, CAMERA, np.zeros_like(MASK), 100, 0).shape == (0, 3)
