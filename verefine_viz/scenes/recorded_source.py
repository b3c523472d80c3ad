"""Makes problems of frames that other programs read or recorded, in layouts of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import structs

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, SettingsError, ShapeError, VerefineError, unknown
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance, LeftOut, Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.observation.observed_frame import observe
from verefine_viz.scenes.frames import repeated_notes
from verefine_viz.scenes.hypothesis_pool import check_asked, check_covered, file_notes, pools_of_frame, results_of
from verefine_viz.scenes.instance_notes import instance_notes
from verefine_viz.scenes.layouts import readers, recording_in
from verefine_viz.scenes.meshes import Mesh, read_mesh
from verefine_viz.scenes.models import ModelInfo, SymmetryAxis, model_of_mesh, symmetry_transforms
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject, Recording, frame_ids
from verefine_viz.scenes.segments import Segment, draw_placed

NEARER_M = 0.02
"""A point measured nearer than a pose by this much hides it."""


@dataclass(frozen=True, eq=False)
class RecordedPose:
    """The answer of another program for an object of a frame."""

    frame: str
    T_cam_obj: Float | None
    """(4, 4) [m]; None where it has no pose."""
    score: float | None = None
    """The program's own score, on its own scale."""


KnownModels = dict[tuple[object, ...], tuple[ObjectModel, tuple[str, ...]]]
"""Models, each with notes on its mesh, by the data that they are made of."""


