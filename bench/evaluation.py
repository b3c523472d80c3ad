"""BOP scores: milliseconds per pair of poses, and seconds for a results file, beside the official toolkit's figures.

The toolkit's figures were measured on a machine of this kind (2 cores, software OpenGL), those of distances on models
of 5000 vertices, half of ours. It draws both poses of a pair and compares whole images, and starts 120 processes for
the thresholds of one results file.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import trimesh

from tests.scenes.write_bop import write_bop
from verefine_viz.core.files import decoded_json
from verefine_viz.core.geometry import axis_angle
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.evaluation.bop_model import EvalModel, bop_symmetries
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.evaluation.vertex_errors import adi_by_index_mm, adi_mm, mspd_px, mssd_mm
from verefine_viz.evaluation.vsd import DepthPatch, model_depth, vsd
from verefine_viz.scenes.demo import demo_frames, demo_names, demo_problem
from verefine_viz.scenes.hypothesis_pool import perturbed
from verefine_viz.scenes.models import ModelInfo
from verefine_viz.scenes.results_csv import ResultRow, write_results

REPEATS = 15
N_TARGETS = 31
"""As many as the toolkit's figure was measured with."""

K = np.array([[1066.8, 0.0, 320.0], [0.0, 1067.5, 240.0], [0.0, 0.0, 1.0]])
SHAPE = 480, 640
OFFICIAL_VSD_MS = {1280: 26.0, 5120: 31.0, 20480: 40.0, 81920: 68.0}
OFFICIAL_MSSD_MS = {1: 0.07, 4: 0.3, 315: 32.0, 630: 66.0}
OFFICIAL_MSPD_MS = {1: 0.17, 4: 0.5, 315: 71.0, 630: 135.0}
OFFICIAL_ADI_MS = 5.0
OFFICIAL_SCORING_S = 75.0
"""The fastest of its runs on 31 targets (75 to 150 s)."""

R_GT, T_GT_MM = axis_angle([1, 2, 3], 0.7), np.array([20.0, -15.0, 750.0])
R_EST, T_EST_MM = axis_angle([1, 2, 3], 0.78), np.array([23.0, -13.0, 757.0])
TURN = {"axis": [0, 0, 1], "offset": [0, 0, 0]}
FLIP = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]
FLIPS = [FLIP, [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1], [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]


def run() -> list[dict[str, Any]]:
    """One row per measurement: ours, the official toolkit's, and how many times faster."""
    return [*_vsd_rows(), *_distance_rows(), _scoring_row()]


def _vsd_rows() -> list[dict[str, Any]]:
    rows = []
    background = np.full(SHAPE, 900, np.float32)
    for subdivisions, (n_faces, official) in zip((3, 4, 5, 6), OFFICIAL_VSD_MS.items(), strict=True):
        model = _model(subdivisions, {})
        assert len(model.faces) == n_faces

        def pair(model: EvalModel = model) -> object:
            truth = model_depth(model, R_GT, T_GT_MM, K, SHAPE)
            return vsd(background, model_depth(model, R_EST, T_EST_MM, K, SHAPE), truth, K, model.diameter_mm)

        truth = model_depth(model, R_GT, T_GT_MM, K, SHAPE)

        def estimate_only(model: EvalModel = model, truth: DepthPatch = truth) -> object:
            return vsd(background, model_depth(model, R_EST, T_EST_MM, K, SHAPE), truth, K, model.diameter_mm)

        rows.append(_row(f"VSD, {n_faces} faces, both poses drawn", pair, official))
        rows.append(_row(f"VSD, {n_faces} faces, ground-truth pose kept", estimate_only, official))
    return rows


def _distance_rows() -> list[dict[str, Any]]:
    rows = []
    infos = ({}, {"symmetries_discrete": FLIPS}, {"symmetries_continuous": [TURN]})
    infos = (*infos, {"symmetries_continuous": [TURN], "symmetries_discrete": [FLIP]})
    poses = R_EST, T_EST_MM, R_GT, T_GT_MM
    for info, n in zip(infos, OFFICIAL_MSSD_MS, strict=True):
        model = _model(5, info)
        assert len(model.symmetries_mm) == n
        points = f"{len(model.vertices_mm)} vertices, {n} symmetries"
        rows.append(_row(f"MSSD, {points}", lambda m=model: mssd_mm(m, *poses), OFFICIAL_MSSD_MS[n]))
        rows.append(_row(f"MSPD, {points}", lambda m=model: mspd_px(m, *poses, K), OFFICIAL_MSPD_MS[n]))
    model = _model(5, {})
    rows.append(_row("ADI, 10242 vertices", lambda: adi_mm(model, *poses), OFFICIAL_ADI_MS))
    rows.append(_row("ADI, 10242 vertices, indexed", lambda: adi_by_index_mm(model, *poses), OFFICIAL_ADI_MS))
    return rows


def _scoring_row() -> dict[str, Any]:
    """Everything that ``verefine-viz evaluate`` does, from reading files to the last threshold."""
    with tempfile.TemporaryDirectory() as folder:
        n_targets = _write_data_set(Path(folder))
        files = [Path(folder) / "bench_demo-test.csv"]
        evaluate_files(files, Path(folder) / "demo")
        times_s = []
        for _ in range(3):
            began = process_time()
            evaluate_files(files, Path(folder) / "demo")
            times_s.append(process_time() - began)
    ours = min(times_s)
    # The toolkit's time is mostly that of its processes, which do not depend on the number of targets.
    return {
        "what": f"a results file, {n_targets} targets",
        "ms": 1e3 * ours,
        "official ms": 1e3 * OFFICIAL_SCORING_S,
        "times faster": OFFICIAL_SCORING_S / ours,
    }


def _write_data_set(folder: Path) -> int:
    """Built-in scenes as a BOP folder, and a results file with disturbed poses; the number of its targets."""
    rows, problems, n_targets = [], [], 0
    for name in demo_names():
        for frame in demo_frames(name):
            if n_targets >= N_TARGETS:
                break
            problem = demo_problem(name, SceneSettings(), HypothesesSettings(max_per_object=1), frame)
            problem = replace(problem, scene_id=len(problems))
            problems.append(problem)
            for instance in problem.instances:
                assert instance.T_cam_obj_gt is not None
                n_targets += 1
                T = perturbed(instance.T_cam_obj_gt, 1, 5.0, 5.0, (n_targets,))[0].T_cam_obj
                rows.append(ResultRow(problem.scene_id, problem.im_id, instance.obj_id, 1.0, T))
    write_bop(folder / "demo", problems)
    write_results(folder / "bench_demo-test.csv", rows)
    return n_targets


def _model(subdivisions: int, info: dict[str, Any]) -> EvalModel:
    mesh = trimesh.creation.icosphere(subdivisions, 60.0)
    vertices = np.asarray(mesh.vertices) * [1.0, 0.7, 1.3]
    symmetries = bop_symmetries(decoded_json(json.dumps(info).encode(), ModelInfo), "bench")
    model = EvalModel(1, vertices, np.asarray(mesh.faces, dtype=np.int32), 156.0, symmetries)
    _ = model.sorted_vertices, model.mesh
    return model


def _row(what: str, call: Callable[[], object], official_ms: float) -> dict[str, Any]:
    call()
    times_ms = []
    for _ in range(REPEATS):
        began = process_time()
        call()
        times_ms.append((process_time() - began) * 1e3)
    ours = min(times_ms)
    return {"what": what, "ms": ours, "official ms": official_ms, "times faster": official_ms / ours}
