"""Records what a refiner of your own does to a frame, call by call, to view it later.

    with Trace("runs/drop_17", K=K, depth_m=depth_m, rgb=rgb) as trace:
        mug = trace.object("mug", mesh="mug.stl", mask=mask, unit_m=0.001)
        mug.hypothesis(0, T_cam_obj, score=0.7)
        mug.step(0, T_cam_obj, score=0.8, ms=12.0)
        mug.answer(T_cam_obj)

and then ``verefine-viz view runs/drop_17``. Only numpy is imported, and Python 3.8 is enough, so that a copy of this
file will do where verefine-viz cannot be installed. No call raises once the trace exists: what cannot be written is
counted and reported at the end. Each call appends one line to a file and returns when the operating system has it: a
process that is killed loses nothing that it wrote. Read by ``scenes/trace_files.py``.
"""

from __future__ import annotations

import json
import logging
import math
import os
import re
import shutil
import time
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from urllib.parse import unquote

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType
    from typing import Concatenate, ParamSpec, Self, TypeVar

    P = ParamSpec("P")
    S = TypeVar("S", bound="Trace | TracedObject")

_LOG = logging.getLogger(__name__)
CALLS = "calls.jsonl"
"""A JSON object per call; the first line is about the frame."""
FORMAT = 1
RIGID_TOLERANCE = 0.05
"""Largest deviation of RᵀR from the identity in a pose that is written; the reader takes the nearest rotation."""
LEAST_FOCAL = 0.05
"""Least focal length as a share of the image's width: that of a lens of 168°."""
FARTHEST_M = 60.0
"""Largest median depth and distance of a pose [m]; larger ones are probably in millimetres."""
SHOWN = 3
"""Most problems that are reported in full."""
MESH = "a PLY, OBJ, GLB or STL file, a mesh of trimesh, or (vertices, faces[, colours])"
"""Accepted kinds of a mesh, in words."""
COPIED = (".mtl", ".bin", ".png", ".jpg", ".jpeg", ".bmp", ".gif", ".tga", ".tif", ".tiff", ".webp")
"""Files that are copied with the mesh that names them."""


def _never_raises(call: Callable[Concatenate[S, P], None]) -> Callable[Concatenate[S, P], None]:
    """Return the call, which counts errors instead of raising them."""

    def guarded(self: S, *args: P.args, **kwargs: P.kwargs) -> None:
        try:
            call(self, *args, **kwargs)
        except Exception as error:
            self.problem(f"{call.__name__}: {error}")

    guarded.__name__, guarded.__doc__ = call.__name__, call.__doc__
    return guarded


