"""Mesh files (PLY, OBJ, GLB, STL): geometry in metres, outward faces, colours at the vertices and textures."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from verefine_viz.core.arguments import described
from verefine_viz.core.arrays import Float, finite, frozen
from verefine_viz.core.errors import ArgumentTypeError, ContentError, InputError
from verefine_viz.core.files import id_of, reading
from verefine_viz.core.model import Texture
from verefine_viz.scenes.materials import MeshColours, MeshFiles, check_gltf, look_of
from verefine_viz.scenes.mesh_surface import edges, merged, turned_outward
from verefine_viz.trace import MESH

FORMATS = (".ply", ".obj", ".glb", ".gltf", ".stl")
"""Looked for in this order."""

Arrays: TypeAlias = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""Vertices (V, 3) and faces (F, 3) of a mesh, and colours (V, 3) as uint8 if it has any."""
AnyMesh: TypeAlias = Path | str | trimesh.Trimesh | trimesh.Scene | Arrays
"""A mesh file, or a mesh that is in memory."""
MAX_HULL_POINTS = 4000
"""Hull vertices above which the diameter is taken from the extreme points of many directions."""

HULL_AT_ONCE = 50_000
"""Most points of which a convex hull is made in one go, 0.1 GB."""

EXTREMES_AT_ONCE = 4000
"""Points among which extremes are looked for in one go, 0.06 GB."""

LARGEST_COORDINATE = 1e9
"""Coordinate of a vertex, in the unit of its file."""

# It logs what it cannot read, with a traceback; the notes of a mesh say it.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in its own frame."""

    vertices_m: Float
    """(V, 3) [m]."""
    faces: NDArray[np.int32]
    """(F, 3), counter-clockwise seen from outside."""
    vertex_colors: NDArray[np.uint8] | None
    """(V, 3) RGB, or None where the file has no colours; where it has a texture, the texture's colours there."""
    notes: tuple[str, ...] = ()
    """Texture missing, …"""
    texture: Texture | None = None

    @cached_property
    def diameter_m(self) -> float:
        """Largest distance between two vertices [m]."""
        return largest_distance(self.vertices_m)


MOST_HEAD_BYTES = 100_000
"""Bytes within which a PLY file's header ends."""


def mesh_files(folder: Path) -> dict[int, Path]:
    """The mesh file of each object of a folder, ``obj_000005.ply`` or with another number of zeros, by BOP id.

    Raises:
        InputError: two names are of the same object.
    """
    files: dict[int, list[Path]] = {}
    for path in folder.iterdir():
        obj_id = id_of(path.stem.removeprefix("obj_")) if path.stem.startswith("obj_") else None
        if obj_id is not None and path.suffix.lower() in FORMATS:
            files.setdefault(obj_id, []).append(path)
    for obj_id, paths in files.items():
        paths.sort(key=lambda path: (FORMATS.index(path.suffix.lower()), path.name))
        other = next((path for path in paths if path.stem != paths[0].stem), None)
        if other is not None:
            raise InputError(f"{paths[0]} and {other.name} are both object {obj_id}; rename or remove one of them")
    return {obj_id: paths[0] for obj_id, paths in sorted(files.items())}


def unit_of_format(path: Path) -> float:
    """Metres per unit of a model file in a BOP folder: glTF is in metres by its standard, all others in millimetres."""
    return 1.0 if path.suffix.lower() in (".glb", ".gltf") else 1e-3


def read_mesh(path: Path, unit_m: float) -> Mesh:
    """The mesh of a file, with its colours and its texture.

    Coincident vertices of open meshes are merged (texture seams, STL), faces are turned outwards.

    Args:
        path: PLY (ascii or binary), OBJ, GLB or STL.
        unit_m: metres per unit of the file (BOP: 1e-3).

    Raises:
        InputError: missing, damaged, no triangles, or coordinates that are not finite.
    """
    with reading(_mesh_file(path)) as file:
        beside = MeshFiles(path)
        vertices, faces, look = _loaded(file, path, beside)
        return _put_right(vertices, faces, look, beside, unit_m)


def mesh_of(given: trimesh.Trimesh | trimesh.Scene | Arrays, unit_m: float, name: str) -> Mesh:
    """A mesh that is in memory, as :func:`read_mesh` has that of a file.

    Args:
        given: a mesh or a scene of trimesh; or vertices (V, 3), faces (F, 3), and colours (V, 3) as uint8 if there are
            any.
        unit_m: metres per unit of its vertices.
        name: of what it is a mesh, in errors.

    Raises:
        InputError: it is none, has no triangles, or coordinates that are not finite.
    """
    beside = MeshFiles(Path.cwd())
    try:
        if isinstance(given, tuple | list):
            parts = [_of_arrays(given)]
        elif isinstance(given, trimesh.Scene):
            parts = _parts_of(given)
        elif isinstance(given, trimesh.Trimesh):
            parts = [(given, given.visual)]
        else:
            raise ArgumentTypeError(f"mesh of {name} is {described(given)}, expected {MESH}")
        beside.mesh = Path(f"mesh of {name}")
        vertices, faces = _joined(parts)
        return _put_right(vertices, faces, look_of(parts, beside), beside, unit_m)
    except ContentError as error:
        raise InputError(f"mesh of {name}: {error}") from None


