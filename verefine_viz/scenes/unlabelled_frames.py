"""Frames to label, of any layout that opens, without the objects that are known in them; and the models to place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Protocol

from msgspec import structs

from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError, VerefineError, unknown
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.settings import SceneSettings
from verefine_viz.observation.observed_frame import observe
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.labels import read_labels
from verefine_viz.scenes.layouts import MOST_LOOKED_AT, recording_in
from verefine_viz.scenes.meshes import FORMATS, mesh_files, read_mesh
from verefine_viz.scenes.models import ModelLibrary, model_of_mesh
from verefine_viz.scenes.recorded_frame import Recording, frame_ids, meshes_in, unit_of


class Models(Protocol):
    """Models by the id of their object; each is read when it is first asked for."""

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of all objects."""
        ...

    def name(self, obj_id: int) -> str:
        """The object's name."""
        ...

    def get(self, obj_id: int) -> ObjectModel:
        """The model.

        Raises:
            InputError: there is none, or its file is damaged.
        """
        ...

    def notes(self, obj_id: int) -> tuple[str, ...]:
        """Notes about the model."""
        ...


@dataclass(frozen=True)
class MeshFile:
    """The mesh of an object."""

    name: str
    path: Path
    unit_m: float | None = None
    """Metres per unit; None = by its size."""


class MeshModels:
    """Models of single mesh files; ids count them from 1, but for those that labels made so far have of a name.

    Raises:
        InputError: the file of labels is damaged.
    """

    def __init__(self, files: Sequence[MeshFile], scene: SceneSettings) -> None:
        self._files, self._scene = _by_id(files, scene.labels), scene
        self._loaded: dict[int, tuple[ObjectModel, tuple[str, ...]]] = {}

    @property
    def ids(self) -> tuple[int, ...]:
        """See :class:`Models`."""
        return tuple(self._files)

    def name(self, obj_id: int) -> str:
        """See :class:`Models`."""
        return self._file(obj_id).name

    def get(self, obj_id: int) -> ObjectModel:
        """See :class:`Models`."""
        return self._load(obj_id)[0]

    def notes(self, obj_id: int) -> tuple[str, ...]:
        """See :class:`Models`."""
        return self._load(obj_id)[1]

    def _file(self, obj_id: int) -> MeshFile:
        if obj_id not in self._files:
            raise InputError(unknown("object", obj_id, self.ids))
        return self._files[obj_id]

    def _load(self, obj_id: int) -> tuple[ObjectModel, tuple[str, ...]]:
        if obj_id not in self._loaded:
            file, scene = self._file(obj_id), self._scene
            mesh = read_mesh(file.path, unit_of(file.path) if file.unit_m is None else file.unit_m)
            model = model_of_mesh(
                mesh, obj_id, file.name, scene.model_points, scene.seed, sampling=scene.model_sampling
            )
            self._loaded[obj_id] = model, tuple(f"{file.name} ({obj_id}): {text}" for text in mesh.notes)
        return self._loaded[obj_id]


def _by_id(files: Sequence[MeshFile], labels: str) -> dict[int, MeshFile]:
    """Files by the id of their object, in the order of ids. A mesh that is added later changes none that labels use."""
    used: dict[str, int] = {}
    for of in read_labels(Path(labels)).values() if labels else ():
        for one in of:
            if one.obj_id not in used.values():
                used.setdefault(one.name, one.obj_id)
    free = count(max(used.values(), default=0) + 1)
    numbered = {used[file.name] if file.name in used else next(free): file for file in files}
    return dict(sorted(numbered.items()))


def _models_in(folder: Path, scene: SceneSettings) -> Models:
    """The models of a folder: those of a BOP data set, or any meshes, named as their files.

    Raises:
        InputError: it holds no mesh.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; expected one with meshes ({', '.join(FORMATS)})")
    if mesh_files(folder) or (folder / "models").is_dir():
        return ModelLibrary(folder, scene.model_points, scene.seed, scene.model_sampling)
    files = {path.stem: MeshFile(path.stem, path) for path in reversed(meshes_in(folder))}
    if not files:
        raise InputError(f"{folder} holds no mesh; expected files of {', '.join(FORMATS)}")
    return MeshModels([files[name] for name in sorted(files)], scene)


class UnlabelledFrames(Protocol):
    """Where frames come from."""

    @property
    def title(self) -> str:
        """As shown to the user."""
        ...

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames as "scene/image", in order."""
        ...

    @property
    def models(self) -> Models:
        """What can be placed in them."""
        ...

    @property
    def dataset(self) -> BopDataset | None:
        """The data set in BOP layout that they are of; None of any other layout."""
        ...

    def observation(self, frame: str, masks: Sequence[Mask] = ()) -> tuple[Observation, tuple[str, ...]]:
        """A frame without objects, and notes about its data.

        Args:
            frame: which.
            masks: (H, W) pixels that are no support, as far as objects are known.

        Raises:
            VerefineError: its images are missing or damaged.
        """
        ...


