"""Problems out of a BOP folder: frames, instances, models and initial poses put together."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import chain
from pathlib import Path

from msgspec import structs

from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.frame_names import FrameIds, frame_name, parse_frame
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import LeftOut, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.core.text_format import LONGEST_NUMBERS, listed
from verefine_viz.observation.observed_frame import observe
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.detections import DetectionsFile
from verefine_viz.scenes.frames import all_frames, is_list, named_frames
from verefine_viz.scenes.hypothesis_pool import (
    check_asked,
    check_covered,
    file_notes,
    pools_of_frame,
    results_of,
)
from verefine_viz.scenes.instance_notes import instance_notes
from verefine_viz.scenes.segments import (
    Segment,
    Segments,
    all_left_out,
    objects_of_frame,
    segments_of_detections,
    segments_of_folder,
)

WITHOUT_UP = (
    "gravity is not known in this frame, as in others of its scene: scene_camera.json has no cam_R_w2c for it, so the "
    "normal of the table counts as up"
)
"""A note of such frames, where gravity is asked of the data set."""


class BopSource:
    """The frames of a BOP folder that the settings name.

    Args:
        scene: which frames and objects; ``dataset`` and a path in ``masks`` are absolute.
        hypotheses: where initial poses come from; ``files`` are absolute.

    Raises:
        VerefineError: the data set, a frame, an object or a results file does not exist or is damaged.
    """

    def __init__(self, scene: SceneSettings, hypotheses: HypothesesSettings) -> None:
        if not scene.dataset:
            raise SettingsError("scene.dataset is empty; set it to the folder of a BOP data set")
        self._scene = scene
        self._hypotheses = hypotheses
        self.is_sequence = scene.sequence
        self._read()

    def _read(self) -> None:
        scene, hypotheses = self._scene, self._hypotheses
        self._dataset = BopDataset(
            scene.dataset, scene.split, scene.model_points, scene.seed, scene.sensor, scene.model_sampling
        )
        self._check_objects()
        self._detections = _detections(scene.masks)
        self._results = results_of(hypotheses)
        check_asked(hypotheses, lambda frame: self._dataset.check(*parse_frame(frame)))
        chosen, notes = named_frames(self._dataset, scene.frames) if scene.frames else all_frames(self._dataset)
        self.notes: tuple[str, ...] = (
            *notes,
            *self._dataset.target_notes,
            *self._dataset.scene_notes(),
            *self._dataset.models.faults,
            *chain.from_iterable(self._dataset.truth_notes(chosen)),
            *(() if self._detections is None else self._detections.notes),
            *file_notes(self._results),
            *self._shifted_notes(),
        )
        self._chosen = self._holding(chosen) if scene.objects else chosen
        scene_ids = dict.fromkeys(scene_id for scene_id, _ in self._chosen)
        self.notes += self._dataset.sensor_notes(scene_ids)
        if scene.masks == "mask_visib":
            self.notes += self._dataset.mask_notes(scene_ids)
        self.frames: tuple[str, ...] = tuple(frame_name(ids) for ids in self._chosen)

    def _shifted_notes(self) -> tuple[str, ...]:
        """Notes about files whose object ids seem to be counted from 0, where models count from 1."""
        used = {} if self._detections is None else {self._detections.path.name: self._detections.objects}
        for file in self._results:
            used[file.name] = frozenset[int]().union(*file.objects().values())
        return tuple(note for of, ids in used.items() for note in self._dataset.models.shifted_note(ids, of))

    def check_initial_poses(self) -> tuple[str, ...]:
        """See :class:`SceneSource`."""
        return check_covered(self._results, self._hypotheses, self._chosen, self._wanted_objects)

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """See :class:`SceneSource`."""
        return self._asked_for(all_left_out(self._dataset, *parse_frame(frame), why, self._detections is not None))

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """The problem of one frame, also of one that ``frames`` does not list.

        Trouble with a single instance (no mask, no model, no hypothesis, …) becomes a note and the others go on; what
        cannot be solved is ``left_out``.

        Raises:
            VerefineError: the frame does not exist, its images are missing or damaged, or no instance is left.
            Cancelled: ``progress`` was cancelled. Models that were read stay in memory.
        """
        ids = parse_frame(frame)
        progress.checkpoint(f"Reading the pictures of frame {frame}.")
        if not self._dataset.has(*ids):  # It may have arrived since.
            self._read()
        image = self._dataset.image(*ids)
        progress.seen(image.rgb)
        of_frame = self._segments(ids, image.camera)
        segments, notes = of_frame.segments, of_frame.notes
        progress.checkpoint()
        masks = [segment.mask for segment in segments]
        scene, up_notes = self._scene, ()
        if scene.gravity == "world" and image.R_world_cam is None and self._dataset.knows_up(ids[0]):
            scene, up_notes = structs.replace(scene, gravity="plane"), (WITHOUT_UP,)
        R_world_cam, T_map_cam = image.R_world_cam, image.T_map_cam
        observation = observe(image.camera, image.depth_m, image.rgb, masks, scene, R_world_cam, T_map_cam)
        wanted = self._wanted(segments, frame)
        with progress.preparing():
            models, faults, model_notes = self._models(wanted, progress)
        solvable = [s for s in wanted if s.obj_id in models]
        if not solvable:
            raise InputError(f"no instance of frame {frame} can be solved: {'; '.join((*notes, *model_notes))}")
        progress.checkpoint()
        without_model = tuple(self._left_out(s, faults[s.obj_id]) for s in wanted if s.obj_id in faults)
        pools = pools_of_frame(self._results, ids, segments, models, image.camera, self._hypotheses)
        instances = tuple(s.instance(image.depth_m, image.camera, pools[s.instance_id], self._scene) for s in solvable)
        return Problem(
            *ids,
            observation=observation,
            models=models,
            instances=instances,
            title=" ".join(filter(None, (self._dataset.name, self._scene.split, self._dataset.files(ids[0]).sensor))),
            notes=(
                *image.notes,
                *up_notes,
                *notes,
                *model_notes,
                *instance_notes(ids, instances, models, self._hypotheses.source, self._results),
            ),
            left_out=self._asked_for(of_frame.left_out) + without_model,
        )

    def _segments(self, ids: FrameIds, camera: Camera) -> Segments:
        if self._detections is not None:
            return segments_of_detections(self._dataset, self._detections, *ids, camera)
        kind = "mask" if self._scene.masks == "mask" else "mask_visib"
        return segments_of_folder(self._dataset, *ids, kind, camera.shape)

    def _wanted(self, segments: Sequence[Segment], frame: str) -> list[Segment]:
        if not segments:
            raise InputError(f"frame {frame} is empty: its ground truth (scene_gt.json) lists no object")
        wanted = [s for s in segments if not self._scene.objects or s.obj_id in self._scene.objects]
        if not wanted:
            there = ", ".join(str(i) for i in sorted({s.obj_id for s in segments}))
            asked = ", ".join(map(str, self._scene.objects))
            raise InputError(f"frame {frame} has no mask of object {asked}; objects with a mask: {there}")
        return wanted

    def _models(
        self, segments: Sequence[Segment], progress: ProgressToken
    ) -> tuple[dict[int, ObjectModel], dict[int, str], list[str]]:
        """The models of these objects, what is wrong with those that have none, and notes."""
        models: dict[int, ObjectModel] = {}
        faults: dict[int, str] = {}
        notes: list[str] = []
        for obj_id in progress.over(sorted({s.obj_id for s in segments}), "Reading the objects' models."):
            try:
                models[obj_id] = self._dataset.models.get(obj_id)
                notes.extend(self._dataset.models.notes(obj_id))
            except VerefineError as error:
                faults[obj_id] = str(error)
                notes.append(f"object {obj_id} is left out: {error}")
        return models, faults, notes

    def _left_out(self, segment: Segment, why: str) -> LeftOut:
        """An object whose model cannot be read."""
        name, has_gt = self._dataset.models.name(segment.obj_id), segment.T_cam_obj_gt is not None
        return LeftOut(segment.instance_id, segment.obj_id, name, why, has_gt, segment.visib_fract, is_unreadable=True)

    def _asked_for(self, left_out: Collection[LeftOut]) -> tuple[LeftOut, ...]:
        return tuple(one for one in left_out if not self._scene.objects or one.obj_id in self._scene.objects)

    def _check_objects(self) -> None:
        library = self._dataset.models
        strange = [i for i in self._scene.objects if i not in library.ids]
        if strange:
            raise SettingsError(f"unknown object {strange[0]} in scene.objects; available: {self._named(library.ids)}")

    def _named(self, obj_ids: Collection[int]) -> str:
        named = ", ".join(f"{i} ({self._dataset.models.name(i)})" for i in obj_ids)
        return named if len(named) <= LONGEST_NUMBERS else listed(obj_ids)

    def _holding(self, chosen: tuple[FrameIds, ...]) -> tuple[FrameIds, ...]:
        """The chosen frames that hold a wanted object. Frames that were named all stay: what is wrong with
        one is reported when it is read.

        Raises:
            InputError: none does.
        """
        objects = {ids: self._objects(ids) for ids in chosen}
        holding = tuple(ids for ids in chosen if not (objects[ids] or frozenset()).isdisjoint(self._scene.objects))
        there = sorted({obj_id for held in objects.values() for obj_id in held or ()})
        is_named = any(not is_list(frame) for frame in self._scene.frames)
        nowhere = sorted(set(self._scene.objects).difference(there))
        if nowhere and None not in objects.values():
            self.notes += (f"no chosen frame holds object {self._named(nowhere)} of scene.objects",)
        if holding or (is_named and (None in objects.values() or not there)):
            return chosen if is_named else holding
        which = f"no frame of {self._dataset.name}/{self._scene.split}"
        if is_named:
            which = f"none of the chosen frames ({listed(frame_name(ids) for ids in chosen)})"
        raise InputError(
            f"{which} holds object {listed(self._scene.objects)} of scene.objects; "
            f"objects there: {self._named(there) or 'none'}"
        )

    def _objects(self, ids: FrameIds) -> frozenset[int] | None:
        try:
            return objects_of_frame(self._dataset, self._detections, *ids)
        except InputError:  # It is noted, and reported when the frame is read.
            return None

    def _wanted_objects(self, ids: FrameIds) -> frozenset[int] | None:
        objects = self._objects(ids)
        return objects if objects is None or not self._scene.objects else objects.intersection(self._scene.objects)


def _detections(masks: str) -> DetectionsFile | None:
    if masks in ("mask_visib", "mask"):
        return None
    if not masks.endswith((".json", ".json.gz")):
        raise SettingsError(f"scene.masks is {masks!r}, expected mask_visib, mask, or the path of a detections JSON")
    return DetectionsFile(Path(masks))
