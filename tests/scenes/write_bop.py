"""Problems written out as a BOP folder: models, images, masks, cameras, ground truth and targets.

Reading it back gives the same problems, up to the depth's quantisation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Mask
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.writing import write_json
from verefine_viz.scenes.image_files import write_image
from verefine_viz.scenes.meshes import size_entry
from verefine_viz.scenes.segments import silhouette
from verefine_viz.trace import ply_bytes

TARGET_VISIB_FRACT = 0.1
"""Instances that are less visible are no targets (BOP)."""


def write_bop(folder: Path, problems: Sequence[Problem], split: str = "test", depth_scale_mm: float = 0.1) -> Path:
    """Writes a BOP folder and returns its path.

    Instances are numbered anew in each image. Continuous symmetries were discretised when the models were read; they
    are written as discrete ones. Hypotheses are not part of BOP's layout: write them as a results file.

    Args:
        folder: the data set to make, new or empty.
        problems: frames, each with another (scene_id, im_id), and ground truth for every instance.
        split: name of the split.
        depth_scale_mm: millimetres per step of the 16-bit depth images.
    """
    _write_models(folder / "models", {i: m for problem in problems for i, m in problem.models.items()})
    for scene_id in sorted({p.scene_id for p in problems}):
        scene = folder / split / f"{scene_id:06d}"
        mine = [p for p in problems if p.scene_id == scene_id]
        for kind in ("rgb", "depth", "mask", "mask_visib"):
            (scene / kind).mkdir(parents=True)
        silhouettes = {p.im_id: _write_images(scene, p, depth_scale_mm) for p in mine}
        write_json(scene / "scene_camera.json", {str(p.im_id): _camera(p, depth_scale_mm) for p in mine})
        write_json(scene / "scene_gt.json", {str(p.im_id): [_pose(i) for i in p.instances] for p in mine})
        infos = {str(p.im_id): [*map(_info, p.instances, silhouettes[p.im_id])] for p in mine}
        write_json(scene / "scene_gt_info.json", infos)
    write_json(folder / f"{split.split('_')[0]}_targets_bop19.json", _targets(problems))
    return folder


def _write_models(folder: Path, models: dict[int, ObjectModel]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    info: dict[str, Any] = {}
    for obj_id, model in sorted(models.items()):
        content = ply_bytes(1e3 * model.vertices, model.faces, model.vertex_colors)
        (folder / f"obj_{obj_id:06d}.ply").write_bytes(content)
        entry = size_entry(model.vertices, model.diameter_m)
        if model.is_symmetric:
            in_mm = np.array(model.symmetries[1:])
            in_mm[:, :3, 3] *= 1e3
            entry["symmetries_discrete"] = in_mm.reshape(-1, 16).tolist()
        info[str(obj_id)] = entry
    write_json(folder / "models_info.json", info)
    write_json(folder / "obj_names.json", {str(i): m.name for i, m in sorted(models.items())})


def _write_images(scene: Path, problem: Problem, depth_scale_mm: float) -> list[Mask]:
    """Writes the images of a frame and returns the full silhouette of each instance."""
    observation, stem = problem.observation, f"{problem.im_id:06d}"
    if observation.rgb is not None:
        write_image(scene / "rgb" / f"{stem}.png", observation.rgb)
    steps = np.round(observation.depth_m.astype(np.float64) * 1e3 / depth_scale_mm).astype(np.uint16)
    write_image(scene / "depth" / f"{stem}.png", steps)
    silhouettes = []
    for gt_id, instance in enumerate(problem.instances):
        outline = silhouette(problem.models[instance.obj_id], instance.T_cam_obj_gt, observation.camera)
        full = outline | instance.mask
        silhouettes.append(full)
        write_image(scene / "mask" / f"{stem}_{gt_id:06d}.png", full.astype(np.uint8) * 255)
        write_image(scene / "mask_visib" / f"{stem}_{gt_id:06d}.png", instance.mask.astype(np.uint8) * 255)
    return silhouettes


def _camera(problem: Problem, depth_scale_mm: float) -> dict[str, Any]:
    support = problem.observation.support
    entry: dict[str, Any] = {"cam_K": problem.observation.camera.K.ravel().tolist(), "depth_scale": depth_scale_mm}
    if support is not None:
        R_cam_world = support.T_world_cam[:3, :3].T
        entry["cam_R_w2c"] = R_cam_world.ravel().tolist()
        entry["cam_t_w2c"] = (-R_cam_world @ support.T_world_cam[:3, 3] * 1e3).tolist()
    return entry


def _pose(instance: Instance) -> dict[str, Any]:
    T = instance.T_cam_obj_gt
    R, t_mm = T[:3, :3].ravel().tolist(), (T[:3, 3] * 1e3).tolist()
    return {"cam_R_m2c": R, "cam_t_m2c": t_mm, "obj_id": instance.obj_id}


def _info(instance: Instance, full: Mask) -> dict[str, float]:
    share = instance.mask.sum() / max(int(full.sum()), 1) if instance.visib_fract is None else instance.visib_fract
    return {"visib_fract": float(share)}


def _targets(problems: Sequence[Problem]) -> list[dict[str, int]]:
    entries = []
    for problem in sorted(problems, key=lambda p: (p.scene_id, p.im_id)):
        seen = Counter(
            i.obj_id
            for i in problem.instances
            if (1.0 if i.visib_fract is None else i.visib_fract) >= TARGET_VISIB_FRACT
        )
        for obj_id, count in sorted(seen.items()):
            ids = {"im_id": problem.im_id, "inst_count": count, "obj_id": obj_id, "scene_id": problem.scene_id}
            entries.append(ids)
    return entries
