"""Frames to label whose objects are known, and labels of them."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.made_up_frames import Thing, frame_of, model, standing
from tests.scenes.write_bop import write_bop
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import SceneSettings
from verefine_viz.labels.label_folder import LabelFolder
from verefine_viz.scenes.labels import Label, State
from verefine_viz.scenes.unlabelled_frames import UnlabelledFrames, unlabelled_frames


def label(instance: int, obj_id: int, T_cam_obj: Float, state: State = "accepted", name: str = "") -> Label:
    return Label(
        instance, obj_id, name or f"object {obj_id}", tuple(np.ravel(T_cam_obj).tolist()), "green", state=state
    )


def problems(n: int = 2) -> list[Problem]:
    """A can before a carton, and both again from elsewhere."""
    made: list[Problem] = []
    for im_id in range(n):
        rng = np.random.default_rng(im_id)
        carton, can = standing(model("carton"), rng, 0.0, 20.0), standing(model("can"), rng, 0.0, 0.0)
        carton[:3, 3] += [0.04, 0.03, 0]
        can[:3, 3] += [-0.02 - 0.01 * im_id, -0.05, 0]
        one = frame_of([Thing(model("carton"), carton), Thing(model("can"), can)], rng)
        rgb = np.full((*one.observation.camera.shape, 3), 90, np.uint8)
        made.append(replace(one, scene_id=3, im_id=im_id, observation=replace(one.observation, rgb=rgb)))
    return made


def labels_of(made: list[Problem], shift_m: float = 0.0) -> dict[str, tuple[Label, ...]]:
    """The true poses as labels, moved along x by as much."""
    off = transform(np.eye(3), [shift_m, 0, 0])
    return {p.frame: tuple(label(i.instance_id, i.obj_id, off @ i.T_cam_obj_gt) for i in p.instances) for p in made}


def bare_dataset(folder: Path, made: list[Problem]) -> Path:
    """The frames in BOP layout as they come from a camera: no ground truth, no masks, no models_info.json."""
    write_bop(folder, made)
    scene = folder / "test" / "000003"
    for kind in ("mask", "mask_visib"):
        shutil.rmtree(scene / kind)
    for name in ("scene_gt.json", "scene_gt_info.json"):
        (scene / name).unlink()
    (folder / "models" / "models_info.json").unlink()
    (folder / "test_targets_bop19.json").unlink()
    return folder


def frames_in(folder: Path, models: Path | None = None) -> UnlabelledFrames:
    scene = SceneSettings(source="labels", dataset=str(folder), models=str(models or ""), model_points=500)
    return unlabelled_frames(scene)


def files_below(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def label_without_end(folder: Path) -> None:
    """Label one frame after the other, and print how many labels are on the disk."""
    with LabelFolder(folder) as labels:
        for k in range(1, 100_000):
            frame = f"1/{k // 20}"
            labels.put(frame, label(labels.next_instance(frame), 1, np.eye(4)))
            print(k, flush=True)


if __name__ == "__main__":
    label_without_end(Path(sys.argv[1]))
