"""A made-up BOP folder, written without the package's writer: three boxes of two kinds on a table, 80×60 pixels."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools import mask as coco

from tests.fakes import box_problem
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import SceneSource, open_scene

OBJ_IDS = (2, 5, 2)
"""Object of instance 0, 1, 2: left, middle, right."""
POSE = "1 0 0 0 1 0 0 0 1,0 0 600"
"""R and t [mm] of a row of a results file."""


@dataclass(frozen=True)
class Made:
    """The folder and the truth that went into it."""

    root: Path
    scene: Path
    problem: Problem = field(repr=False)
    frame: str

    @property
    def truth(self) -> list[Float]:
        """Ground-truth poses of the instances."""
        return [i.T_cam_obj_gt for i in self.problem.instances if i.T_cam_obj_gt is not None]

    def edit(self, path: str, change: Callable[[Any], None]) -> None:
        """Changes a JSON file, named relative to the scene's folder (or with ../.. to the data set's)."""
        file = self.scene / path
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))

    def open(self, hypotheses: HypothesesSettings | None = None, **scene: Any) -> SceneSource:
        settings = SceneSettings(source="bop", dataset=str(self.root), model_points=200, **scene)
        return open_scene(settings, hypotheses or HypothesesSettings())

    def read(self, hypotheses: HypothesesSettings | None = None, **scene: Any) -> Problem:
        return self.open(hypotheses, **scene).problem(self.frame)


def make(
    root: Path,
    *,
    scene_id: int = 7,
    im_id: int = 3,
    split: str = "test",
    models: str = "models",
    color: str = "rgb",
    suffix: str = ".png",
    depth_scale: float = 0.1,
    targets: bool = True,
) -> Made:
    """Writes the folder; ``color`` is rgb, gray or gray16."""
    problem = box_problem(n_instances=3)
    observation = problem.observation
    scene = root / split / f"{scene_id:06d}"
    for kind in ("rgb", "gray", "depth", "mask", "mask_visib"):
        (scene / kind).mkdir(parents=True)
    stem = f"{im_id:06d}"
    raw = np.round(observation.depth_m.astype(float) * 1e3 / depth_scale).astype(np.uint16)
    Image.fromarray(raw).save(scene / "depth" / f"{stem}.png")
    grey = observation.rgb[..., 0]
    pixels = {"rgb": observation.rgb, "gray": grey, "gray16": grey.astype(np.uint16) * 257}[color]
    Image.fromarray(pixels).save(scene / color.removesuffix("16") / f"{stem}{suffix}")
    gt, info = [], []
    for k, instance in enumerate(problem.instances):
        for kind in ("mask", "mask_visib"):
            Image.fromarray(instance.mask.astype(np.uint8) * 255).save(scene / kind / f"{stem}_{k:06d}.png")
        T = instance.T_cam_obj_gt
        R, t_mm = T[:3, :3].ravel().tolist(), (T[:3, 3] * 1e3).tolist()
        gt.append({"cam_R_m2c": R, "cam_t_m2c": t_mm, "obj_id": OBJ_IDS[k]})
        info.append({"visib_fract": 0.5 + 0.1 * k, "bbox_obj": [0, 0, 1, 1]})
    camera = {"cam_K": observation.camera.K.ravel().tolist(), "depth_scale": depth_scale}
    (scene / "scene_camera.json").write_text(json.dumps({str(im_id): camera}))
    (scene / "scene_gt.json").write_text(json.dumps({str(im_id): gt}))
    (scene / "scene_gt_info.json").write_text(json.dumps({str(im_id): info}))
    if targets:
        entries = [
            {"scene_id": scene_id, "im_id": im_id, "obj_id": obj_id, "inst_count": OBJ_IDS.count(obj_id)}
            for obj_id in sorted(set(OBJ_IDS))
        ]
        (root / "test_targets_bop19.json").write_text(json.dumps(entries))
    (root / models).mkdir()
    for obj_id in (2, 5):
        (root / models / f"obj_{obj_id:06d}.ply").write_text(box_ply(problem))
    model = problem.models[1]
    diameters = {str(i): {"diameter": model.diameter_m * 1e3} for i in (2, 5)}
    (root / models / "models_info.json").write_text(json.dumps(diameters))
    return Made(root, scene, problem, f"{scene_id}/{im_id}")


def box_ply(problem: Problem, unit_m: float = 1e-3) -> str:
    """The box as an ascii PLY."""
    model = problem.models[1]
    vertices = "\n".join(" ".join(f"{x:.9g}" for x in v) for v in model.vertices / unit_m)
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in model.faces)
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(model.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(model.faces)}\nproperty list uchar int vertex_indices\nend_header\n{vertices}\n{faces}\n"
    )


def detections(made: Made, kind: str = "list") -> list[dict[str, Any]]:
    """The three masks as BOP detections; ``kind`` is list, string or box."""
    scene_id, im_id = map(int, made.frame.split("/"))
    ids = {"scene_id": scene_id, "image_id": im_id}
    rest = {"bbox": [0, 0, 1, 1], "time": 0.1}
    entries = []
    for k, instance in enumerate(made.problem.instances):
        segmentation: Any = {}
        if kind == "list":
            segmentation = {"size": [*instance.mask.shape], "counts": run_lengths(instance.mask)}
        elif kind == "string":
            code: Any = coco.encode(np.asfortranarray(instance.mask.astype(np.uint8)))
            segmentation = {"size": [*instance.mask.shape], "counts": code["counts"].decode("ascii")}
        one = {"category_id": OBJ_IDS[k], "score": 0.9 - 0.1 * k, "segmentation": segmentation}
        entries.append({**ids, **one, **rest})
    return entries


def run_lengths(mask: np.ndarray) -> list[int]:
    """COCO's uncompressed run lengths: column by column, the first run counts zeros."""
    runs, value, length = [], False, 0
    for pixel in mask.ravel(order="F"):
        if pixel != value:
            runs.append(length)
            value, length = bool(pixel), 0
        length += 1
    return [*runs, length]


def refusal(made: Made, hypotheses: HypothesesSettings | None = None, **scene: Any) -> str:
    with pytest.raises(VerefineError) as caught:
        made.read(hypotheses, **scene)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 700
    return text


def image(made: Made, name: str, pixels: np.ndarray) -> None:
    Image.fromarray(pixels).save(made.scene / name)


def cut(path: Path, keep: float = 0.5) -> None:
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * keep)])
