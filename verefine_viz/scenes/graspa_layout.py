"""Scenes out of the layouts of the GRASPA benchmark: its objects on a table, seen by our camera and depth sensor.

A layout gives where each object stands on the benchmark's board, in millimetres and in the frame of its own meshes,
those of the YCB scans. BOP's YCB-V models are these scans moved to the middle of their bounding boxes: ``SHIFTS_MM``.
Models are the user's, in a folder as BOP has them. Source: Bottarel et al., GRASPA 1.0, RA-L 2020; paper Sec. V-D.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ContentError, InputError, SettingsError, unknown
from verefine_viz.core.files import reading
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.geometry import as_rigid, check_reach, inverse, rounding_note, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import LeftOut, Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, PhysicsSettings, SceneSettings
from verefine_viz.core.text_format import unusable
from verefine_viz.observation.observed_frame import observe
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.scenes.demo_layout import CAMERA, Viewpoint, rest_poses, take_picture, turned
from verefine_viz.scenes.frames import repeated_notes
from verefine_viz.scenes.hypothesis_pool import (
    check_asked,
    check_covered,
    file_notes,
    pools_of_frame,
    results_of,
)
from verefine_viz.scenes.models import ModelLibrary
from verefine_viz.scenes.segments import Segment, silhouette
from verefine_viz.scenes.sensor import sense

VIEWS = (
    Viewpoint(azimuth_deg=-90, elevation_deg=45, distance_m=0.90),
    Viewpoint(azimuth_deg=-50, elevation_deg=45, distance_m=0.90),
    Viewpoint(azimuth_deg=-130, elevation_deg=45, distance_m=0.90),
)
"""From in front of the board's long side, as a robot's head sees it; the benchmark does not say where the robot is."""
MIDDLE_MM = (-256.5, 180.5)
"""The board's middle in its own frame [mm]; the table's here."""
DROP_M = 0.004
"""Objects are dropped from this height, as the layouts have them up to 2 mm in the board [m]."""
MOST_BYTES, MOST_OBJECTS = 10_000_000, 100
"""Limits of a layout."""

SHIFTS_MM: dict[str, tuple[int, str, tuple[float, float, float]]] = {
    "YcbCrackerBox": (2, "cracker_box", (-12.9, -14.1, 103.5)),
    "YcbTomatoSoupCan": (4, "tomato_soup_can", (-9.2, 84.0, 51.0)),
    "YcbMustardBottle": (5, "mustard_bottle", (-15.3, -23.5, 92.5)),
    "YcbGelatinBox": (8, "gelatin_box", (-22.8, -8.2, 14.5)),
    "YcbPottedMeatCan": (9, "potted_meat_can", (-32.8, -26.6, 38.6)),
    "YcbBanana": (10, "banana", (-14.0, 12.0, 19.0)),
    "YcbFoamBrick": (21, "foam_brick", (-18.0, 19.0, 25.0)),
}
"""By the benchmark's name: BOP's id, a name, and the middle of the scan's bounding box in the scan's frame [mm].

From the bounding boxes of the published scans, which have the size of BOP's models along each axis within 0.3 mm, so
that the axes are the same; banana and foam brick are known to some 3 mm."""


@dataclass(frozen=True, eq=False)
class LayoutObject:
    """An object of a layout."""

    name: str
    """The benchmark's."""
    T_board_scan: Float
    """(4, 4) [m]."""


def read_layout(file: Path) -> tuple[tuple[LayoutObject, ...], tuple[str, ...]]:
    """The objects of a layout; and notes about those that are left out, and about rounded rotations.

    Raises:
        InputError: the file is none, or no pose of it is a rotation and translation.
    """
    with reading(file, "layout", MOST_BYTES) as opened:
        elements = ET.parse(opened).getroot().findall("ManipulationObject")
        if not 0 < len(elements) <= MOST_OBJECTS:
            raise ContentError(
                f"it has {len(elements)} ManipulationObject, expected 1 to {MOST_OBJECTS}, as in GRASPA's layout_0.xml"
            )
        objects: list[LayoutObject] = []
        taken: list[Float] = []
        faults: list[str] = []
        for element in elements:
            where = element.get("name", "an object without a name")
            try:
                T = _matrix(element, where)
                pose = as_rigid(transform(T[:, :3], T[:, 3] * 1e-3), f"{where}: its Matrix4x4")
                check_reach(pose[:3, 3], where)
            except ValueError as error:
                faults.append(str(error))
                continue
            objects.append(LayoutObject(element.get("name", ""), pose))
            taken.append(T[:, :3])
        if not objects:
            raise ContentError(faults[0])
        return tuple(objects), (*unusable("object", file.name, faults), *rounding_note(file.name, taken))


def _matrix(element: ET.Element, where: str) -> Float:
    """Rotation and translation [mm], (3, 4)."""
    rows = [element.find(f".//Matrix4x4/row{k}") for k in (1, 2, 3)]
    T = np.full((3, 4), np.nan)
    with suppress(ValueError):  # A word.
        T = np.array([[float(row.get(f"c{k}", "nan")) for k in (1, 2, 3, 4)] for row in rows if row is not None])
    if T.shape != (3, 4) or not np.isfinite(T).all():
        raise ContentError(f"{where}: expected a Matrix4x4 of finite numbers, c1 to c4 in row1 to row4")
    return T


