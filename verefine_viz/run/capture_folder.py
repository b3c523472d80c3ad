"""The folder of kept frames: BOP layout, detections, results files, and a session over all of it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, one_line
from verefine_viz.core.files import id_of, read_json
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.writing import atomic, check_no_link, make_inside, wait_for_lock, write_json
from verefine_viz.run.session_file import CAPTURE_HEAD, SCENE_ID, scene_folder
from verefine_viz.scenes.bop_entries import FARTHEST_M, camera_entry, depth_image, model_file, truth_entry
from verefine_viz.scenes.detections import encode_rle
from verefine_viz.scenes.image_files import read_color, write_image
from verefine_viz.scenes.meshes import Mesh, size_entry
from verefine_viz.scenes.results_csv import ResultRow, read_results, write_results

SESSION, DETECTIONS, ORDERS, NAMES = "session.toml", "detections.json", "orders.json", "obj_names.json"
LOCK = ".lock"
RESULTS = "*_kept-test.csv"


@dataclass(frozen=True, eq=False)
class CapturedObject:
    """An object of a frame, its arrays checked."""

    name: str
    mesh: Mesh
    mask: Mask
    poses: Mapping[str, Sequence[Float]]
    """(4, 4) each [m], by estimator, best first."""
    T_cam_obj_gt: Float | None
    symmetry_axis: Float | None
    """(3,) of any length, through the middle of the mesh's box."""


@dataclass(frozen=True, eq=False)
class CapturedFrame:
    """A frame, its arrays checked."""

    K: Float
    depth_m: Float
    """(H, W) [m], 0 where nothing was measured, at most ``FARTHEST_M``."""
    rgb: NDArray[np.uint8] | None
    objects: Sequence[CapturedObject]
    down_cam: Float | None
    """(3,) where things fall, of any length."""
    order: Sequence[Sequence[int]] = ()
    """Clusters in the order to solve them, as indices into ``objects``; none = by a rule."""


def captured(problem: Problem) -> CapturedFrame:
    """A frame that was read from somewhere else."""
    observation = problem.observation
    support = observation.support
    is_given = support is not None and support.gravity_source == "given"
    down = -support.T_world_cam[2, :3] if support is not None and is_given else None
    objects = [_captured_object(target) for target in problem.targets]
    depth_m = np.where(observation.depth_m > FARTHEST_M, 0.0, observation.depth_m.astype(np.float64))
    place = {target.instance.instance_id: k for k, target in enumerate(problem.targets)}
    order = [[place[i] for i in cluster] for cluster in problem.order]
    return CapturedFrame(observation.camera.K, depth_m, observation.rgb, objects, down, order)


def _captured_object(target: Target) -> CapturedObject:
    """With its initial poses by what estimated them, and the last one recorded, which another program answered with."""
    model, instance = target.model, target.instance
    mesh = Mesh(model.vertices, model.faces, model.vertex_colors, (), model.texture)
    poses: dict[str, list[Float]] = {}
    for hypothesis in instance.hypotheses:
        poses.setdefault(re.sub(r"[^\w.+-]+", "_", hypothesis.source) or "recorded", []).append(hypothesis.T_cam_obj)
    last = instance.recorded[-1].T_cam_obj if instance.recorded else None
    if last is not None and not (instance.hypotheses and np.array_equal(last, instance.hypotheses[0].T_cam_obj)):
        poses["recorded_answer"] = [last]
    return CapturedObject(model.name, mesh, instance.mask, poses, instance.T_cam_obj_gt, None)


def _info_entry(one: CapturedObject) -> dict[str, Any]:
    """Entry of an object in ``models_info.json``."""
    entry = size_entry(one.mesh.vertices_m, one.mesh.diameter_m)
    if one.symmetry_axis is not None:
        low, high = one.mesh.vertices_m.min(axis=0), one.mesh.vertices_m.max(axis=0)
        axis = one.symmetry_axis / np.linalg.norm(one.symmetry_axis)
        entry["symmetries_continuous"] = [{"axis": axis.tolist(), "offset": (500 * (low + high)).tolist()}]
    return entry


