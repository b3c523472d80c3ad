"""A frame and the objects to solve in it: made of arrays, or opened from data on the disk."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from verefine_viz.batch.runs import RUN_FILE
from verefine_viz.core.arguments import (
    checked_mapping,
    checked_name,
    checked_path,
    checked_text,
    described,
    plain_value,
)
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ArgumentTypeError, InputError, SettingsError, ShapeError, unknown
from verefine_viz.core.own_parts import NO_PARTS, OwnParts
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic
from verefine_viz.library.frame_checks import checked_camera, checked_depth, checked_object, checked_photo, direction
from verefine_viz.library.plugins import named_parts
from verefine_viz.run.capture_folder import CaptureFolder, captured
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.run_file import SUFFIX
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo import demo_names
from verefine_viz.scenes.image_files import write_image
from verefine_viz.scenes.meshes import AnyMesh, Mesh, read_mesh
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject
from verefine_viz.scenes.recorded_source import KnownModels, RecordedSource
from verefine_viz.scenes.source import SceneSource
from verefine_viz.scenes.trace_files import is_trace
from verefine_viz.trace import Trace, ply_bytes

if TYPE_CHECKING:
    from typing import Unpack

    from verefine_viz.library.sections import Sections


class Frame:
    """A frame of arrays; objects are added, and nothing is written to the disk.

    Args:
        K: (3, 3) intrinsics [px].
        depth_m: (H, W) z [m]; 0, NaN or infinity where nothing was measured.
        rgb: (H, W, 3) uint8, or None.
        gravity_cam: (3,) direction in which things fall, in the camera's frame, of any length; None = along the normal
            of the table in the image.
        name: the name in titles and files.

    Raises:
        InputError: an array has the wrong shape or unit; one line says what was expected.
    """

    def __init__(
        self,
        K: ArrayLike,
        depth_m: ArrayLike,
        rgb: ArrayLike | None = None,
        gravity_cam: ArrayLike | None = None,
        name: str = "frame",
    ) -> None:
        try:
            depth = checked_depth(depth_m)
            self._camera = checked_camera(K, depth.shape)
            photo = None if rgb is None else checked_photo(rgb, self._camera.shape)
            down = None if gravity_cam is None else direction(gravity_cam, "gravity_cam")
        except ShapeError as error:
            raise InputError(str(error)) from None
        self.name = checked_name(name, "name")
        self._recorded = RecordedFrame(self.name, self._camera.K, depth, photo, (), down)
        self._points = self._camera.back_project(depth.astype(np.float64))
        self._kept = _Kept()

    def add(
        self,
        name: str,
        mesh: AnyMesh,
        mask: ArrayLike | None = None,
        poses: ArrayLike | Mapping[str, ArrayLike] | None = None,
        scores: ArrayLike | None = None,
        unit_m: float = 1.0,
        T_cam_obj_gt: ArrayLike | None = None,
        symmetry_axis: ArrayLike | None = None,
    ) -> Frame:
        """Add an object.

        Args:
            name: the same in all frames of this object.
            mesh: a PLY, OBJ, GLB or STL file; or a mesh of trimesh; or (vertices, faces) or (vertices, faces, colours),
                arrays (V, 3), (F, 3) and (V, 3) uint8.
            mask: (H, W) its visible pixels: all that is not 0; None = those that its first pose covers.
            poses: T_cam_obj [m], (4, 4) or (N, 4, 4) with the best first, or these by estimator; None = point pair
                features make some when the frame is solved. A rounded rotation is replaced by the nearest exact one. An
                invalid pose among several is left out, with a note in the problem.
            scores: (N,) the estimator's scores of the poses, in any unit; shown beside our own. None = unknown.
            unit_m: metres per unit of the mesh: 0.001 for millimetres.
            T_cam_obj_gt: (4, 4) ground truth [m], where it is known.
            symmetry_axis: (3,) axis through the middle of the mesh's box about which every turn looks the same.

        Objects that share a name are instances of one model, and are addressed by their instance_id.

        Returns:
            The frame itself.

        Raises:
            InputError: the mesh cannot be read, an array has the wrong shape or unit, or no pose is valid; one line
                says what would fit.
        """
        self._add(name, mesh, mask, poses, scores, unit_m, T_cam_obj_gt, symmetry_axis)
        return self

    def _add(self, *given: Any) -> None:
        try:
            one, notes = checked_object(self._camera, self._points, *given)
        except ShapeError as error:
            raise InputError(str(error)) from None
        self._recorded = replace(
            self._recorded, objects=(*self._recorded.objects, one), notes=(*self._recorded.notes, *notes)
        )

    def again(
        self,
        depth_m: ArrayLike,
        rgb: ArrayLike | None = None,
        masks: Mapping[str, ArrayLike] | None = None,
        poses: Mapping[str, ArrayLike | Mapping[str, ArrayLike]] | None = None,
    ) -> Frame:
        """The next image of this camera with the same objects: what was prepared for them is reused.

        Args:
            depth_m: (H, W) z [m], as in the frame itself.
            rgb: (H, W, 3) uint8, or None.
            masks: (H, W) visible pixels by the object's name.
            poses: initial poses by the object's name, as :meth:`add` takes them; the answers of the previous image, for
                example. An object with neither a mask nor a pose counts as not in the image.

        Returns:
            A frame; with the same settings it is solved in a fraction of the first one's time.

        Raises:
            InputError: as :meth:`add`; or two objects of this frame have one name.
        """
        masks, poses = _by_name(masks, "masks", self.objects), _by_name(poses, "poses", self.objects)
        following = Frame(self._camera.K, depth_m, rgb, self._recorded.down_cam, self.name)
        following._kept = self._kept
        for one in self._recorded.objects:
            if one.mesh is not None and (one.name in masks or one.name in poses):
                mesh = self._kept.mesh(one)
                following._add(
                    one.name, mesh, masks.get(one.name), poses.get(one.name), None, 1.0, None, one.symmetry_axis
                )
        return following

    def __repr__(self) -> str:
        height, width = self._camera.shape
        return f"<Frame {self.name!r}, {width}×{height}: {', '.join(self.objects) or 'no object'}>"

    @property
    def objects(self) -> tuple[str, ...]:
        """The names of the objects, in order."""
        return tuple(one.name for one in self._recorded.objects)

    @property
    def has_poses(self) -> bool:
        """Whether every object has initial poses."""
        return all(one.hypotheses for one in self._recorded.objects)

    def tools(self, sections: Mapping[str, Any]) -> tuple[Toolbox, str]:
        """The toolbox that solves the frame with settings by section, and the frame's id, "scene/image"."""
        sections, parts = taken(sections)
        if not self._recorded.objects:
            raise InputError(f"{self.name} has no object to solve; add one: frame.add(name, mesh, mask, poses)")
        own = {"scene": {"source": "folder"}, "hypotheses": {"source": "recorded" if self.has_poses else "ppf"}}
        merged = {name: {**fields, **sections.get(name, {})} for name, fields in own.items()}
        session = load_session(None, {"title": self.name, **sections, **merged}, "settings")
        source = RecordedSource(session.scene, session.hypotheses, _InMemory(self._recorded), self._kept.models)
        return self._kept.tools(session, source, parts), source.frames[0]

    def problem(self, **sections: Unpack[Sections]) -> Problem:
        """The frame as methods get it: observation, models, instances with their initial poses.

        Args:
            sections: settings, each section a dict as in a session file: ``scene={"gravity": "plane"}``.

        Raises:
            InputError: the frame has nothing to solve.
            SettingsError: a setting is unknown or out of range.
        """
        tools, frame = self.tools(sections)
        return tools.problem(frame)

    def save(self, folder: Path | str) -> Path:
        """Write the frame as a trace, which ``verefine-viz view FOLDER`` and :func:`open_frame` open bit for bit.

        Returns:
            The folder; the next free name where the given one already held a trace.

        Raises:
            InputError: the folder holds something else, or cannot be written.
        """
        seen, folder = self._recorded, checked_path(folder, "folder", "the folder of the trace")
        if folder.is_dir() and not is_trace(folder) and any(folder.iterdir()):
            raise InputError(f"{folder} holds something else; choose a new folder for the trace")
        try:
            with (
                Trace(folder, K=seen.K, depth_m=seen.depth_m, rgb=seen.rgb, gravity_cam=seen.down_cam) as trace,
                TemporaryDirectory(prefix="verefine-viz-") as beside,
            ):
                for one in seen.objects:
                    truth, axis = one.T_cam_obj_gt, one.symmetry_axis
                    mesh = _to_trace(one.mesh, Path(beside)) if isinstance(one.mesh, Mesh) else one.mesh
                    traced = trace.object(one.name, mesh, one.mask, one.unit_m, truth, axis)
                    for k, (start, score) in enumerate(zip(one.hypotheses, one.scores, strict=True)):
                        traced.hypothesis(k, start.T_cam_obj, score, start.source)
        except (OSError, ValueError) as error:
            raise InputError(f"cannot write {folder}: {error}") from None
        return trace.folder

    def keep(self, folder: Path | str) -> str:
        """Add the frame to a folder that becomes a small data set in BOP layout with a ``session.toml``.

        Returns:
            The frame's name there, as "1/17"; ``verefine-viz view FOLDER --scene.frames 1/17`` opens it alone.

        Raises:
            InputError: a mesh differs from the one that the folder has under its name, or the folder holds something
                else or cannot be written.
        """
        folder = checked_path(folder, "folder", "the folder of the data set")
        source = self.tools({})[0].source
        frame = captured(source.problem(source.frames[0]))
        axes = {one.name: one.symmetry_axis for one in self._recorded.objects}
        objects = [replace(one, symmetry_axis=axes[one.name]) for one in frame.objects]
        return CaptureFolder(folder).add(replace(frame, objects=objects, down_cam=self._recorded.down_cam))


