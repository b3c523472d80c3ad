"""Errors of single pairs: the quick searches find what a plain search finds, and what is degenerate ends well."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.evaluation import reference
from tests.scenes.test_models import model_info
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle
from verefine_viz.evaluation.bop_model import EvalModel, bop_symmetries
from verefine_viz.evaluation.ground_truth import GtInstance
from verefine_viz.evaluation.vertex_errors import adi_by_index_mm, adi_mm, mspd_px, mssd_mm, symmetric_errors
from verefine_viz.evaluation.vsd import EMPTY, DepthPatch, model_depth, vsd

K = np.array([[600.0, 0.5, 320.0], [0.0, 610.0, 240.0], [0.0, 0.0, 1.0]])
FLIP = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
TURN = {"axis": [0, 0, 1], "offset": [5, -3, 0]}
INFOS = ({}, {"symmetries_discrete": [FLIP]}, {"symmetries_continuous": [TURN]})


def model(seed: int, info: dict, shape: str = "lump") -> EvalModel:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(int(rng.integers(4, 120)), 3)) * [30, 20, 40]
    if shape == "flat":
        vertices[:, 2] = 0
    if shape == "line":
        vertices[:, 1:] = 0
    if shape == "doubled":
        vertices = np.concatenate([vertices, vertices])
    return EvalModel(1, vertices, np.array([[0, 1, 2]], np.int32), 150.0, bop_symmetries(model_info(info), "made up"))


def pose(rng: np.random.Generator, size_rad: float) -> tuple[Float, Float]:
    R = axis_angle(rng.normal(size=3), rng.uniform(0, size_rad))
    return R, np.array([0, 0, 600.0]) + rng.normal(size=3) * 60


@settings(max_examples=60)
@given(
    st.integers(0, 10**6),
    st.sampled_from(INFOS),
    st.sampled_from(["lump", "flat", "line", "doubled"]),
    st.sampled_from([0.0, 0.1, 3.0]),
)
def test_the_quick_search_finds_what_the_plain_one_finds(seed: int, info: dict, shape: str, size_rad: float) -> None:
    rng = np.random.default_rng(seed)
    made = model(seed, info, shape)
    (R, t), (R_gt, t_gt) = pose(rng, size_rad), pose(rng, 3.0)
    if size_rad == 0:
        R, t = R_gt, t_gt
    truth = GtInstance(0, 1, R_gt, t_gt, 1.0)
    assert mssd_mm(made, R, t, R_gt, t_gt) == pytest.approx(reference.mssd(made, R, t, truth), abs=1e-9)
    assert mspd_px(made, R, t, R_gt, t_gt, K) == pytest.approx(reference.mspd(made, R, t, truth, K), abs=1e-8)


def test_equivalent_poses_have_no_error() -> None:
    for info in INFOS:
        made = model(1, info)
        R_gt, t_gt = pose(np.random.default_rng(2), 3.0)
        for S in made.symmetries_mm[:: max(len(made.symmetries_mm) // 7, 1)]:
            pair = R_gt @ S[:3, :3], R_gt @ S[:3, 3] + t_gt, R_gt, t_gt
            assert mssd_mm(made, *pair) < 1e-9, info
            assert mspd_px(made, *pair, K) < 1e-9, info
            assert max(symmetric_errors(made, *pair)) < 1e-6, info


def test_the_least_turned_equivalent_pose_gives_rotation_and_translation() -> None:
    made = model(1, INFOS[1])
    R, t = np.eye(3), np.array([0.0, 0, 500])
    turned = R @ axis_angle([0, 0, 1], np.deg2rad(170.0))
    assert symmetric_errors(made, turned, t + np.array([3, 4, 0]), R, t) == pytest.approx((10.0, 5.0))
    assert symmetric_errors(model(1, {}), turned, t, R, t) == pytest.approx((170.0, 0.0))


@given(st.integers(0, 10**6), st.floats(0, 400))
def test_an_index_finds_the_same_nearest_vertices(seed: int, shift_mm: float) -> None:
    rng = np.random.default_rng(seed)
    made = model(seed % 5, {})
    (R, t), (R_gt, t_gt) = pose(rng, 3.0), pose(rng, 3.0)
    pair = R, t + np.array([shift_mm, 0, 0]), R_gt, t_gt
    assert adi_by_index_mm(made, *pair) == pytest.approx(adi_mm(made, *pair), rel=1e-9)
    rounded = np.round(R, 2), *pair[1:]
    assert adi_by_index_mm(made, *rounded) == pytest.approx(adi_mm(made, *rounded), rel=1e-9)


def test_what_cannot_be_projected_has_an_infinite_error_and_is_not_drawn() -> None:
    made = model(3, INFOS[1])
    R, t = pose(np.random.default_rng(4), 1.0)
    for bad in (np.array([np.nan, 0, 500]), np.array([np.inf, 0, 500])):
        assert mssd_mm(made, R, bad, R, t) == np.inf
        assert mspd_px(made, R, bad, R, t, K) == np.inf
    assert mspd_px(made, np.zeros((3, 3)), np.zeros(3), R, t, K) == np.inf
    R = np.eye(3)
    made = model(5, {})
    assert model_depth(made, R, np.array([0, 0, 10.0]), K, (480, 640)) is EMPTY
    assert model_depth(made, R, np.array([0, 0, -500.0]), K, (480, 640)) is EMPTY
    assert model_depth(made, R, np.array([0, 0, np.nan]), K, (480, 640)) is EMPTY
    assert model_depth(model(5, {}, "flat"), R, np.array([0, 0, 500.0]), K, (480, 640)) is EMPTY
    assert model_depth(made, R, np.array([0, 0, 500.0]), K, (480, 640)).depth_mm.any()


def test_vsd_of_surfaces_that_share_no_pixel_is_1() -> None:
    depth = np.full((40, 50), 900, np.float32)
    here, there = (
        DepthPatch(2, 3, np.full((5, 6), 500, np.float32)),
        DepthPatch(30, 20, np.full((4, 4), 500, np.float32)),
    )
    for one, other in ((here, there), (EMPTY, there), (here, EMPTY), (EMPTY, EMPTY)):
        assert vsd(depth, one, other, K, 100.0).tolist() == [1.0] * 10
    assert vsd(depth, here, here, K, 100.0).tolist() == [0.0] * 10


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_vsd_of_patches_is_vsd_of_whole_images(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = (rng.uniform(480, 520, (30, 40)) * rng.integers(0, 2, (30, 40))).astype(np.float32)

    def patch() -> DepthPatch:
        rows, columns = int(rng.integers(1, 20)), int(rng.integers(1, 20))
        values = (rng.uniform(480, 540, (rows, columns)) * rng.integers(0, 2, (rows, columns))).astype(np.float32)
        return DepthPatch(int(rng.integers(0, 40 - columns)), int(rng.integers(0, 30 - rows)), values)

    a, b = patch(), patch()
    whole = [DepthPatch(0, 0, reference.whole(p, (30, 40)).astype(np.float32)) for p in (a, b)]
    errors = vsd(depth, a, b, K, 100.0)
    assert errors.tolist() == vsd(depth, *whole, K, 100.0).tolist()
    assert (np.diff(errors) <= 0).all()
    assert ((errors >= 0) & (errors <= 1)).all()