class Trace:
    """One frame and what a refiner did in it.

    Args:
        folder: folder of the trace, which is made. Where it holds a trace, the next free name beside it is used.
        K: (3, 3) intrinsics [px].
        depth_m: (H, W) z [m]; 0, NaN or infinity where nothing was measured.
        rgb: (H, W, 3) uint8, or None.
        gravity_cam: (3,) direction in which things fall, in the camera's frame; None = along the normal of the table.

    Raises:
        ValueError: K, depth_m, rgb or gravity_cam is invalid; one line says what was expected.
        OSError: the folder cannot be written.
    """

    def __init__(self, folder: Path | str, K: Any, depth_m: Any, rgb: Any = None, gravity_cam: Any = None) -> None:
        if not isinstance(folder, (str, os.PathLike)) or not isinstance(os.fspath(folder), str):
            raise ValueError(f"folder is of type {type(folder).__name__}, expected a path")
        depth, photo = _depth(depth_m), None if rgb is None else _array(rgb)
        intrinsics = _intrinsics(K, depth.shape[1])
        if photo is not None and (photo.dtype != np.uint8 or photo.shape != (*depth.shape, 3)):
            raise ValueError(
                f"rgb is {photo.dtype} of shape {photo.shape}, expected uint8 of shape {(*depth.shape, 3)}, as depth_m"
            )
        try:
            down = None if gravity_cam is None else _axis(gravity_cam)
        except ValueError as error:
            raise ValueError(f"gravity_cam: {error}") from None
        self.n_problems = 0
        """Calls, or parts of them, that could not be written."""
        self._problems: list[str] = []
        self._has_warned = False
        """Whether it has warned of a call after the end."""
        self._n_objects = 0
        self._shape = depth.shape
        self._started = time.perf_counter()
        self.folder, self._file = _claimed(Path(folder))
        """Folder of the trace, and its file of calls."""
        _save(self.folder / "depth.npy", depth)
        if photo is not None:
            _save(self.folder / "rgb.npy", photo)
        self._append(
            {
                "trace": FORMAT,
                "started": time.time(),
                "K": intrinsics.tolist(),
                "shape": depth.shape,
                "rgb": photo is not None,
                "gravity_cam": down,
            }
        )
        if intrinsics[0, 1]:
            self.problem(f"K has a skew of {intrinsics[0, 1]:.4g} px, which is not used")
        if self.folder != Path(folder):
            self.problem(f"{folder} holds a trace, or its own depth.npy or rgb.npy; this one is in {self.folder}")

    def object(
        self,
        name: str,
        mesh: Any,
        mask: Any = None,
        unit_m: float = 1.0,
        truth: Any = None,
        symmetry_axis: Any = None,
    ) -> TracedObject:
        """Add an object of the frame; its steps are then recorded through the result.

        Args:
            name: the same in all traces of this object.
            mesh: PLY, OBJ, GLB or STL file, which is copied with its texture; or a mesh of trimesh; or
                (vertices, faces) or (vertices, faces, colours), arrays (V, 3), (F, 3) and (V, 3) uint8.
            mask: (H, W) its visible pixels: all that is not 0, no labels of several objects; None = those that its
                first pose covers.
            unit_m: metres per unit of the mesh.
            truth: (4, 4) ground truth of T_cam_obj [m], or None.
            symmetry_axis: (3,) through the middle of the mesh's box; every turn about it looks the same. None = none.
        """
        number = self._n_objects
        self._n_objects += 1
        try:
            name = str(name)
        except Exception:
            name = f"object {number}"
        self._begin_object(number, name, mesh, mask, unit_m, truth, symmetry_axis)
        return TracedObject(self, number, name)

    @_never_raises
    def _begin_object(
        self, number: int, name: str, mesh: Any, mask: Any, unit_m: float, truth: object, axis: object
    ) -> None:
        line: dict[str, Any] = {
            "object": number,
            "name": name,
            "mesh": "",
            "unit_m": 1.0,
            "mask": "",
            "truth": None,
        }
        try:
            if not (isinstance(unit_m, Real) and 0 < unit_m < math.inf):
                raise ValueError(f"unit_m is {unit_m!r}, expected metres per unit of the mesh, as 0.001")
            line["unit_m"] = float(unit_m)
            own = self.folder / f"mesh_{number}"
            file_name = Path(mesh).name if isinstance(mesh, (str, os.PathLike)) else "mesh.ply"
            missing = _copy_mesh(Path(mesh), own) if isinstance(mesh, (str, os.PathLike)) else _write_mesh(mesh, own)
            line["mesh"] = f"mesh_{number}/{file_name}"
            for file in missing:
                self.problem(f"mesh of {name}: {file}, which it names, cannot be copied; the mesh may lose its colours")
        except Exception as error:
            self.problem(f"mesh of {name}: {error}")
        try:
            if mask is not None:
                values = np.nan_to_num(_array(mask))
                inside = values != 0
                if inside.shape != self._shape or not inside.any():
                    what = "empty" if inside.shape == self._shape else f"of shape {inside.shape}"
                    raise ValueError(f"it is {what}, expected pixels of the object in shape {self._shape}, as depth_m")
                # Whole numbers stay as they are: labels of several objects are named when the trace is opened.
                _save(self.folder / f"mask_{number}.npy", values if values.dtype.kind in "iu" else inside)
                line["mask"] = f"mask_{number}.npy"
        except Exception as error:
            self.problem(f"mask of {name}: {error}")
        try:
            line["truth"] = None if truth is None else _pose(truth)
        except Exception as error:
            self.problem(f"truth of {name}: {error}")
        try:
            line["axis"] = None if axis is None else _axis(axis)
        except (TypeError, ValueError) as error:
            self.problem(f"symmetry_axis of {name}: {error}")
        self._append(line)

    def problem(self, text: str) -> None:
        """Count something that could not be written, and record that."""
        text = "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))  # Printable on any terminal.
        self.n_problems += 1
        if self._file < 0:
            if not self._has_warned:  # A loop may go on for hours.
                _LOG.warning("trace %s: %s; further calls are counted only", self.folder, text)
            self._has_warned = True
        elif len(self._problems) < SHOWN:
            self._problems.append(text)
        try:
            if self._file >= 0:
                self._append({"problem": text})
        except Exception:  # The disk is full: the count is all that is left.
            return

    @_never_raises
    def close(self) -> None:
        """End the trace and report what could not be written; later calls are only counted."""
        if self._file < 0:
            return
        self._append({"closed": True, "problems": self.n_problems})
        file, self._file = self._file, -1
        os.close(file)
        if self.n_problems:
            more = f" (and {self.n_problems - SHOWN} more)" if self.n_problems > SHOWN else ""
            _LOG.warning("trace %s: problems (%d): %s%s", self.folder, self.n_problems, "; ".join(self._problems), more)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is not None:
            self.problem(f"the program ended early: {kind.__name__ if kind else ''}: {error}")
        self.close()

    def elapsed_s(self) -> float:
        """Time since the trace began [s]."""
        return time.perf_counter() - self._started

    def write(self, line: dict[str, Any]) -> None:
        """Append a line.

        Raises:
            ValueError: the trace is closed.
            OSError: the disk does not take it.
        """
        if self._file < 0:
            raise ValueError("the trace is closed")
        self._append(line)

    def _append(self, line: dict[str, Any]) -> None:
        os.write(self._file, json.dumps(line, allow_nan=False, separators=(",", ":")).encode() + b"\n")


