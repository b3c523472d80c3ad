"""Frames written as a BOP folder as most people have them: without ground truth, with detections and an estimator's
poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.calibration.right_variants import off
from tests.scenes.write_bop import write_bop
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, PhysicsSettings, SceneSettings, Session
from verefine_viz.core.writing import write_json
from verefine_viz.scenes.detections import encode_rle
from verefine_viz.scenes.results_csv import ResultRow, write_results


def written_without_truth(
    folder: Path, problem: Problem, depth_scale_mm: float = 0.1, change: Callable[[Float], Float] = lambda T: T
) -> Session:
    """Writes a frame (ground truth of every instance known) and returns a session that opens it.

    Args:
        folder: the data set to make.
        problem: the frame; what is wrong with its depth, camera or models is written as it is.
        depth_scale_mm: of the 16-bit depth images [mm].
        change: what the estimator makes of a pose that is off by 3° and 3 mm.
    """
    write_bop(folder, [problem], depth_scale_mm=depth_scale_mm)
    for name in ("scene_gt.json", "scene_gt_info.json"):
        (folder / "test" / f"{problem.scene_id:06d}" / name).unlink()
    ids = {"scene_id": problem.scene_id, "image_id": problem.im_id}
    masks = [
        {**ids, "category_id": i.obj_id, "score": 0.9 - 0.01 * k, "bbox": [0, 0, 1, 1], "time": 0.1,
         "segmentation": encode_rle(i.mask)}
        for k, i in enumerate(problem.instances)
    ]  # fmt: skip
    write_json(folder / "detections.json", masks)
    disturb = off(np.random.default_rng(0), 3, 3)
    rows = [
        ResultRow(problem.scene_id, problem.im_id, i.obj_id, 0.9, change(disturb(np.array(i.T_cam_obj_gt))), 0.1)
        for i in problem.instances
    ]
    write_results(folder / "net_made-test.csv", rows)
    return Session(
        scene=SceneSettings(source="bop", dataset=str(folder), masks=str(folder / "detections.json")),
        hypotheses=HypothesesSettings(source="results", files=(str(folder / "net_made-test.csv"),)),
        method=MethodSettings(name="rir", refiner="icp", iterations=2),
        physics=PhysicsSettings(collider="hull", steps=3),
    )
