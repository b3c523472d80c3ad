"""A frame as a pipeline has it in memory, the ways in which it reaches the program, and mistakes that people make."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from tests.calibration.sizes import transposed
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.library.frame_to_solve import Frame as ArrayFrame
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.detections import encode_rle
from verefine_viz.scenes.results_csv import ResultRow, write_results
from verefine_viz.scenes.source import open_scene
from verefine_viz.trace import Trace


@dataclass(frozen=True)
class Object:
    """An object as a pipeline has it."""

    name: str
    mesh_mm: trimesh.Trimesh
    mask: NDArray[np.bool_] | NDArray[np.uint8]
    """(H, W)."""
    truth: Float | None
    """T_cam_obj (4, 4) [m]."""
    initial: Float | None
    """T_cam_obj of an estimator."""


@dataclass(frozen=True)
class Frame:
    """A frame as a pipeline has it, which is written in several layouts."""

    K: Float
    depth_m: Float
    rgb: NDArray[np.uint8] | None
    objects: tuple[Object, ...]
    masks_in_alpha: bool = False

    def times(self, mesh: float = 1.0, depth: float | Float = 1.0) -> Frame:
        resized = tuple(
            replace(o, mesh_mm=trimesh.Trimesh(mesh * o.mesh_mm.vertices, o.mesh_mm.faces, process=False))
            for o in self.objects
        )
        return replace(self, objects=resized, depth_m=self.depth_m * depth)

    def with_objects(self, change: Callable[[Object], Object]) -> Frame:
        return replace(self, objects=tuple(map(change, self.objects)))

    def posed(self, change: Callable[[Float], Float]) -> Frame:
        """All poses are others."""
        return self.with_objects(
            lambda o: replace(
                o,
                truth=None if o.truth is None else change(o.truth),
                initial=None if o.initial is None else change(o.initial),
            )
        )

    def without_truth(self) -> Frame:
        return self.with_objects(lambda o: replace(o, truth=None))

    def save_mask(self, k: int, path: Path) -> None:
        mask = self.objects[k].mask
        steps = mask.astype(np.uint8) * (255 if mask.dtype == np.bool_ else 1)
        white = np.full((*steps.shape, 3), 255, np.uint8)
        Image.fromarray(np.dstack([white, steps]) if self.masks_in_alpha else steps).save(path)

    def save_depth(self, path: Path, step_m: float = 1e-3) -> None:
        Image.fromarray(np.clip(np.round(self.depth_m / step_m), 0, 65535).astype(np.uint16)).save(path)

    def save_photo(self, path: Path) -> None:
        if self.rgb is not None:
            path.parent.mkdir(exist_ok=True)
            Image.fromarray(self.rgb).save(path)


def frame_of(problem: Problem, most: int = 3, first: str = "") -> Frame:
    """A frame with ground truth and, where it has any, the first initial poses; of its objects those with the largest
    masks, ``first`` before others, which a folder of one object has.
    """
    largest = sorted(problem.instances, key=lambda i: -int(np.count_nonzero(i.mask)))[: most + 1]
    largest = sorted(largest, key=lambda i: problem.models[i.obj_id].name != first)[:most]
    objects = []
    for i in largest:
        m = problem.models[i.obj_id]
        mesh = trimesh.Trimesh(m.vertices * 1e3, m.faces, process=False)
        initial = i.hypotheses[0].T_cam_obj if i.hypotheses else None
        objects.append(Object(m.name, mesh, np.array(i.mask), i.T_cam_obj_gt, initial))
    seen = problem.observation
    return Frame(seen.camera.K, seen.depth_m.astype(np.float64), seen.rgb, tuple(objects))


def first_problem(folder: Path) -> Problem:
    found = open_scene(SceneSettings(source="folder", dataset=str(folder)), HypothesesSettings(source="recorded"))
    return found.problem(found.frames[0])


def of_folder(frame: Frame, root: Path) -> Problem:
    """As FoundationPose's demo has it: one object, its mesh in metres."""
    for name in ("depth", "masks", "mesh", "annotated_poses", "ob_in_cam"):
        (root / name).mkdir(parents=True)
    np.savetxt(root / "cam_K.txt", frame.K)
    frame.save_depth(root / "depth" / "1.png")
    frame.save_photo(root / "rgb" / "1.png")
    frame.save_mask(0, root / "masks" / "1.png")
    one = frame.objects[0]
    trimesh.Trimesh(one.mesh_mm.vertices / 1000, one.mesh_mm.faces, process=False).export(root / "mesh" / "mesh.obj")
    for name, pose in (("annotated_poses", one.truth), ("ob_in_cam", one.initial)):
        if pose is not None:
            np.savetxt(root / name / "1.txt", pose)
    return first_problem(root)


