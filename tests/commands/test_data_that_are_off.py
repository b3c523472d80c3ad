"""What people have wrong on disk is named with what would fit, whichever way the frame comes in."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.calibration.sizes import real, scene
from verefine_viz.calibration.consistency import TO_OPENGL, data_doubts
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.library.frame_to_solve import Frame as ArrayFrame
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.source import open_scene

pytestmark = pytest.mark.usefixtures("long_run")
YCBV = Path(__file__).resolve().parents[3] / "shared" / "data" / "ycbv"


@dataclass(frozen=True)
class Object:
    """An object as a pipeline has it."""

    name: str
    mesh_mm: trimesh.Trimesh
    mask: Mask
    T_cam_obj: Float


@dataclass(frozen=True)
class Frame:
    """A frame as a pipeline has it, which is written in several layouts."""

    K: Float
    depth_m: Float
    objects: tuple[Object, ...]
    masks_in_alpha: bool = False

    def times(self, mesh: float = 1.0, depth: float | Float = 1.0) -> Frame:
        resized = tuple(
            replace(o, mesh_mm=trimesh.Trimesh(mesh * o.mesh_mm.vertices, o.mesh_mm.faces, process=False))
            for o in self.objects
        )
        return replace(self, objects=resized, depth_m=self.depth_m * depth)

    def posed(self, change: Callable[[Float], Float]) -> Frame:
        return replace(self, objects=tuple(replace(o, T_cam_obj=change(o.T_cam_obj)) for o in self.objects))

    def save_mask(self, k: int, path: Path) -> None:
        mask = self.objects[k].mask.astype(np.uint8) * 255
        white = np.full((*mask.shape, 3), 255, np.uint8)
        Image.fromarray(np.dstack([white, mask]) if self.masks_in_alpha else mask).save(path)

    def save_depth(self, path: Path, step_m: float = 1e-3) -> None:
        Image.fromarray(np.clip(np.round(self.depth_m / step_m), 0, 65535).astype(np.uint16)).save(path)


def frame_of(problem: Problem, first: str = "") -> Frame:
    """The frame with its largest objects; ``first`` is the one that a folder of one object has."""
    sizes = {i.instance_id: int(np.count_nonzero(i.mask)) for i in problem.instances}
    largest = sorted(problem.instances, key=lambda i: -sizes[i.instance_id])[:4]
    largest = sorted(largest, key=lambda i: problem.models[i.obj_id].name != first)[:3]
    objects = []
    for i in largest:
        m = problem.models[i.obj_id]
        assert i.T_cam_obj_gt is not None
        mesh = trimesh.Trimesh(m.vertices * 1e3, m.faces, process=False)
        objects.append(Object(m.name, mesh, np.array(i.mask), i.T_cam_obj_gt))
    return Frame(problem.observation.camera.K, problem.observation.depth_m.astype(np.float64), tuple(objects))


def of_folder(frame: Frame, root: Path) -> tuple[str, ...]:
    """As FoundationPose's demo has it: one object, its mesh in metres."""
    for name in ("depth", "masks", "mesh", "annotated_poses"):
        (root / name).mkdir(parents=True)
    np.savetxt(root / "cam_K.txt", frame.K)
    frame.save_depth(root / "depth" / "1.png")
    frame.save_mask(0, root / "masks" / "1.png")
    one = frame.objects[0]
    trimesh.Trimesh(one.mesh_mm.vertices / 1000, one.mesh_mm.faces, process=False).export(root / "mesh" / "mesh.obj")
    np.savetxt(root / "annotated_poses" / "1.txt", one.T_cam_obj)
    found = open_scene(SceneSettings(source="folder", dataset=str(root)), HypothesesSettings(source="recorded"))
    return data_doubts(found.problem(found.frames[0]))


def of_keep_frame(frame: Frame, root: Path) -> tuple[str, ...]:
    root.mkdir()
    kept = ArrayFrame(frame.K, frame.depth_m)
    for k, one in enumerate(frame.objects):
        path = root / f"{k}.ply"
        one.mesh_mm.export(path)
        kept.add(one.name, path, one.mask, {"net": one.T_cam_obj}, None, 0.001, one.T_cam_obj)
    name = kept.keep(root / "kept")
    return data_doubts(Toolbox(load_session(root / "kept" / "session.toml")).problem(name))


