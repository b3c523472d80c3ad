import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tests.fakes import box_problem
from verefine_viz.core.algorithm_settings import IcpSettings, TricpSettings
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.nearest import NearestIndex
from verefine_viz.refiners.trimmed_icp import TrimmedIcp


def surface_cloud(rng: np.random.Generator, n: int) -> np.ndarray:
    """Points on a box of 100 × 160 × 60 mm."""
    half = np.array([0.05, 0.08, 0.03])
    points = rng.uniform(-1, 1, (n, 3)) * half
    axis = rng.integers(0, 3, n)
    points[np.arange(n), axis] = rng.choice([-1.0, 1.0], n) * half[axis]
    return points


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 700), spread=st.sampled_from([0.001, 0.02, 0.1, 1.0]))
@settings(max_examples=40, deadline=None)
def test_finds_the_neighbours_that_a_kd_tree_finds(seed: int, n: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    cloud = surface_cloud(rng, n)
    queries = surface_cloud(rng, 200) + rng.normal(0, spread, (200, 3))
    distance, index = NearestIndex.build(cloud).query(queries)
    expected, expected_index = cKDTree(cloud).query(queries)
    assert np.allclose(distance, expected, rtol=1e-9, atol=1e-15)
    assert np.array_equal(index, expected_index)


def test_degenerate_clouds() -> None:
    for shape in ("line", "plane", "one point many times", "two clusters"):
        rng = np.random.default_rng(1)
        cloud = rng.normal(size=(300, 3)) * 0.05
        if shape == "line":
            cloud[:, 1:] = 0.0
        elif shape == "plane":
            cloud[:, 2] = 0.01
        elif shape == "one point many times":
            cloud[:] = [0.1, 0.2, 0.3]
        else:
            cloud[150:] += 3.0
        queries = rng.normal(size=(200, 3)) * 0.2
        distance, index = NearestIndex.build(cloud).query(queries)
        assert np.allclose(distance, cKDTree(cloud).query(queries)[0], rtol=1e-9, atol=1e-15), shape
        assert np.allclose(np.linalg.norm(cloud[index] - queries, axis=1), distance, rtol=1e-9, atol=1e-15), shape


def test_queries_at_the_points_themselves_find_them_and_no_queries_nothing() -> None:
    cloud = surface_cloud(np.random.default_rng(2), 2000)
    distance, index = NearestIndex.build(cloud).query(cloud)
    assert np.array_equal(index, np.arange(2000))
    assert not distance.any()
    distance, index = NearestIndex.build(np.zeros((1, 3))).query(np.empty((0, 3)))
    assert distance.shape == index.shape == (0,)


def test_a_model_s_index_is_built_once_whoever_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[int] = []
    build = NearestIndex.build

    def counted(cloud: np.ndarray) -> NearestIndex:
        built.append(len(cloud))
        return build(cloud)

    monkeypatch.setattr(NearestIndex, "build", counted)
    (target,) = box_problem().targets
    T = target.instance.hypotheses[0].T_cam_obj
    for refiner in (Icp(IcpSettings()), TrimmedIcp(TricpSettings())):
        refiner.refine(target, T)
    pose_errors(target.model, T, np.eye(4))
    assert built == [len(target.model.points)]
