"""Masks of objects at known poses: what is visible of each, and how that is counted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.fakes import BOX_M, box_model
from tests.made_up_frames import CAMERA, model
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Placed
from verefine_viz.evaluation.instance_masks import instance_masks
from verefine_viz.evaluation.vsd import DELTA_MM, seen
from verefine_viz.rendering.rendered_scene import render_scene
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.segments import overlap, silhouette


def at(x: float, y: float, z: float) -> np.ndarray:
    return transform(np.eye(3), [x, y, z])


def test_masks_are_the_rendered_ones_and_the_foremost_has_the_pixel() -> None:
    placed = [
        Placed(0, model("carton"), at(0, 0, 0.6)),
        Placed(1, model("can"), at(0.03, 0, 0.52)),
        Placed(2, model("can"), at(5, 0, 0.5)),
    ]
    drawn = render_scene(placed, CAMERA)
    masks = instance_masks(placed, drawn.depth_m, CAMERA)
    for k, (one, mask) in enumerate(zip(placed, masks, strict=True)):
        np.testing.assert_array_equal(mask.whole, silhouette(one.model, one.T_cam_obj, CAMERA))
        np.testing.assert_array_equal(mask.visible, drawn.labels == k)
        assert mask.info["px_count_visib"] == np.count_nonzero(drawn.labels == k)
    assert masks[0].info["visib_fract"] < 0.9 < masks[1].info["visib_fract"]
    assert masks[2].info == {
        "bbox_obj": [-1] * 4,
        "bbox_visib": [-1] * 4,
        "px_count_all": 0,
        "px_count_valid": 0,
        "px_count_visib": 0,
        "visib_fract": 0.0,
    }


def test_a_box_that_is_cut_off_is_counted_outside_of_the_image_as_well() -> None:
    z = 0.8
    x = -CAMERA.cx / CAMERA.fx * (z - BOX_M[2] / 2)  # The middle of its front is in the first column.
    corners = CAMERA.project(
        np.array([x, 0, z]) + BOX_M / 2 * [[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    )
    depth_m = np.zeros(CAMERA.shape, np.float32)
    depth_m[:, 5:] = 0.5  # Something hides it there.
    (mask,) = instance_masks([Placed(0, box_model(), at(x, 0, z))], depth_m, CAMERA)
    left, top, width, height = mask.info["bbox_obj"]
    expected = [*corners.min(axis=0), *corners.max(axis=0)]
    assert np.abs(np.array([left, top, left + width, top + height]) - expected).max() <= 1
    assert left < 0
    assert mask.info["bbox_visib"] == [0, top, 4, height]  # As the toolkit counts, five columns are 4 wide.
    assert mask.info["px_count_visib"] == 5 * (height + 1)
    assert 0.8 < mask.info["px_count_all"] / ((width + 1) * (height + 1)) < 1
    assert mask.info["visib_fract"] == mask.info["px_count_visib"] / mask.info["px_count_all"]
    inside = np.count_nonzero(mask.whole)
    assert mask.info["px_count_valid"] == inside - 5 * (height + 1)


def test_a_surface_is_visible_up_to_15_mm_behind_the_measured_one() -> None:
    K = np.array([[500.0, 0, 2], [0, 500, 0], [0, 0, 1]])
    depth_mm = np.array([[0, 1000, 1000, 1000, 1000]], np.float32)
    drawn_mm = np.array([[900, 1014.9, 1015.1, 500, 0]], np.float32)
    assert seen(depth_mm, drawn_mm, K).tolist() == [[True, True, False, True, False]]
    assert DELTA_MM == 15


def test_real_frames_are_as_near_as_is_stated(shared_data: Path) -> None:
    """docs/methods.md 9.4: whole masks, boxes and counts to the pixel, visible ones nearly."""
    dataset = BopDataset(shared_data / "ycbv", "test")
    overlaps: list[float] = []
    shares_off: list[float] = []
    for ids in dataset.frames:
        image, truths = dataset.image(*ids), dataset.ground_truth(*ids) or ()
        infos = json.loads(dataset.files(ids[0]).json("scene_gt_info").read_text())[str(ids[1])]
        placed = [Placed(gt.gt_id, dataset.models.get(gt.obj_id), gt.T_cam_obj) for gt in truths]
        for mask, gt, info in zip(instance_masks(placed, image.depth_m, image.camera), truths, infos, strict=True):
            whole, visible = (dataset.mask(*ids, gt.gt_id, k, image.camera.shape) for k in ("mask", "mask_visib"))
            np.testing.assert_array_equal(mask.whole, whole)
            for key in ("bbox_obj", "px_count_all", "px_count_valid"):
                assert mask.info[key] == info[key], (ids, gt.gt_id, key)
            overlaps.append(overlap(mask.visible, visible))
            shares_off.append(abs(mask.info["visib_fract"] - info["visib_fract"]))
    assert len(overlaps) == 28
    assert min(overlaps) > 0.90
    assert np.median(overlaps) > 0.985
    assert np.median(shares_off) < 0.006
    assert max(shares_off) < 0.10