def of_bop(frame: Frame, root: Path) -> tuple[str, ...]:
    """What ``datasets check`` says of a BOP folder."""
    folder = root / "test" / "000001"
    for place in (root / "models", folder / "depth", folder / "mask_visib"):
        place.mkdir(parents=True)
    step_mm = 1.0 if frame.depth_m.max() > 6 else 0.1 if frame.depth_m.max() > 0.1 else 1e-4
    frame.save_depth(folder / "depth" / "000001.png", step_mm * 1e-3)
    truths = []
    for k, one in enumerate(frame.objects):
        one.mesh_mm.export(root / "models" / f"obj_{k + 1:06d}.ply")
        frame.save_mask(k, folder / "mask_visib" / f"000001_{k:06d}.png")
        R, t_mm = one.T_cam_obj[:3, :3].ravel().tolist(), (1e3 * one.T_cam_obj[:3, 3]).tolist()
        truths.append({"obj_id": k + 1, "cam_R_m2c": R, "cam_t_m2c": t_mm})
    camera = {"cam_K": frame.K.ravel().tolist(), "depth_scale": step_mm}
    (folder / "scene_camera.json").write_text(json.dumps({"1": camera}))
    (folder / "scene_gt.json").write_text(json.dumps({"1": truths}))
    parts = check_split(root, "test")
    return tuple(found.advice for found in parts.findings if found.advice)


WAYS = {"folder": of_folder, "keep_frame": of_keep_frame, "bop": of_bop}


def in_8_bits(frame: Frame) -> Frame:
    step_m = 1e-3 * np.ceil(1e3 * frame.depth_m.max() / 255)
    return replace(frame, depth_m=np.round(frame.depth_m / step_m) * step_m)


OFF: dict[str, tuple[Callable[[Frame], Frame], str, str]] = {
    "mesh × 10": (lambda f: f.times(mesh=10), "models that are 10 times smaller", "folder keep_frame bop"),
    "depth × 10": (lambda f: f.times(depth=10), "depth that is 10 times smaller", "folder bop"),
    "K transposed": (lambda f: replace(f, K=f.K.T), "written column by column", "folder keep_frame bop"),
    "K normalised": (
        lambda f: replace(f, K=np.diag([1 / f.depth_m.shape[1], 1 / f.depth_m.shape[0], 1]) @ f.K),
        "it looks normalised",
        "folder keep_frame bop",
    ),
    "255 is background": (
        lambda f: replace(f, objects=tuple(replace(o, mask=~o.mask) for o in f.objects)),
        "inverted",
        "folder keep_frame bop",
    ),
    "8 bits": (in_8_bits, "as if it was stored in 8 bits", "folder keep_frame bop"),
    "OpenGL's axes": (lambda f: f.posed(lambda T: TO_OPENGL @ T), "OpenGL", "folder bop"),
    "OpenGL's axes, kept": (lambda f: f.posed(lambda T: TO_OPENGL @ T), "expected OpenCV's axes", "keep_frame"),
    "depth × 10, kept": (lambda f: f.times(depth=10), "about 0.1 times as much depth would fit", "keep_frame"),
    "depth × 0.001, kept": (lambda f: f.times(depth=0.001), "depth_m has a median of 0.000", "keep_frame"),
    "mesh in cm, kept": (lambda f: f.times(mesh=0.1), "unit_m = 0.001 was given, 0.01 would fit better", "keep_frame"),
}
"""What a user has wrong, what is put into words, and by which ways in; tests/calibration has what else is noticed."""
CASES = [(name, way) for name, (_, _, ways) in OFF.items() for way in ways.split()]


def frames() -> list[Frame]:
    """A built-in frame, and a real one where the data are there; a mug looks like no other when it is turned."""
    return [frame_of(scene("clutter")), *([frame_of(real(YCBV, "0/1"), "025_mug")] if YCBV.is_dir() else [])]


def said(way: str, frame: Frame, root: Path) -> str:
    try:
        return "; ".join(WAYS[way](frame, root))
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("way", WAYS)
def test_right_data_are_not_doubted_and_a_mask_may_be_in_the_alpha_channel(way: str, tmp_path: Path) -> None:
    for k, frame in enumerate(frames()):
        assert said(way, frame, tmp_path / str(k)) == ""
        assert said(way, replace(frame, masks_in_alpha=True), tmp_path / f"{k} alpha") == ""


@pytest.mark.parametrize(("name", "way"), CASES)
def test_what_is_off_is_named_with_what_would_fit(name: str, way: str, tmp_path: Path) -> None:
    spoil, words, _ = OFF[name]
    for k, frame in enumerate(frames()):
        assert words in said(way, spoil(frame), tmp_path / str(k))