class CaptureFolder:
    """Frames are numbered from 1, objects by the order in which their names came.

    Args:
        folder: is made with the first frame.
        is_sequence: its frames are those of a video, in order.

    Raises:
        InputError: it holds something else.
    """

    def __init__(self, folder: Path, is_sequence: bool = False) -> None:
        self._folder, self._is_sequence = folder, is_sequence
        self._scene = scene_folder(folder)
        self._cameras, self._gt_entries = self._scene / "scene_camera.json", self._scene / "scene_gt.json"
        if folder.exists() and not self._is_ours():
            raise InputError(f"{folder} holds something else; choose a new folder, or one that frames were kept in")
        self._names: dict[str, str] = _json_or({}, folder / NAMES)

    def add(self, frame: CapturedFrame) -> str:
        """Adds a frame and returns its name.

        Raises:
            InputError: an object has another mesh than the one of its name before, or the disk refuses. The frame is
                then not there.
        """
        self._new_models(frame.objects)  # refuses before anything is written
        with self._locked():
            self._begin()
            self._names = _json_or({}, self._folder / NAMES)
            return self._add(frame, self._new_models(frame.objects))

    def _add(self, frame: CapturedFrame, new: Mapping[int, CapturedObject]) -> str:
        cameras = _json_or({}, self._cameras)
        number = 1 + max((id_of(key) or 0 for key in cameras), default=0)
        self._clear(number)
        self._write_models(new)
        steps, step_mm = depth_image(frame.depth_m)
        for kind, image in (("depth", steps), ("rgb", frame.rgb)):
            if image is not None:
                write_image(self._image(kind, number), image)
        self._write_detections(number, frame.objects)
        self._write_poses(number, frame.objects)
        self._write_ground_truth(number, frame.objects)
        self._write_order(number, frame)
        cameras[str(number)] = camera_entry(frame.K, step_mm, frame.down_cam)
        self._write_session(cameras)
        # Names and the camera are last: without the names models do not count, without the camera the frame does not.
        write_json(self._folder / NAMES, self._names)
        write_json(self._cameras, cameras)
        return f"{SCENE_ID}/{number}"

    def _is_ours(self) -> bool:
        session = self._folder / SESSION
        if session.is_file():
            return session.read_text("utf-8", errors="replace").startswith(CAPTURE_HEAD)
        # Another program may just be beginning to write it.
        return self._folder.is_dir() and all(
            p.name == LOCK or p.name.startswith(SESSION) for p in self._folder.iterdir()
        )

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Waits until no other program adds to the folder, which is made; one that is killed releases it."""
        make_inside(self._folder)
        with wait_for_lock(self._folder / LOCK):
            for folder in (self._model_path(0).parent, self._scene.parent, self._scene):
                check_no_link(folder)
            for kind in ("depth", "rgb"):
                check_no_link(self._image(kind, 0).parent)
            yield

    def _begin(self) -> None:
        """Marks the folder as ours, so that a program that was killed in its first frame can go on."""
        if not (self._folder / SESSION).is_file():
            with atomic(self._folder / SESSION) as part:
                part.write_text(CAPTURE_HEAD, encoding="utf-8")

    def _clear(self, number: int) -> None:
        """Removes what a program that was killed in the middle of a frame has left of it."""
        ours = (f"{name}.*.part" for name in (SESSION, DETECTIONS, ORDERS, NAMES, RESULTS))
        for pattern in (*ours, "models/*.part", f"test/{SCENE_ID:06d}/**/*.part"):
            for part in self._folder.glob(pattern):
                part.unlink()
        for kind in ("depth", "rgb"):
            self._image(kind, number).unlink(missing_ok=True)
        # Detections are written before poses and ground truth, and cleared after them: without, there are no others.
        detections = _json_or([], self._folder / DETECTIONS)
        others = [entry for entry in detections if entry.get("image_id") != number]
        if len(others) == len(detections):
            return
        for path in self._results():
            rows = [row for row in read_results(path) if row.im_id != number]
            if rows:
                write_results(path, rows)
            else:
                path.unlink()
        truths = _json_or({}, self._gt_entries)
        if truths.pop(str(number), None) is not None:
            write_json(self._gt_entries, truths)
            if not truths:  # As in a folder that never had any.
                self._gt_entries.unlink()
        write_json(self._folder / DETECTIONS, others)

    def _results(self) -> list[Path]:
        return sorted(self._folder.glob(RESULTS))

    def _image(self, kind: str, number: int) -> Path:
        return self._scene / kind / f"{number:06d}.png"

    def _id(self, name: str) -> int:
        return next(int(obj_id) for obj_id, known in self._names.items() if known == name)

    def _model_path(self, obj_id: int) -> Path:
        return self._folder / "models" / f"obj_{obj_id:06d}.ply"

    def _texture_path(self, obj_id: int) -> Path:
        return self._model_path(obj_id).with_suffix(".png")

    def _new_models(self, objects: Sequence[CapturedObject]) -> dict[int, CapturedObject]:
        """The models that are not there yet, by their new obj_id."""
        new: dict[int, CapturedObject] = {}
        for one in objects:
            if one.name not in self._names.values():
                new[len(self._names) + 1] = one
                self._names[str(len(self._names) + 1)] = one.name
            obj_id = self._id(one.name)
            if not self._is_mesh_of(obj_id, one.mesh, new.get(obj_id)):
                raise InputError(f"{one.name} is another mesh than before in {self._folder}; give it another name")
        return new

    def _is_mesh_of(self, obj_id: int, mesh: Mesh, new: CapturedObject | None) -> bool:
        """Whether it is the mesh that the object has, in the folder or as a new one."""
        path, texture = self._model_path(obj_id), self._texture_path(obj_id)
        before = path.read_bytes() if new is None else model_file(new.mesh, texture)
        if before != model_file(mesh, texture):
            return False
        if mesh.texture is None:
            return True
        image = read_color(texture) if new is None or new.mesh.texture is None else new.mesh.texture.image
        return np.array_equal(image, mesh.texture.image)

    def _write_models(self, new: Mapping[int, CapturedObject]) -> None:
        for obj_id, one in new.items():
            texture = self._texture_path(obj_id)
            if one.mesh.texture is not None:
                write_image(texture, one.mesh.texture.image)
            with atomic(self._model_path(obj_id)) as part:
                part.write_bytes(model_file(one.mesh, texture))
        if new:
            info = self._folder / "models" / "models_info.json"
            write_json(info, _json_or({}, info) | {str(obj_id): _info_entry(one) for obj_id, one in new.items()})

    def _write_detections(self, number: int, objects: Sequence[CapturedObject]) -> None:
        ids = {"scene_id": SCENE_ID, "image_id": number}
        entries = [
            {**ids, "category_id": self._id(one.name), "score": 1.0, "segmentation": encode_rle(one.mask)}
            for one in objects
        ]
        path = self._folder / DETECTIONS
        write_json(path, _json_or([], path) + entries)

    def _write_poses(self, number: int, objects: Sequence[CapturedObject]) -> None:
        for estimator in sorted({name for one in objects for name, poses in one.poses.items() if poses}):
            path = self._folder / f"{estimator}_kept-test.csv"
            rows = [*read_results(path)] if path.is_file() else []
            for one in objects:
                for k, T_cam_obj in enumerate(one.poses.get(estimator, ())):
                    rows.append(ResultRow(SCENE_ID, number, self._id(one.name), 1 / (1 + k), T_cam_obj))
            write_results(path, rows)

    def _write_ground_truth(self, number: int, objects: Sequence[CapturedObject]) -> None:
        if any(one.T_cam_obj_gt is not None for one in objects):
            entries = [truth_entry(one.T_cam_obj_gt, self._id(one.name)) for one in objects]
            write_json(self._gt_entries, _json_or({}, self._gt_entries) | {str(number): entries})

    def _write_order(self, number: int, frame: CapturedFrame) -> None:
        """Also of a frame without one, where a program was killed in the middle of another."""
        orders, name = _json_or({}, self._folder / ORDERS), f"{SCENE_ID}/{number}"
        before = orders.pop(name, None)
        if frame.order:
            orders[name] = [[self._id(frame.objects[i].name) for i in cluster] for cluster in frame.order]
        if orders.get(name) != before:
            write_json(self._folder / ORDERS, orders)

    def _write_session(self, cameras: Mapping[str, Any]) -> None:
        files = self._results()
        # Every pose of an object is to be tried, whatever the number of estimators.
        n_poses = Counter((row.im_id, row.obj_id) for path in files for row in read_results(path))
        hypotheses: dict[str, Any] = {"source": "ppf"}
        if files:
            names = [path.name for path in files]
            hypotheses = {"source": "results", "files": names, "max_per_object": max(n_poses.values())}
        scene = {
            "source": "bop",
            "dataset": ".",
            "masks": DETECTIONS,
            "gravity": "world" if any("cam_R_w2c" in camera for camera in cameras.values()) else "plane",
            **({"sequence": True} if self._is_sequence else {}),
        }
        session = {"title": one_line(self._folder.resolve().name), "scene": scene, "hypotheses": hypotheses}
        if (self._folder / ORDERS).is_file():
            session["dependency"] = {"order_file": ORDERS}
        with atomic(self._folder / SESSION) as part:
            part.write_text(CAPTURE_HEAD + tomli_w.dumps(session), encoding="utf-8")


def _json_or(empty: Any, path: Path) -> Any:
    kind = dict[str, Any] if isinstance(empty, dict) else list[dict[str, Any]]
    return read_json(path, kind) if path.is_file() else empty