class _Kept:
    """What the images of a live loop share: meshes, models, and the toolbox made for the last settings."""

    def __init__(self) -> None:
        self.models: KnownModels = {}
        self._meshes: dict[tuple[Path, float], Mesh] = {}
        self._last: Toolbox | None = None

    def mesh(self, one: RecordedObject) -> Mesh:
        """The mesh of an object; its file is read once."""
        if isinstance(one.mesh, Mesh):
            return one.mesh
        assert one.mesh is not None
        key = (one.mesh, one.unit_m)
        if key not in self._meshes:
            self._meshes[key] = read_mesh(*key)
        return self._meshes[key]

    def tools(self, session: Session, source: SceneSource, parts: OwnParts) -> Toolbox:
        """The toolbox for an image; it reuses the parts of the last one where the settings are the same."""
        last = self._last
        if last is None or last.session != session or parts:
            self._last = Toolbox(session, source=source, own=parts)
        else:
            verifier, simulator, refiner = last.verifier, last.simulator, last.refiner
            self._last = Toolbox(session, source=source, verifier=verifier, simulator=simulator, refiner=refiner)
        return self._last

    def __reduce__(self) -> tuple[type[_Kept], tuple[()]]:
        return _Kept, ()  # Not pickled with a frame: all of it can be made again.