class TracedObject:
    """One object of a trace."""

    def __init__(self, trace: Trace, number: int, name: str) -> None:
        self._trace, self._number, self._name = trace, number, name

    @_never_raises
    def hypothesis(self, h: int, T_cam_obj: Any, score: Any = None, name: str = "") -> None:
        """Record initial pose ``h`` (4, 4) [m], with its score in the units of its program, and its source."""
        line = {"hypothesis": _whole(h), "object": self._number, "T": _pose(T_cam_obj), "name": str(name)}
        self._trace.write(line | self._score(score))

    @_never_raises
    def step(
        self,
        h: int,
        T_cam_obj: Any,
        score: Any = None,
        ms: float | None = None,
        name: str = "refined",
        note: str = "",
    ) -> None:
        """Record a step of hypothesis ``h``, by its new pose (4, 4) [m].

        Args:
            h: which hypothesis.
            T_cam_obj: the pose after the step.
            score: of the pose, in the units of the program that refines.
            ms: how long the step took.
            name: what the step is called.
            note: anything about it.
        """
        line = {"step": _whole(h), "object": self._number, "T": _pose(T_cam_obj), "name": str(name), "note": str(note)}
        line["at_s"] = round(self._trace.elapsed_s(), 6)
        if ms is not None:
            line["ms"] = max(_finite(ms, "ms"), 0.0)
        self._trace.write(line | self._score(score))

    @_never_raises
    def answer(self, T_cam_obj: Any, score: Any = None) -> None:
        """Record the pose (4, 4) [m] that the program answers with."""
        self._trace.write({"answer": True, "object": self._number, "T": _pose(T_cam_obj), **self._score(score)})

    def problem(self, text: str) -> None:
        """Count something of this object that could not be written."""
        self._trace.problem(f"{self._name}: {text}")

    def _score(self, score: Any) -> dict[str, float]:
        """A score that is no number is a problem, but the pose is written."""
        try:
            return {} if score is None else {"score": _finite(score, "score")}
        except (TypeError, ValueError) as error:
            self.problem(str(error))
            return {}


def _array(values: Any) -> np.ndarray:
    """A value as an array of numpy; tensors of torch are copied from the device."""
    return np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)