class LayoutSource:
    """A layout as frames, one per viewpoint.

    Args:
        scene: ``layout`` names the file and ``dataset`` the folder of the models, both absolute.
        hypotheses: where initial poses come from.

    Raises:
        VerefineError: layout, models, a frame or an object does not exist.
    """

    def __init__(self, scene: SceneSettings, hypotheses: HypothesesSettings) -> None:
        for name, what in (("layout", "the XML file of a GRASPA layout"), ("dataset", "the folder of YCB-V models")):
            if not getattr(scene, name):
                raise SettingsError(f'scene.{name} is empty; set it to {what} for scene.source = "layout"')
        self._scene, self._hypotheses = scene, hypotheses
        self._library = ModelLibrary(Path(scene.dataset), scene.model_points, scene.seed, scene.model_sampling)
        self._available = tuple(f"0/{k}" for k in range(len(VIEWS)))
        for frame in scene.frames:
            self._check_frame(frame)
        check_asked(hypotheses, self._check_frame)
        self.is_sequence = scene.sequence
        self.frames: tuple[str, ...] = tuple(dict.fromkeys(scene.frames)) or self._available
        everything, notes = read_layout(Path(scene.layout))
        self._objects = tuple(o for o in everything if SHIFTS_MM.get(o.name, (-1,))[0] in self._library.ids)
        left_out = [o.name for o in everything if o not in self._objects]
        if not self._objects:
            raise InputError(
                f"none of the objects of {scene.layout} ({', '.join(left_out)}) has a model in {self._library.folder}; "
                f"expected one at least of {', '.join(f'{i} ({n})' for i, n, _ in SHIFTS_MM.values())}"
            )
        ids = {SHIFTS_MM[o.name][0]: SHIFTS_MM[o.name][1] for o in self._objects}
        for obj_id in scene.objects:
            if obj_id not in ids:
                there = ", ".join(f"{i} ({name})" for i, name in sorted(ids.items()))
                raise SettingsError(f"unknown object {obj_id} in scene.objects; available: {there} ({scene.layout})")
        self.notes: tuple[str, ...] = (*repeated_notes(scene.frames), *notes)
        if left_out:
            self.notes += (f"left out, as they are not in YCB-V or not among the models: {', '.join(left_out)}",)
        self._rest: tuple[tuple[ObjectModel, ...], tuple[Float, ...]] | None = None
        self._problems: dict[str, Problem] = {}

    def _check_frame(self, frame: str) -> None:
        if frame not in self._available:
            raise InputError(f"{unknown('frame', frame, self._available)} ({self._scene.layout})")

    def check_initial_poses(self) -> tuple[str, ...]:
        """See ``SceneSource``."""
        files, frames = results_of(self._hypotheses), [parse_frame(frame) for frame in self.frames]
        ids = frozenset(self._scene.objects or (SHIFTS_MM[o.name][0] for o in self._objects))
        return (*file_notes(files), *check_covered(files, self._hypotheses, frames, lambda _: ids))

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """See ``SceneSource``."""
        return tuple(target.left_out(why) for target in self.problem(frame).targets)

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """See ``SceneSource``; the same object at each call."""
        self._check_frame(frame)
        if frame not in self._problems:
            self._problems[frame] = self._seen(int(frame.split("/")[1]), progress)
        return self._problems[frame]

    def _resting(self, progress: ProgressToken) -> tuple[tuple[ObjectModel, ...], tuple[Float, ...]]:
        """The models, and where they lie on the table (4, 4) each; the same in all views."""
        if self._rest is None:
            models, starts = [], []
            for o in self._objects:
                obj_id, name, middle_mm = SHIFTS_MM[o.name]
                model = replace(self._library.get(obj_id), name=name)
                T = o.T_board_scan @ transform(np.eye(3), np.array(middle_mm) * 1e-3)
                T[:2, 3] -= np.array(MIDDLE_MM) * 1e-3
                T[2, 3] = DROP_M - float((model.vertices @ T[2, :3]).min())
                models.append(model)
                starts.append(T)
            simulator = BulletSimulator(PhysicsSettings(), progress=progress)
            for model in progress.over(models, "Building the colliders of the layout's objects; cached once built."):
                simulator.collider(model)
            progress.checkpoint("Letting the objects of the layout come to rest.")
            poses = rest_poses(models, starts)
            self._rest = tuple(models), turned(models, poses) if self._scene.turned else poses
        return self._rest

    def _seen(self, view: int, progress: ProgressToken) -> Problem:
        models, poses = self._resting(progress)
        settings, T_world_cam = self._scene, VIEWS[view].T_world_cam
        placed = [
            Placed(k, model, inverse(T_world_cam) @ T) for k, (model, T) in enumerate(zip(models, poses, strict=True))
        ]
        progress.checkpoint("Taking the picture of the scene.")
        seen = take_picture(placed, T_world_cam)
        depth_m = sense(seen.depth_m, seen.normals_cam, CAMERA, (settings.seed, view))
        segments: list[Segment] = []
        for p in placed:
            visible = seen.labels == p.instance_id
            full = silhouette(p.model, p.T_cam_obj, CAMERA)
            mask = full if settings.masks == "mask" else visible
            share = float(visible.sum() / max(full.sum(), 1))
            segments.append(Segment(p.instance_id, p.model.obj_id, mask, p.T_cam_obj, share))
        observation = observe(
            CAMERA, depth_m, seen.rgb, [s.mask for s in segments], settings, T_world_cam[:3, :3], T_world_cam
        )
        by_id = {model.obj_id: model for model in models}
        files = results_of(self._hypotheses)
        pools = pools_of_frame(files, (0, view), segments, by_id, CAMERA, self._hypotheses)
        instances = tuple(
            s.instance(depth_m, CAMERA, pools[s.instance_id], settings)
            for s in segments
            if not settings.objects or s.obj_id in settings.objects
        )
        used = {i.obj_id: by_id[i.obj_id] for i in instances}
        return Problem(0, view, observation, used, instances, f"GRASPA {Path(settings.layout).stem}", self.notes)