def _by_name(given: Any, what: str, objects: Sequence[str]) -> Mapping[str, Any]:
    """Masks or poses by the object's name; InputError where a name is unknown, or several objects share one."""
    by_name = checked_mapping({} if given is None else given, what, f"{what} by the object's name, or None")
    twice = next((name for name in objects if objects.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"the frame has several objects {twice!r}; make a new Frame of each image")
    for name in by_name:
        if name not in objects:
            raise InputError(f"{what}: {unknown('object', name, objects)}")
    return by_name


class OpenedFrame:
    """A frame of data on the disk; :func:`open_frame` and :func:`open_dataset` make them."""

    def __init__(
        self,
        path: Path | str | None,
        settings: Mapping[str, Any],
        source: SceneSource,
        frame: str,
        parts: OwnParts = NO_PARTS,
    ) -> None:
        self._path, self._settings, self._source, self._parts = path, settings, source, parts
        self.name = frame
        """Scene and image, as "50/1"."""

    def __repr__(self) -> str:
        return f"<OpenedFrame {self.name} of {self._path or 'a run'}>"

    @property
    def objects(self) -> tuple[str, ...]:
        """The names of the objects, in order.

        Raises:
            InputError: the frame cannot be read.
        """
        return tuple(target.model.name for target in self.problem().targets)

    def is_beside(self, other: OpenedFrame) -> bool:
        """Whether both frames were opened from the same data with the same settings.

        Args:
            other: the other frame.
        """
        return (self._path, self._settings) == (other._path, other._settings)

    def tools(self, sections: Mapping[str, Any]) -> tuple[Toolbox, str]:
        """The toolbox that solves the frame with settings by section, and the frame's id."""
        sections, parts = taken(sections)
        own = self._settings
        # Every setting is in a section, except the preset, which is a word.
        both = {name: {**own[name], **of} for name, of in sections.items() if name in own and isinstance(of, Mapping)}
        merged = {**own, **sections, **both}
        # The settings of a run's session hold every field, so no files are needed.
        session = load_session(None, merged, "settings") if self._path is None else session_at(self._path, merged)
        is_same = all(merged.get(name) == self._settings.get(name) for name in ("scene", "hypotheses"))
        return Toolbox(session, source=self._source if is_same else None, own=self._parts | parts), self.name

    def problem(self, **sections: Unpack[Sections]) -> Problem:
        """The frame as methods get it: observation, models, instances with their initial poses.

        Args:
            sections: settings, each section a dict as in a session file; they extend those the frame was opened with.

        Raises:
            VerefineError: the data or the settings cannot be used.
        """
        tools, frame = self.tools(sections)
        return tools.problem(frame)


AnyFrame = Frame | OpenedFrame


def check_frame(frame: object) -> None:
    """Raise InputError where something else is given in place of a frame."""
    if not isinstance(frame, Frame | OpenedFrame):
        raise ArgumentTypeError(
            f"frame is {described(frame)}, expected one made by Frame(K, depth_m, rgb) or open_frame(path)"
        )


_FIRST = tuple(dict.fromkeys(("method", "hypotheses", *Session.__struct_fields__)))
"""Sections in the order in which they are suggested for a setting that several have."""


def taken(sections: Mapping[str, Any]) -> tuple[dict[str, Any], OwnParts]:
    """The sections as in a settings file, and the user's own parts that were given in place of names.

    Raises:
        SettingsError: a keyword is not a section.
        InputError: an object given as a part is not one.
    """
    _check_sections(sections)
    named, parts = named_parts(sections)
    return plain_value(named), parts


def _check_sections(sections: Mapping[str, Any]) -> None:
    """Raise SettingsError where a keyword is not a section of the settings; it names a section with such a field."""
    known, defaults = Session.__struct_fields__, Session()
    checked_mapping(sections, "sections", "settings by section, as in a session file")
    for name, fields in sections.items():
        if name not in known:
            homes = [own for own in _FIRST if name in getattr(getattr(defaults, own), "__struct_fields__", ())]
            where = " or ".join(f"{home}={{{name!r}: …}}" for home in homes[:2])
            where = f"write {where}" if homes else unknown("section", name, known)
            raise SettingsError(f"{name}= is no section of the settings; {where}")
        if not isinstance(fields, Mapping) and isinstance(getattr(defaults, name), msgspec.Struct):
            raise SettingsError(f"{name} is {described(fields)}, expected {name}={{…}} as in a session file")
        if isinstance(fields, Mapping):
            checked_mapping(fields, name, f"{name}={{…}} with names of settings, as in a session file")


def open_frame(path: Path | str, frame: str = "", **sections: Unpack[Sections]) -> OpenedFrame:
    """Open a frame of a data set, a session, traces, a folder of another program, or a results file.

    Args:
        path: what ``verefine-viz view`` opens; or the name of a built-in scene.
        frame: the frame's name, "scene/image"; empty = the first.
        sections: settings, each section a dict as in a session file: ``scene={"split": "test"}``.

    Raises:
        InputError: there is no such frame.
        VerefineError: the data or the settings cannot be used.
    """
    checked_text(frame, "frame", 'its name, as "50/1", or ""')
    settings, parts = taken(sections)
    source = Toolbox(session_at(path, settings), own=parts).source
    if frame and frame not in source.frames:
        raise InputError(f"{unknown('frame', frame, source.frames)} ({path})")
    return OpenedFrame(path, settings, source, frame or source.frames[0], parts)


def open_dataset(path: Path | str, **sections: Unpack[Sections]) -> Iterator[OpenedFrame]:
    """Open the frames of a data set, one after the other.

    Args:
        path: what ``verefine-viz view`` opens; or the name of a built-in scene.
        sections: settings, each section a dict as in a session file: ``scene={"split": "test"}``.

    Returns:
        The frames, in the order of the data set; each is read when it is used.

    Raises:
        VerefineError: the data or the settings cannot be used.
    """
    settings, parts = taken(sections)
    source = Toolbox(session_at(path, settings), own=parts).source
    return (OpenedFrame(path, settings, source, frame, parts) for frame in source.frames)


def _to_trace(mesh: Mesh, folder: Path) -> Path | tuple[Any, ...]:
    """A mesh in metres as a trace takes it: arrays, or for a textured mesh a file with its image beside it."""
    if mesh.texture is None:
        return mesh.vertices_m, mesh.faces, mesh.vertex_colors
    path, image = folder / "mesh.ply", folder / "mesh.png"
    write_image(image, mesh.texture.image)
    with atomic(path) as part:
        part.write_bytes(ply_bytes(mesh.vertices_m, mesh.faces, mesh.vertex_colors, (image.name, mesh.texture.uv)))
    return path


def target_of(problem: Problem, name: str | int) -> Target:
    """The target with an object's name or instance_id; InputError where the frame has none, or several."""
    if isinstance(name, Integral) and not isinstance(name, bool):
        return problem.target(int(name))
    checked_text(name, "name", "an object's name, or its instance_id")
    own = [target for target in problem.targets if target.model.name == name]
    if not own:
        there = [target.model.name for target in problem.targets]
        why = next((one.why for one in problem.left_out if one.name == name), "")
        raise InputError(f"{name} cannot be solved: {why}" if why else unknown("object", name, there))
    if len(own) > 1:
        ids = ", ".join(str(target.instance.instance_id) for target in own)
        raise InputError(f"the frame has {len(own)} objects {name!r}; name one by its instance: {ids}")
    return own[0]


def session_at(path: Path | str, sections: Mapping[str, Any]) -> Session:
    """The session of the data at a path, or of a built-in scene.

    Raises:
        InputError: the path is a run or a batch; the error says what opens it.
        VerefineError: the data or the settings cannot be used.
    """
    folder = checked_path(path, "path", "what verefine-viz view opens, or the name of a built-in scene")
    if folder.suffix in (SUFFIX, ".rrd"):
        raise InputError(f"{path} is a run; open it by open_run, whose result has its frame")
    if (folder / RUN_FILE).is_file():
        raise InputError(f"{path} is a batch; open it by open_batch, whose runs have their frames")
    if isinstance(path, str) and not os.path.lexists(folder) and path in demo_names():
        return load_session(None, {**sections, "scene": {"demo": path, **sections.get("scene", {})}}, "settings")
    return open_session(folder, sections)


class _InMemory:
    """A recording of one frame, made of arrays; see :class:`~verefine_viz.scenes.recorded_frame.Recording`."""

    names, notes = ("frame",), ()
    is_sequence = False

    def __init__(self, recorded: RecordedFrame) -> None:
        self._recorded = recorded
        names = dict.fromkeys(one.name for one in recorded.objects)
        self.objects: Mapping[str, int] = {name: k for k, name in enumerate(names, 1)}
        self.has_poses = any(one.hypotheses for one in recorded.objects)
        self.has_truth = any(one.T_cam_obj_gt is not None for one in recorded.objects)

    def frame(self, name: str) -> RecordedFrame:
        return self._recorded

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        return {}