def unlabelled_frames(scene: SceneSettings) -> UnlabelledFrames:
    """The frames of ``scene.dataset`` with the models of ``scene.models``.

    Raises:
        InputError: the folder is in no layout that is read, or there are no models.
    """
    folder = Path(scene.dataset)
    models = _models_in(Path(scene.models), scene) if scene.models else None
    recording = recording_in(folder) if folder.is_dir() else None
    if recording is not None:
        return _OfRecording(scene, recording, models)
    return _OfBop(scene, models)


class _OfBop:
    def __init__(self, scene: SceneSettings, models: Models | None) -> None:
        self._scene = scene
        self.dataset = BopDataset(
            scene.dataset,
            scene.split,
            scene.model_points,
            scene.seed,
            scene.sensor,
            scene.model_sampling,
            needs_models=False,
        )
        self.models: Models = self._own_models() if models is None else models
        self.frames = tuple(dict.fromkeys(scene.frames)) or tuple(map(frame_name, self.dataset.frames))
        self.title = self.dataset.name

    def _own_models(self) -> Models:
        try:
            return self.dataset.models
        except InputError as error:
            raise InputError(f"{error}; or give a folder of meshes: --models FOLDER") from None

    def observation(self, frame: str, masks: Sequence[Mask] = ()) -> tuple[Observation, tuple[str, ...]]:
        """See :class:`UnlabelledFrames`."""
        ids, scene = parse_frame(frame), self._scene
        image = self.dataset.image(*ids)
        if scene.gravity == "world" and image.R_world_cam is None:
            scene = structs.replace(scene, gravity="plane")
        seen = observe(image.camera, image.depth_m, image.rgb, masks, scene, image.R_world_cam, image.T_map_cam)
        return seen, image.notes


class _OfRecording:
    dataset: BopDataset | None = None

    def __init__(self, scene: SceneSettings, recording: Recording, models: Models | None) -> None:
        self._scene, self._recording = scene, recording
        self._names: Mapping[str, str] = {
            frame_name(ids): name for ids, name in zip(frame_ids(recording.names), recording.names, strict=True)
        }
        self.frames = tuple(dict.fromkeys(scene.frames)) or tuple(self._names)
        self.models: Models = models or MeshModels(self._own_meshes(), scene)
        self.title = Path(scene.dataset).name

    def _own_meshes(self) -> list[MeshFile]:
        """Those that the recording names; its frames are read until each of its objects was seen."""
        files: dict[str, MeshFile] = {}
        missing = {*self._recording.objects}
        for name in islice(self._recording.names, MOST_LOOKED_AT):
            try:
                objects = self._recording.frame(name).objects
            except VerefineError:  # It is named when it is opened.
                continue
            for one in objects:
                missing.discard(one.name)
                if isinstance(one.mesh, Path) and one.mesh.is_file():
                    files.setdefault(one.name, MeshFile(one.name, one.mesh, one.unit_m))
            if not missing:
                break
        if not files:
            raise InputError(f"{self._scene.dataset} has no mesh; give a folder of some: --models FOLDER")
        return [*files.values()]

    def observation(self, frame: str, masks: Sequence[Mask] = ()) -> tuple[Observation, tuple[str, ...]]:
        """See :class:`UnlabelledFrames`."""
        if frame not in self._names:
            raise InputError(f"{unknown('frame', frame, tuple(self._names))} ({self._scene.dataset})")
        recorded, scene = self._recording.frame(self._names[frame]), self._scene
        try:
            camera = Camera(recorded.K, recorded.depth_m.shape[1], recorded.depth_m.shape[0])
        except ShapeError as error:
            raise InputError(f"frame {recorded.name}: {error}") from None
        if recorded.down_cam is not None and scene.gravity == "plane":
            x, y, z = recorded.down_cam.tolist()
            scene = structs.replace(scene, gravity=(x, y, z))
        return observe(camera, recorded.depth_m, recorded.rgb, masks, scene), recorded.notes