def of_trace(frame: Frame, root: Path) -> Problem:
    """As a program wrote it down while it solved the frame."""
    root.mkdir(parents=True)
    with Trace(root / "trace", K=frame.K, depth_m=frame.depth_m.astype(np.float32), rgb=frame.rgb) as trace:
        for one in frame.objects:
            path = root / f"{one.name}.ply"
            one.mesh_mm.export(path)
            traced = trace.object(one.name, mesh=path, mask=one.mask, unit_m=0.001, truth=one.truth)
            if one.initial is not None:
                traced.hypothesis(0, one.initial)
    return first_problem(root / "trace")


def in_memory(frame: Frame, root: Path) -> ArrayFrame:
    root.mkdir(parents=True)
    given = ArrayFrame(frame.K, frame.depth_m, frame.rgb)
    for one in frame.objects:
        path = root / f"{one.name}.ply"
        one.mesh_mm.export(path)
        poses = None if one.initial is None else {"net": one.initial}
        given.add(one.name, path, one.mask, poses, None, 0.001, one.truth)
    return given


def of_kept_frame(frame: Frame, root: Path) -> Problem:
    """As ``keep_frame`` writes it."""
    name = in_memory(frame, root).keep(root / "kept")
    return Toolbox(load_session(root / "kept" / "session.toml")).problem(name)


def of_library(frame: Frame, root: Path) -> Problem:
    return in_memory(frame, root).problem()


def write_bop_folder(frame: Frame, root: Path) -> None:
    """A BOP data set: masks beside ground truth, else in a detections file; initial poses in a results file."""
    folder = root / "test" / "000001"
    for place in (root / "models", folder / "depth", folder / "mask_visib"):
        place.mkdir(parents=True)
    step_mm = 1.0 if frame.depth_m.max() > 6 else 0.1 if frame.depth_m.max() > 0.1 else 1e-4
    frame.save_depth(folder / "depth" / "000001.png", step_mm * 1e-3)
    frame.save_photo(folder / "rgb" / "000001.png")
    truths, detections, rows = [], [], []
    for k, one in enumerate(frame.objects):
        one.mesh_mm.export(root / "models" / f"obj_{k + 1:06d}.ply")
        frame.save_mask(k, folder / "mask_visib" / f"000001_{k:06d}.png")
        if one.truth is not None:
            R, t_mm = one.truth[:3, :3].ravel().tolist(), (1e3 * one.truth[:3, 3]).tolist()
            truths.append({"obj_id": k + 1, "cam_R_m2c": R, "cam_t_m2c": t_mm})
        ids = {"scene_id": 1, "image_id": 1, "category_id": k + 1, "score": 1.0}
        detections.append({**ids, "segmentation": encode_rle(np.asarray(one.mask != 0))})
        if one.initial is not None:
            rows.append(ResultRow(1, 1, k + 1, 1.0, one.initial))
    camera = {"cam_K": frame.K.ravel().tolist(), "depth_scale": step_mm}
    (folder / "scene_camera.json").write_text(json.dumps({"1": camera}))
    if truths:
        (folder / "scene_gt.json").write_text(json.dumps({"1": truths}))
    else:
        (root / "detections.json").write_text(json.dumps(detections))
    if rows:
        write_results(root / "net_made-test.csv", rows)