def _finite(value: Any, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {value!r}, expected a finite number")
    return number


def _whole(h: Any) -> int:
    try:
        return int(h)
    except (TypeError, ValueError):
        raise ValueError(f"h is {h!r}, expected the number of a hypothesis") from None


def _pose(T_cam_obj: Any) -> list[float]:
    """A pose as a list, row by row.

    Raises:
        ValueError: the pose is no rigid transform in metres.
    """
    T = _numbers(T_cam_obj, "the pose", (4, 4))
    if T.shape != (4, 4):
        raise ValueError(f"the pose has shape {T.shape}, expected (4, 4)")
    values = T.ravel().tolist()
    if not all(map(math.isfinite, values)):
        raise ValueError("the pose is not finite")
    R = T[:3, :3]
    off, determinant = float(np.abs(R.T @ R - np.eye(3)).max()), float(np.linalg.det(R))
    if off > RIGID_TOLERANCE or determinant < 0 or values[12:] != [0, 0, 0, 1]:
        wrong = "a mirror image" if determinant < 0 else f"RᵀR is {off:.2g} from the identity"
        raise ValueError(f"the pose is not rigid ({wrong}), expected a rotation, and 0 0 0 1 as the last row")
    if math.hypot(*values[3:12:4]) > FARTHEST_M:
        raise ValueError(f"the pose is {math.hypot(*values[3:12:4]):.3g} m away, expected metres")
    return values


def _axis(given: Any) -> list[float]:
    axis = _numbers(given, "the axis", (3,))
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise ValueError("it is no direction, expected 3 finite numbers that are not all 0")
    return axis.tolist()


def _numbers(values: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    try:
        return _array(values).astype(np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is no array of numbers, expected {shape}") from None


def _intrinsics(K: Any, width: int) -> np.ndarray:
    if K is None:
        raise ValueError("K is missing, expected the camera matrix, (3, 3) [px]")
    matrix = _numbers(K, "K", (3, 3))
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise ValueError(f"K has shape {matrix.shape}, expected (3, 3) finite numbers with focal lengths > 0 [px]")
    if matrix[1, 0] or matrix[2].tolist() != [0, 0, 1]:
        raise ValueError("K is no camera matrix, expected rows fx s cx, 0 fy cy and 0 0 1; is it transposed?")
    if min(matrix[0, 0], matrix[1, 1]) < LEAST_FOCAL * width:
        raise ValueError(
            f"K has focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g} for images {width} px wide, expected pixels; "
            "multiply a normalised K by the image's width and height"
        )
    return matrix


def _depth(depth_m: Any) -> np.ndarray:
    if depth_m is None:
        raise ValueError("depth_m is missing, expected an image (H, W) [m]")
    depth = _array(depth_m)
    if depth.dtype.kind not in "fiub":
        raise ValueError("depth_m is no array of numbers, expected an image (H, W) [m]")
    if depth.ndim != 2 or depth.size == 0 or depth.dtype.kind == "b":
        raise ValueError(f"depth_m is {depth.dtype} of shape {depth.shape}, expected numbers of shape (H, W)")
    if depth.dtype.kind in "iu":
        raise ValueError(f"depth_m is {depth.dtype}, expected metres as floats; divide millimetres by 1000")
    metres = np.nan_to_num(depth.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    if not (metres > 0).any() or metres.min() < 0:
        raise ValueError(
            "depth_m has no measured pixel, or negative ones; expected metres, 0 where nothing was measured"
        )
    median = float(np.median(metres[metres > 0]))
    if median > FARTHEST_M:
        raise ValueError(f"depth_m has a median of {median:.4g}, expected metres; divide millimetres by 1000")
    return metres


def _claimed(folder: Path) -> tuple[Path, int]:
    """The folder, or the first of folder-2, folder-3, … without a trace, and its new file of calls."""
    for free in (folder, *(folder.with_name(f"{folder.name}-{k}") for k in range(2, 1000))):
        try:
            free.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise NotADirectoryError(f"{str(free)!r} is a file, expected a folder for the trace") from None
        except OSError as error:
            raise type(error)(f"{str(free)[:200]!r} cannot be made: {error.strerror}") from None
        if any(os.path.lexists(free / name) for name in ("depth.npy", "rgb.npy")):
            continue  # The folder is used for something else.
        try:
            return free, os.open(free / CALLS, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o666)
        except FileExistsError:
            continue
    raise FileExistsError(f"{folder} and a thousand names after it hold traces")


def _save(file: Path, values: Any) -> None:
    """Write an array to a new file; FileExistsError where there is one, or a link, which may lead to anything."""
    with file.open("xb") as target:
        np.save(target, values)


def _copy_mesh(mesh: Path, folder: Path) -> list[str]:
    """Copy a mesh and the files that it names (materials, textures, buffers); return names that cannot be copied."""
    if not mesh.is_file():
        raise OSError(f"{mesh} is no file, expected a PLY, OBJ, GLB or STL file")
    mesh = Path(os.path.abspath(mesh))  # noqa: PTH100 – the name of a link counts.
    folder.mkdir()
    shutil.copyfile(mesh, folder / mesh.name)
    copies = {mesh: folder / mesh.name}
    missing: list[str] = []
    waiting = [(mesh, name) for name in _named_files(mesh)]
    while waiting:
        path, name = waiting.pop()
        file = file_beside([path.parent, mesh.parent], name)
        if file in copies:
            continue
        try:
            if file is None or file.suffix.lower() not in COPIED:
                raise OSError("missing, or of an unknown kind")
            copy = folder / (file.relative_to(mesh.parent) if mesh.parent in file.parents else file.name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            with file.open("rb") as source, copy.open("xb") as target:  # Another file may already have this name.
                shutil.copyfileobj(source, target)
            copies[file] = copy
            waiting += [(file, other) for other in _named_files(file)]
        except OSError:
            missing.append(name)
    return missing


def _write_mesh(mesh: Any, folder: Path) -> list[str]:
    """Write a mesh from memory to a PLY file; return an empty list, as no other file belongs to it."""
    parts = tuple(mesh) if isinstance(mesh, (tuple, list)) else _parts_of(mesh)
    if len(parts) not in (2, 3):
        raise TypeError(f"it is of type {type(mesh).__name__}, expected {MESH}")
    vertices, faces = _numbers(parts[0], "the vertices", (-1, 3)), _numbers(parts[1], "the faces", (-1, 3))
    colours = None if len(parts) < 3 or parts[2] is None else _array(parts[2])
    if vertices.ndim != 2 or faces.ndim != 2 or vertices.shape[1] != 3 or faces.shape[1] != 3 or not len(faces):
        raise ValueError(f"vertices {vertices.shape} and faces {faces.shape}, expected (V, 3) and (F, 3)")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("vertices that are not finite, or faces that name vertices that do not exist")
    if colours is not None and (
        colours.dtype != np.uint8 or colours.shape not in ((len(vertices), 3), (len(vertices), 4))
    ):
        raise ValueError(f"colours are {colours.dtype} of shape {colours.shape}, expected uint8 of shape (V, 3)")
    folder.mkdir()
    (folder / "mesh.ply").write_bytes(ply_bytes(vertices, faces.astype(np.int32), colours))
    return []


def _parts_of(mesh: Any) -> tuple[Any, ...]:
    """Vertices, faces and colours of a mesh of trimesh; empty for any other object."""
    if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
        return ()
    look: Any = getattr(mesh, "visual", None)
    kind = getattr(look, "kind", None)
    colours = look.to_color().vertex_colors if kind == "texture" else look.vertex_colors if kind == "vertex" else None
    return mesh.vertices, mesh.faces, None if colours is None else np.asarray(colours, np.uint8)


def ply_bytes(vertices: Any, faces: Any, colours: Any = None, texture: Any = None) -> bytes:
    """The content of a PLY file; coordinates are doubles, so that the vertices come back as they were.

    Args:
        vertices: (V, 3), in the unit of the file.
        faces: (F, 3) vertex indices.
        colours: (V, 3) RGB, or None.
        texture: the name of its image beside the file, and where each face's corners lie in it (F, 3, 2), with u to the
            right and v up; or None.
    """
    fields = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    if colours is not None:
        fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    points = np.empty(len(vertices), dtype=fields)
    for k, axis in enumerate("xyz"):
        points[axis] = vertices[:, k]
    if colours is not None:
        for k, channel in enumerate(("red", "green", "blue")):
            points[channel] = colours[:, k]
    corners: list[Any] = [("n", "u1"), ("vertex_indices", "<i4", 3)]
    comment = lists = ""
    if texture is not None:
        corners += [("n_uv", "u1"), ("texcoord", "<f4", 6)]
        comment, lists = f"comment TextureFile {texture[0]}\n", "property list uchar float texcoord\n"
    records = np.empty(len(faces), dtype=corners)
    records["n"], records["vertex_indices"] = 3, faces
    if texture is not None:
        records["n_uv"], records["texcoord"] = 6, texture[1].reshape(-1, 6)
    properties = "".join(f"property {'uchar' if kind == 'u1' else 'double'} {name}\n" for name, kind in fields)
    header = (
        f"ply\nformat binary_little_endian 1.0\n{comment}element vertex {len(points)}\n{properties}"
        f"element face {len(records)}\nproperty list uchar int vertex_indices\n{lists}end_header\n"
    )
    return header.encode("ascii") + points.tobytes() + records.tobytes()


def _named_files(path: Path) -> list[str]:
    """Names of files in a mesh or a material file, without which colours are lost."""
    kind = path.suffix.lower()
    if kind in (".gltf", ".glb"):
        try:
            with path.open("rb") as file:
                header = gltf_header(file)
            uris = [one.get("uri", "data:") for key in ("buffers", "images") for one in header.get(key, [])]
            return [uri for uri in uris if not uri.startswith("data:")]
        except Exception:  # Damaged, which its reader reports.
            return []
    if kind == ".ply":
        with path.open("rb") as file:
            return lines_that_name(file.read(100_000).partition(b"end_header")[0], rb"comment\s+TextureFile")
    if kind == ".mtl":
        return lines_that_name(path.read_bytes(), b"map_Kd")
    if kind != ".obj":
        return []
    names = lines_that_name(path.read_bytes(), b"mtllib")
    own = path.with_suffix(".mtl")
    return [one for name in names for one in material_files([path.parent], name)] or [own.name] * own.is_file()


# Names in mesh files; scenes/materials.py reads them as well.


def lines_that_name(content: bytes, key: bytes) -> list[str]:
    """The rest of each line of a file that begins with ``key``."""
    lines = re.findall(rb"^[ \t]*" + key + rb"[ \t]+([^\r\n]*[^\r\n\s])", content, re.MULTILINE | re.IGNORECASE)
    return [line.decode("utf-8", "surrogateescape") for line in lines]


def material_files(folders: Sequence[Path], name: str) -> list[str]:
    """The names in a line of an OBJ file: one name, which may have spaces, or several."""
    return [name] if file_beside(folders, name) else name.split()


def file_beside(folders: Sequence[Path], name: str) -> Path | None:
    """The file that a mesh or material file in one of the folders names.

    The name may follow options, as in ``-clamp on skin.png``, and may be spelled as in a web address, with backslashes
    or in other case. Where its path does not exist, as on another machine, only its last part is looked for.
    """
    starts = [0, *(space.end() for space in re.finditer(r"\s+", name[:1000]) if name.startswith("-"))]
    names = [one.strip('"').replace("\\", "/") for k in starts for one in (name[k:], unquote(name[k:]))]
    for relative in [way for one in names for way in (one, one.rsplit("/", 1)[-1])]:
        for folder in folders:
            try:
                path = _match_ignoring_case(folder, relative)
                if path is not None and path.is_file():
                    return Path(os.path.abspath(path))  # noqa: PTH100
            except (OSError, ValueError):  # Not a valid file name.
                continue
    return None


def _match_ignoring_case(folder: Path, relative: str) -> Path | None:
    path = folder
    for part in Path(relative).parts:
        following = path / part
        if not following.exists():
            others = path.iterdir() if path.is_dir() else ()
            following = next((other for other in others if other.name.casefold() == part.casefold()), None)
            if following is None:
                return None
        path = following
    return path


def gltf_header(file: BinaryIO) -> dict[str, Any]:
    """The JSON of a .gltf or .glb file, read from its beginning."""
    head = file.read(20)
    if head[:4] == b"glTF":
        return json.loads(file.read(int.from_bytes(head[12:16], "little")))
    return json.loads(head + file.read())