def _of_arrays(given: Sequence[Any]) -> tuple[trimesh.Trimesh, Any]:
    if len(given) not in (2, 3):
        raise ContentError(f"{len(given)} arrays, expected (vertices, faces) or (vertices, faces, colours)")
    vertices = finite(given[0], "vertices", (None, 3))
    faces = frozen(given[1], "faces", (None, 3), np.int64)
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise ContentError("no faces, or faces that name vertices that do not exist")
    colours = None if len(given) < 3 or given[2] is None else np.asarray(given[2])
    if colours is not None and (colours.dtype != np.uint8 or colours.shape[:1] != (len(vertices),)):
        raise ContentError(f"colours are {colours.dtype} of shape {colours.shape}, expected uint8 of shape (V, 3)")
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)
    return mesh, mesh.visual


def _put_right(
    vertices: Float, faces: NDArray[np.integer], look: MeshColours | None, beside: MeshFiles, unit_m: float
) -> Mesh:
    """The mesh with coincident vertices merged where it is open, and faces turned outwards."""
    colors, image, uv = (None, None, None) if look is None else (look.vertices, look.image, look.uv)
    if not (np.unique(edges(faces), return_counts=True)[1] == 2).all():
        vertices, faces, colors, is_whole = merged(vertices, faces, colors)
        uv = None if uv is None else uv[is_whole]
    if not len(faces):
        raise ContentError("all its triangles are degenerate: it has no surface")
    turned = turned_outward(vertices, faces)
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    skin = None if image is None or uv is None else Texture(image, np.where(turned[:, None, None], uv[:, ::-1], uv))
    notes = tuple(f"{fault}; the model is drawn in one colour" for fault in beside.faults[:1]) or tuple(beside.notes)
    return Mesh(vertices * unit_m, faces.astype(np.int32), colors, notes, skin)


def read_geometry(path: Path) -> tuple[Float, NDArray[np.int32]]:
    """Vertices (V, 3), every one that the file has, in its order and unit, and faces (F, 3) as they are.

    Raises:
        InputError: as :func:`read_mesh`.
    """
    with reading(_mesh_file(path)) as file:
        vertices, faces, _ = _loaded(file, path)
        file.seek(0)
        exact = _ascii_vertices(file)
        if exact is not None and exact.shape == vertices.shape:
            vertices = exact
        return vertices, faces.astype(np.int32)


def _ascii_vertices(file: BinaryIO) -> Float | None:
    """The vertices of an ascii PLY in double precision (trimesh rounds them to single); None for any other file."""
    head = file.read(MOST_HEAD_BYTES).partition(b"end_header")[0].decode("latin-1")
    first = re.search(r"^element\s+vertex\s+(\d+)((?:\s+property.*)*)", head, re.MULTILINE)
    if "format ascii" not in head or first is None or head.find("element") != first.start():
        return None  # Other elements come before the vertices.
    names = [line.split()[-1] for line in first[2].strip().splitlines()]
    file.seek(0)
    lines = io.TextIOWrapper(file, "latin-1")
    while not next(lines).startswith("end_header"):
        pass
    body = (line for line in lines if line.strip())
    vertices = np.loadtxt(islice(body, int(first[1])), usecols=[names.index(axis) for axis in "xyz"], ndmin=2)
    lines.detach()
    return vertices


def largest_distance(points: Float) -> float:
    """The largest distance between two of the points (N, 3)."""
    hull = points[hull_vertices(points)]
    if len(hull) > MAX_HULL_POINTS:
        # A Fibonacci sphere: extremes along 2000 directions miss the true diameter by < 0.1 %.
        k = np.arange(2000) + 0.5
        phi, z = np.pi * (1 + 5**0.5) * k, 1 - k / 1000
        r = np.sqrt(1 - z * z)
        directions = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
        farthest, extreme = np.full(len(directions), -np.inf), np.zeros(len(directions), np.intp)
        for start in range(0, len(hull), EXTREMES_AT_ONCE):
            along = directions @ hull[start : start + EXTREMES_AT_ONCE].T
            own, at = along.max(axis=1), along.argmax(axis=1)
            extreme = np.where(own > farthest, start + at, extreme)
            farthest = np.maximum(own, farthest)
        hull = hull[np.unique(extreme)]
    return float(pdist(hull).max(initial=0.0))