def of_bop(frame: Frame, root: Path) -> Problem:
    """As the page opens it."""
    write_bop_folder(frame, root)
    has_truth = (root / "test" / "000001" / "scene_gt.json").is_file()
    scene = {"source": "bop", "dataset": str(root), "split": "test"}
    if not has_truth:
        scene["masks"] = str(root / "detections.json")
    results = [*map(str, root.glob("*.csv"))]
    hypotheses = {"source": "results", "files": results} if results else {"source": "perturb"}
    session = load_session(None, {"scene": scene, "hypotheses": hypotheses}, "settings")
    return Toolbox(session).problem("1/1")


WAYS: dict[str, Callable[[Frame, Path], Problem]] = {
    "bop": of_bop,
    "trace": of_trace,
    "kept frame": of_kept_frame,
    "folder": of_folder,
    "library": of_library,
}
"""What a frame is read as by the way in which it comes, through a new folder; "folder" is FoundationPose's."""


def read(way: str, frame: Frame, root: Path) -> tuple[str, str]:
    """What is noted of a frame, and what is doubted of it, or why it is refused."""
    try:
        seen = WAYS[way](frame, root)
    except (InputError, ValueError) as error:  # A trace raises what numpy would.
        return "", str(error)
    return "; ".join(seen.notes), "; ".join(texts_of(data_doubts(seen)))


def initially_transposed(frame: Frame) -> Frame:
    """Rotations of initial poses are written column by column."""
    return frame.with_objects(lambda o: replace(o, initial=None if o.initial is None else transposed(o.initial)))


def with_all_masks(frame: Frame) -> Frame:
    """Each mask is of all objects."""
    union = np.any([one.mask for one in frame.objects], axis=0)
    return frame.with_objects(lambda o: replace(o, mask=union))


def with_labels(frame: Frame) -> Frame:
    """Each mask is an image of all labels."""
    labels = np.zeros(frame.depth_m.shape, np.uint8)
    for k, one in enumerate(frame.objects, 1):
        labels[one.mask != 0] = k
    return frame.with_objects(lambda o: replace(o, mask=labels))


def with_K(factor: float, of_image: bool) -> Callable[[Frame], Frame]:
    """Intrinsics of another camera, or of images of another size."""
    scale = np.diag([factor, factor, 1.0]) if of_image else np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    return lambda frame: replace(frame, K=scale @ frame.K if of_image else scale * frame.K)


def mirrored(frame: Frame) -> Frame:
    """The photo is mirrored left to right."""
    rgb = None if frame.rgb is None else np.ascontiguousarray(frame.rgb[:, ::-1])
    return replace(frame, rgb=rgb)


NOTHING_SINGLE = ("no other unit or convention would fit", "none would fit")
"""What a doubt says that names nothing."""
OF_DEPTH = ("depth_scale", "as much depth would fit", "depth that is", "depth_m has a median")
MISTAKES: dict[str, tuple[Callable[[Frame], Frame], tuple[str, ...]]] = {
    **{f"depth × {f:g}": (lambda frame, f=f: frame.times(depth=f), OF_DEPTH) for f in (1.25, 0.8, 4.0, 39.37)},
    "K × 0.63": (with_K(0.63, of_image=False), ("fx and fy of cam_K", "of another K")),
    "K of half the size": (with_K(0.5, of_image=True), ("images of another size", "of another K")),
    "K of twice the size": (with_K(2.0, of_image=True), ("images of another size", "of another K", "of this size")),
    "depth 25 px beside": (lambda f: replace(f, depth_m=np.roll(f.depth_m, 25, axis=1)), ("depth lies",)),
    "photo mirrored": (mirrored, ("mirrored",)),
    "initial poses transposed": (initially_transposed, ("transposed",)),
    "label images as masks": (with_labels, ("labels (", "(labels)")),
    "masks of all objects": (with_all_masks, ("(labels)",)),
}
"""What a user has wrong, and what names it, in one of these ways."""
