"""A sequence in FoundationPose's layout, opened: ``python -m bench.moving_camera OUT [--dataset YCBV]``.

Made up: the cereal box of the clutter scene under a camera that moves around it, poses with the noise of a tracker,
turned over in the middle third, depth that drops out in some frames. Or the frames of a scene of a data set in BOP
layout, their ground truth as poses, the third turned over. Then the strip of frames and clicks on it are timed.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from bench.__main__ import table
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.page.answers_to_wants import SequenceAnswer
from verefine_viz.page.protocol import Open, SequenceWanted
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.sequence import sequence
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.data_folder import data_at
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_layout import Viewpoint, settled, take_picture
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.demo_scenes import SCENES
from verefine_viz.scenes.sensor import sense
from verefine_viz.scenes.source import open_scene

T = TypeVar("T")
OBJECT = "cereal"
CAMERA = Camera(np.array([[285.0, 0, 159.5], [0, 285.0, 119.5], [0, 0, 1]]), 320, 240)
NOISE_M, NOISE_DEG = 0.001, 0.5
N_CLICKS = 12


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame of the sequence."""

    depth_m: NDArray[np.float32]
    rgb: NDArray[np.uint8] | None
    mask: Mask
    T_cam_obj: Float
    """The program's pose."""


def made_up(n: int) -> tuple[Camera, ObjectModel, Iterator[Shot]]:
    """``n`` frames of the clutter scene."""
    scene = SCENES["clutter"]
    models = [demo_model(item.model, 2000, 0) for item in scene.items]
    poses = settled(scene.items)
    k = next(k for k, item in enumerate(scene.items) if item.model == OBJECT)
    turn = flips(near_symmetries(models[k]))[0]

    def shots() -> Iterator[Shot]:
        rng = np.random.default_rng(0)
        for i in range(n):
            share = i / max(n - 1, 1)
            view = Viewpoint(-60 + 120 * share, 32 + 8 * np.sin(6 * share), 0.85 + 0.1 * np.sin(9 * share))
            T_cam_world = inverse(view.T_world_cam)
            placed = [Placed(j, m, T_cam_world @ T) for j, (m, T) in enumerate(zip(models, poses, strict=True))]
            seen = take_picture(placed, view.T_world_cam, CAMERA)
            depth_m = sense(seen.depth_m, seen.normals_cam, CAMERA, i)
            mask = seen.labels == k
            if i % 40 >= 34:  # The sensor loses most of the object.
                depth_m = np.where(mask & (rng.uniform(size=mask.shape) < 0.8), np.float32(0), depth_m)
            R = axis_angle(random_unit_vector(rng), np.radians(NOISE_DEG) * rng.normal())
            T = placed[k].T_cam_obj @ transform(R, NOISE_M * rng.normal(size=3))
            yield Shot(depth_m, seen.rgb, mask, T @ turn if n // 3 <= i < 2 * n // 3 else T)

    return CAMERA, models[k], shots()


def of_data_set(dataset: Path, scene_id: int, obj_id: int) -> tuple[Camera, ObjectModel, Iterator[Shot]]:
    """An object in all frames of a scene, turned over in the third."""
    source = open_scene(SceneSettings(source="bop", dataset=str(dataset), objects=(obj_id,)), HypothesesSettings())
    frames = [frame for frame in source.frames if frame.startswith(f"{scene_id}/")]
    first = source.problem(frames[0])
    model = first.models[obj_id]
    turn = flips(near_symmetries(model))[0]

    def shots() -> Iterator[Shot]:
        for k, frame in enumerate(frames):
            problem = source.problem(frame)
            T = problem.instances[0].T_cam_obj_gt
            assert T is not None
            seen = problem.observation
            yield Shot(seen.depth_m, seen.rgb, problem.instances[0].mask, T @ turn if k == 2 else T)

    return first.observation.camera, model, shots()


def write(folder: Path, camera: Camera, model: ObjectModel, shots: Iterator[Shot]) -> None:
    """In FoundationPose's layout: metres in poses and mesh, millimetres in depth."""
    for name in ("rgb", "depth", "masks", "ob_in_cam", "mesh"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    np.savetxt(folder / "cam_K.txt", camera.K)
    mesh = trimesh.Trimesh(model.vertices, model.faces, vertex_colors=model.vertex_colors, process=False)
    mesh.export(folder / "mesh" / "textured.ply")
    for k, shot in enumerate(shots, 1):
        name = f"{k:06d}"
        Image.fromarray(np.round(1e3 * shot.depth_m).astype(np.uint16)).save(folder / "depth" / f"{name}.png")
        Image.fromarray(shot.mask.astype(np.uint8) * 255).save(folder / "masks" / f"{name}.png")
        np.savetxt(folder / "ob_in_cam" / f"{name}.txt", shot.T_cam_obj)
        if shot.rgb is not None:
            Image.fromarray(shot.rgb).save(folder / "rgb" / f"{name}.png")


def measured(folder: Path) -> list[dict[str, object]]:
    """Open the folder as the page does, and time the timeline and a click on it, without drawing in a browser."""
    known = data_at(folder, {})
    assert known is not None
    Console().print(known.what)
    debugger, opening = _timed(lambda: Debugger(Workspace(known.session, None, Toolbox)))
    space = debugger.space

    def timeline() -> SequenceAnswer:
        return sequence(space, SequenceWanted(), debugger.blobs)

    shown, first = _timed(timeline)
    again = [_timed(timeline)[1] for _ in range(N_CLICKS)]
    rows: list[dict[str, object]] = [
        {"what": "opening the folder", "ms": opening},
        {"what": f"the timeline, with {len(shown.frames)} poses read", "ms": first},
        {"what": "the timeline again", "ms": statistics.median(again)},
    ]
    clicks = []
    for frame in shown.frames[1 :: max(len(shown.frames) // N_CLICKS, 1)]:
        verbs = [Open(frame=frame)]
        clicks.append(_timed(lambda verbs=verbs: debugger.carry_out(verbs))[1])
    marked = [f"{shown.frames[mark.frame]} {mark.kind}" for mark in shown.marks]
    Console().print(f"marked: {', '.join(marked)}")
    return [*rows, {"what": "a click: the frame open, its recorded steps read", "ms": statistics.median(clicks)}]


def _timed(call: Callable[[], T]) -> tuple[T, float]:
    started = time.perf_counter()
    return call(), 1e3 * (time.perf_counter() - started)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--scene", type=int, default=0)
    parser.add_argument("--object", type=int, default=8)
    given = parser.parse_args()
    if not (given.out / "cam_K.txt").exists():
        made = of_data_set(given.dataset, given.scene, given.object) if given.dataset else made_up(given.frames)
        write(given.out, *made)
    started_s = time.perf_counter()
    Console(highlight=False).print(table("a sequence", measured(given.out), time.perf_counter() - started_s))