def hull_vertices(points: Float) -> NDArray[np.intp]:
    """Indices of points (N, 3) that hold those that span the convex hull: exactly those, unless they are very many.

    The hull of a million points takes gigabytes, so that of so many is put together from those of samples.
    """
    n = -(-len(points) // HULL_AT_ONCE)
    if n <= 1:
        return _hull_at_once(points)
    # Samples of every n-th point have the shape of the whole, so that few of their hulls' vertices are inside of it.
    outer = np.concatenate([k + n * _hull_at_once(points[k::n]) for k in range(n)])
    return outer if len(outer) > HULL_AT_ONCE else outer[_hull_at_once(points[outer])]


def _hull_at_once(points: Float) -> NDArray[np.intp]:
    try:
        return ConvexHull(points).vertices.astype(np.intp)
    except (QhullError, ValueError):
        return np.arange(len(points))  # flat or a line: no hull in 3D


def _mesh_file(path: Path) -> Path:
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path} is no mesh file; supported: {', '.join(f[1:] for f in FORMATS)}")
    return path


def _loaded(
    file: BinaryIO, path: Path, beside: MeshFiles | None = None
) -> tuple[Float, NDArray[np.integer], MeshColours | None]:
    """Vertices, faces and, with ``beside``, colours as trimesh reads them, which checks neither that they are whole."""
    kind = path.suffix.lower()
    header = file.read(MOST_HEAD_BYTES).split(b"end_header")[0] if kind == ".ply" else b""
    file.seek(0)
    if kind == ".ply":
        _check_ply(header)
    source = io.BytesIO(beside.with_materials(file.read())) if kind == ".obj" and beside is not None else file
    with warnings.catch_warnings(), np.errstate(all="ignore"):  # Its numbers are checked below.
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        scene = trimesh.load_scene(
            source, kind[1:], resolver=beside or MeshFiles(path), process=False, skip_materials=beside is None
        )
    parts = _parts_of(scene)
    vertices, faces = _joined(parts)
    promised = re.search(rb"^element\s+face\s+(\d+)", header, re.MULTILINE)
    if promised and len(faces) < int(promised[1]):
        raise ContentError(f"it ends after {len(faces)} of {int(promised[1])} faces; fetch it again")
    if beside is None:
        return vertices, faces, None
    if header.count(b"TextureFile") > 1:
        beside.faults.append(f"{path.name} names several textures, of which one is read")
    if kind in (".gltf", ".glb"):
        file.seek(0)
        check_gltf(file, scene, beside)
    return vertices, faces, look_of(parts, beside)


def _parts_of(scene: trimesh.Scene) -> list[tuple[trimesh.Trimesh, Any]]:
    """The meshes of a scene where they stand in it, each with its visual."""
    parts: list[tuple[trimesh.Trimesh, Any]] = []
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        if isinstance(scene.geometry[name], trimesh.Trimesh):
            parts.append((scene.geometry[name].copy().apply_transform(T), scene.geometry[name].visual))
    return parts


def _joined(parts: Sequence[tuple[trimesh.Trimesh, Any]]) -> tuple[Float, NDArray[np.integer]]:
    """Vertices and faces of all parts; ContentError where they are no mesh."""
    if sum(len(mesh.faces) for mesh, _ in parts) == 0:
        raise ContentError("no triangles; a triangle mesh is expected, not a point cloud")
    before = np.cumsum([0] + [len(mesh.vertices) for mesh, _ in parts])
    vertices = np.concatenate([np.asarray(mesh.vertices, dtype=np.float64) for mesh, _ in parts])
    faces = np.concatenate([np.asarray(mesh.faces) + start for (mesh, _), start in zip(parts, before, strict=False)])
    if not np.abs(vertices).max() < LARGEST_COORDINATE:
        raise ContentError(f"vertices that are NaN or beyond ±{LARGEST_COORDINATE:g}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ContentError("faces that name vertices that do not exist; fetch it again")
    return vertices, faces


def _check_ply(header: bytes) -> None:
    """Raise ContentError where a PLY file's header lacks what a mesh needs."""
    if not header.startswith(b"ply"):
        raise ContentError("it does not begin as a PLY file does: it is damaged, or of another kind")
    vertex = re.search(rb"^element\s+vertex\s+\d+((?:\s*^(?:property|comment).*$)*)", header, re.MULTILINE)
    names = {line.split()[-1] for line in vertex[1].splitlines() if line.strip()} if vertex is not None else set()
    lacking = [axis for axis in ("x", "y", "z") if axis.encode() not in names]
    if vertex is None or lacking:
        what = "vertices" if vertex is None else " and ".join(lacking)
        raise ContentError(f"the PLY has no {what}; expected vertices with x, y and z, and faces")
    faces = re.search(rb"^element\s+face\s+\d+((?:\s*^(?:property|comment).*$)*)", header, re.MULTILINE)
    if faces is not None and not re.search(
        rb"^property\s+list\s+\S+\s+\S+\s+vertex_ind(?:ex|ices)\b", faces[1], re.MULTILINE
    ):
        raise ContentError("the PLY has no vertex_indices in its faces; expected a list of them")


def size_entry(vertices_m: Float, diameter_m: float) -> dict[str, Any]:
    """The size of a model [mm], as in models_info.json."""
    low, high = vertices_m.min(axis=0) * 1e3, vertices_m.max(axis=0) * 1e3
    entry: dict[str, Any] = {"diameter": diameter_m * 1e3}
    entry |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    entry |= {f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)}
    return entry
