"""Pose errors against the official toolkit's own numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.evaluation import vectors
from tests.evaluation.vectors import Vectors, poses
from tests.scenes.test_models import model_info
from verefine_viz.evaluation.bop_model import bop_symmetries
from verefine_viz.evaluation.vertex_errors import add_mm, adi_mm, mspd_px, mssd_mm
from verefine_viz.evaluation.vsd import TAUS, model_depth, spheres_overlap_in_image, vsd


@pytest.fixture(scope="module")
def official(shared_data: Path) -> Vectors:
    return vectors.read(shared_data / "bop_vectors")


def test_vsd_of_given_depths_is_the_same_bit_for_bit(official: Vectors) -> None:
    assert official.json["taus"] == TAUS.tolist()
    assert len(official.json["cases"]) == 31
    for case in official.json["cases"]:
        depth_mm, K = official.depth_mm(case), np.array(case["K"], dtype=np.float64)
        estimate, truth = official.patch(case, "est"), official.patch(case, "gt")
        errors = vsd(depth_mm, estimate, truth, K, case["diameter"], case["delta"])
        assert errors.tolist() == case["vsd"], case["name"]


def test_vsd_with_our_renderer(official: Vectors) -> None:
    worst = 0.0
    for case in official.rendered:
        if case.get("renderer_undefined"):
            continue
        errors = rendered_vsd(official, case)
        worst = max(worst, float(np.abs(errors - case["vsd"]).max()))
        np.testing.assert_allclose(errors, case["vsd"], atol=0.003, err_msg=case["name"])
    assert worst > 0  # the official depth buffer has 16 bits, ours has not: they cannot agree in every pixel


def rendered_vsd(official: Vectors, case: dict[str, Any]) -> np.ndarray:
    R_est, t_est, R_gt, t_gt = poses(case)
    model, depth_mm, K = official.model(case), official.depth_mm(case), np.array(case["K"])
    estimate = model_depth(model, R_est, t_est, K, depth_mm.shape)
    truth = model_depth(model, R_gt, t_gt, K, depth_mm.shape)
    return vsd(depth_mm, estimate, truth, K, case["diameter"], case["delta"])


def test_depth_is_the_official_one_but_for_its_16_bits(official: Vectors) -> None:
    for case in official.rendered:
        _, _, R_gt, t_gt = poses(case)
        theirs = official.patch(case, "gt")
        ours = model_depth(official.model(case), R_gt, t_gt, np.array(case["K"]), (case["height"], case["width"]))
        full = np.zeros((2, case["height"], case["width"]), np.float32)
        for image, patch in zip(full, (theirs, ours), strict=True):
            rows, columns = patch.depth_mm.shape
            image[patch.y0 : patch.y0 + rows, patch.x0 : patch.x0 + columns] = patch.depth_mm
        both = (full > 0).all(axis=0)
        assert np.abs(full[0] - full[1])[both].max() < 0.05, case["name"]
        assert ((full[0] > 0) != (full[1] > 0)).sum() <= 2, case["name"]


def test_other_errors(official: Vectors) -> None:
    for case in official.rendered:
        name, model, pose = case["name"], official.model(case), poses(case)
        assert len(model.symmetries_mm) == case["n_syms"], name
        K = np.array(case["K"])
        assert mssd_mm(model, *pose) == pytest.approx(case["mssd"], abs=1e-9, rel=0), name
        assert mspd_px(model, *pose, K) == pytest.approx(case["mspd"], abs=1e-9, rel=1e-12), name
        assert add_mm(model, *pose) == pytest.approx(case["add"], abs=1e-9, rel=0), name
        assert adi_mm(model, *pose) == pytest.approx(case["adi"], abs=1e-9, rel=0), name
        # acos turns the last bit of a cosine near 1 into 1e-6 degrees.
        assert np.linalg.norm(pose[1] - pose[3]) == pytest.approx(case["te_mm"], abs=1e-9, rel=0), name
        overlap = spheres_overlap_in_image(pose[1], pose[3], case["diameter"])
        assert overlap == case["sphere_projections_overlap"], name


def test_symmetries(official: Vectors) -> None:
    for entry in official.json["symmetries"]:
        info = model_info(official.json["meshes"][entry["mesh"]]["models_info"])
        ours = bop_symmetries(info, entry["mesh"], entry["max_sym_disc_step"])
        assert len(ours) == entry["count"]
        np.testing.assert_allclose(ours[:, :3, :3].sum(axis=0), entry["sum_R"], atol=1e-10)
        np.testing.assert_allclose(ours[:, :3, 3].sum(axis=0), entry["sum_t"], atol=1e-9)
        for sample in entry["samples"]:
            np.testing.assert_allclose(ours[sample["index"], :3, :3], sample["R"], atol=1e-12)
            np.testing.assert_allclose(ours[sample["index"], :3, 3], sample["t"], atol=1e-11)