class RecordedSource:
    """The frames of a recording that the settings name; the image number is taken from the frame's name where it has
    one.

    Args:
        scene: which frames and objects; ``dataset`` is absolute.
        hypotheses: where initial poses come from.
        given: the recording; None = what lies at ``dataset``.
        models: receives the models that are made, and may hold some already.

    Raises:
        VerefineError: the folder holds nothing of the kind, or a frame or an object does not exist.
    """

    def __init__(
        self,
        scene: SceneSettings,
        hypotheses: HypothesesSettings,
        given: Recording | None = None,
        models: KnownModels | None = None,
    ) -> None:
        self._given = given
        if not scene.dataset and given is None:
            raise SettingsError(f'scene.dataset is empty; set it to the folder of scene.source = "{scene.source}"')
        self._scene, self._hypotheses = scene, hypotheses
        self._results = results_of(hypotheses)
        self._models: KnownModels = {} if models is None else models
        self._read()
        check_asked(hypotheses, self._check_frame)
        for frame in scene.frames:
            self._check_frame(frame)
        self.frames: tuple[str, ...] = tuple(dict.fromkeys(scene.frames)) or tuple(self._names)
        self.notes: tuple[str, ...] = (
            *self._recording.notes,
            *repeated_notes(scene.frames),
            *file_notes(self._results),
        )
        strange = [i for i in scene.objects if i not in self._obj_ids.values()]
        if strange:
            there = ", ".join(f"{i} ({name})" for name, i in self._obj_ids.items())
            raise SettingsError(f"unknown object {strange[0]} in scene.objects; available: {there}")

    def _read(self) -> None:
        folder = Path(self._scene.dataset)
        recording = self._given or (recording_in(folder) if folder.is_dir() else None)
        if recording is None:
            layouts = "; ".join(f"{reader.LOOKS_LIKE} ({reader.LAYOUT})" for reader in readers())
            raise InputError(f"{folder} is in none of the layouts that are read: {layouts}")
        self._recording = recording
        ids = frame_ids(recording.names)
        self._names = {frame_name(one): name for one, name in zip(ids, recording.names, strict=True)}
        """The recording's name of each frame."""
        self._obj_ids = {**recording.objects}
        self._tracks: Mapping[int, tuple[RecordedPose, ...]] | None = None  # Traces may have been added since.

    @property
    def is_sequence(self) -> bool:
        """See :class:`SceneSource`."""
        return self._scene.sequence or self._recording.is_sequence

    def _check_frame(self, frame: str) -> None:
        if frame_name(parse_frame(frame)) not in self._names:
            raise InputError(f"{unknown('frame', frame, tuple(self._names))} ({self._scene.dataset})")

    @property
    def tracks(self) -> Mapping[int, tuple[RecordedPose, ...]]:
        """The recorded answers by obj_id over the frames of a sequence, in order; empty where frames are not a
        sequence.
        """
        if not self.is_sequence:
            return {}
        if self._tracks is None:
            answers = {frame: self._recording.answers(name) for frame, name in self._names.items()}
            self._tracks = {
                obj_id: tuple(RecordedPose(frame, *poses.get(name, (None, None))) for frame, poses in answers.items())
                for name, obj_id in self._obj_ids.items()
            }
        return self._tracks

    def check_initial_poses(self) -> tuple[str, ...]:
        """See :class:`SceneSource`."""
        ids, objects = [parse_frame(frame) for frame in self.frames], frozenset(self._obj_ids.values())
        return check_covered(self._results, self._hypotheses, ids, lambda _: objects)

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """See :class:`SceneSource`; objects are known once a frame can be read."""
        return ()

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """See :class:`SceneSource`; includes a trace that was added since."""
        if frame not in self._names:
            self._read()
        self._check_frame(frame)
        progress.checkpoint(f"Reading the pictures of frame {frame}.")
        recorded = self._recording.frame(self._names[frame])
        progress.seen(recorded.rgb)
        for one in recorded.objects:
            self._obj_ids.setdefault(one.name, max(self._obj_ids.values(), default=0) + 1)
        try:
            camera = Camera(recorded.K, recorded.depth_m.shape[1], recorded.depth_m.shape[0])
        except ShapeError as error:
            raise InputError(f"frame {recorded.name}: {error}") from None
        return self._problem(parse_frame(frame), recorded, camera, progress)

    def _problem(
        self, ids: tuple[int, int], recorded: RecordedFrame, camera: Camera, progress: ProgressToken
    ) -> Problem:
        models: dict[int, ObjectModel] = {}
        notes, left_out = [*recorded.notes], list[LeftOut]()
        segments: list[tuple[Segment, RecordedObject]] = []
        with progress.preparing():
            for i, one in enumerate(recorded.objects):
                obj_id = self._obj_ids[one.name]
                if self._scene.objects and obj_id not in self._scene.objects:
                    continue
                try:
                    model, own = self._model(obj_id, one)
                    segment = Segment(i, obj_id, _mask_of(one, model, camera, recorded, notes), one.T_cam_obj_gt, None)
                except VerefineError as error:
                    notes.append(f"{one.name} is left out: {error}")
                    has_gt = one.T_cam_obj_gt is not None
                    left_out.append(LeftOut(i, obj_id, one.name, str(error), has_gt, is_unreadable=True))
                    continue
                models[obj_id] = model
                notes += own
                segments.append((segment, one))
        if not segments:
            raise InputError(
                f"{recorded.name} has no object that can be solved{': ' if notes else ''}{'; '.join(notes)}"
            )
        progress.checkpoint()
        instances = self._instances(ids, segments, models, camera, recorded)
        scene = self._scene
        if recorded.down_cam is not None and scene.gravity == "plane":
            x, y, z = recorded.down_cam.tolist()
            scene = structs.replace(scene, gravity=(x, y, z))
        masks, there = [segment.mask for segment, _ in segments], {segment.instance_id for segment, _ in segments}
        return Problem(
            *ids,
            observation=observe(camera, recorded.depth_m, recorded.rgb, masks, scene),
            models=models,
            instances=instances,
            title=recorded.name,
            notes=(*notes, *instance_notes(ids, instances, models, self._hypotheses.source, self._results)),
            left_out=tuple(left_out),
            order=tuple(tuple(i for i in cluster if i in there) for cluster in recorded.order),
        )

    def _instances(
        self,
        ids: tuple[int, int],
        segments: Sequence[tuple[Segment, RecordedObject]],
        models: dict[int, ObjectModel],
        camera: Camera,
        recorded: RecordedFrame,
    ) -> tuple[Instance, ...]:
        of_settings = pools_of_frame(self._results, ids, [s for s, _ in segments], models, camera, self._hypotheses)
        instances: list[Instance] = []
        for segment, one in segments:
            if self._hypotheses.source == "recorded":
                instance = segment.instance(recorded.depth_m, camera, one.hypotheses, self._scene)
                instance = replace(instance, recorded=one.steps, recorded_scores=one.scores)
            else:
                instance = segment.instance(recorded.depth_m, camera, of_settings[segment.instance_id], self._scene)
            instances.append(instance)
        return tuple(instances)

    def _model(self, obj_id: int, one: RecordedObject) -> tuple[ObjectModel, tuple[str, ...]]:
        """The model of an object, the same in all frames whose mesh file has the same size.

        Raises:
            InputError: it has no mesh, or one that cannot be read.
        """
        if one.mesh is None or (isinstance(one.mesh, Path) and not one.mesh.is_file()):
            place = "" if one.mesh is None else f" at {one.mesh}"
            raise InputError(f"it has no mesh{place}; expected a PLY, OBJ, GLB or STL file")
        scene = self._scene
        key = (
            one.name,
            one.mesh.stat().st_size if isinstance(one.mesh, Path) else one.mesh,
            obj_id,
            (scene.model_points, scene.seed, scene.model_sampling),
        )
        if key not in self._models:
            mesh = read_mesh(one.mesh, one.unit_m) if isinstance(one.mesh, Path) else one.mesh
            turns = None if one.symmetry_axis is None else _turns(one.symmetry_axis, mesh, one.name)
            model = model_of_mesh(
                mesh, obj_id, one.name, scene.model_points, scene.seed, turns, sampling=scene.model_sampling
            )
            self._models[key] = model, tuple(f"{one.name} ({obj_id}): {text}" for text in mesh.notes)
        return self._models[key]


def _turns(axis: Float, mesh: Mesh, name: str) -> Float:
    """The turns (S, 4, 4) about an axis through the middle of a mesh's box after which it looks the same."""
    middle_mm = 500.0 * (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0))
    return symmetry_transforms(
        ModelInfo(symmetries_continuous=(SymmetryAxis(axis, middle_mm),)), f"symmetry axis of {name}"
    )


def _mask_of(
    one: RecordedObject, model: ObjectModel, camera: Camera, recorded: RecordedFrame, notes: list[str]
) -> Mask:
    """The object's mask; without one, the pixels that its first recorded pose covers and nothing nearer hides.

    Raises:
        InputError: there is neither a mask nor a pose in the image.
    """
    if one.mask is not None:
        return one.mask
    if not one.hypotheses:
        raise InputError("it has neither a mask nor a pose; give one of both")
    rendered, owner = draw_placed([Placed(0, model, one.hypotheses[0].T_cam_obj)], camera)
    mask = (owner == 0) & ((recorded.depth_m == 0) | (recorded.depth_m > rendered - NEARER_M))
    if not mask.any():
        raise InputError("it has no mask, and its first pose is not seen in the image")
    notes.append(f"{one.name} has no mask; the pixels that its first pose covers count as one")
    return mask
