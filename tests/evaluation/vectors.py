"""The official toolkit's numbers on made-up cases (``bop_vectors`` of the shared data), as tests read them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.scenes.test_models import model_info
from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.bop_model import EvalModel, bop_symmetries
from verefine_viz.evaluation.vsd import DepthPatch
from verefine_viz.scenes.meshes import read_geometry


@dataclass(frozen=True)
class Vectors:
    """vectors.json and vectors.npz."""

    folder: Path
    json: dict[str, Any]
    arrays: dict[str, np.ndarray]

    def case(self, name: str) -> dict[str, Any]:
        return next(c for c in self.json["cases"] if c["name"] == name)

    @property
    def rendered(self) -> list[dict[str, Any]]:
        """The cases of a mesh and two poses."""
        return [c for c in self.json["cases"] if c["mesh"] is not None]

    def model(self, case: dict[str, Any]) -> EvalModel:
        return _model(self.folder, case["mesh"])

    def depth_mm(self, case: dict[str, Any]) -> np.ndarray:
        key = case["id"]
        if f"{key}_depth_f32" in self.arrays:
            return self.arrays[f"{key}_depth_f32"]
        return self.arrays[f"{key}_depth_raw"].astype(np.float32) * np.float32(case["depth_scale"])

    def patch(self, case: dict[str, Any], which: str) -> DepthPatch:
        y0, _, x0, _ = self.arrays[f"{case['id']}_box_{which}"].tolist()
        return DepthPatch(x0, y0, self.arrays[f"{case['id']}_depth_{which}"])


@cache
def read(folder: Path) -> Vectors:
    with np.load(folder / "vectors.npz") as arrays:
        return Vectors(folder, json.loads((folder / "vectors.json").read_text()), dict(arrays))


@cache
def _model(folder: Path, mesh: str) -> EvalModel:
    info = model_info(read(folder).json["meshes"][mesh]["models_info"])
    vertices, faces = read_geometry(folder / "meshes" / f"{mesh}.ply")
    return EvalModel(1, vertices, faces, info.diameter, bop_symmetries(info, mesh))


def poses(case: dict[str, Any]) -> tuple[Float, Float, Float, Float]:
    """R_est, t_est, R_gt, t_gt."""
    return (
        np.array(case["R_est"]),
        np.array(case["t_est"], dtype=np.float64),
        np.array(case["R_gt"]),
        np.array(case["t_gt"], dtype=np.float64),
    )
