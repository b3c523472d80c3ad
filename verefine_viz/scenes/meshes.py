"""Mesh files (PLY, OBJ, GLB, STL): geometry in metres, outward faces, colours at the vertices."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist
from trimesh.visual import TextureVisuals

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError

FORMATS = (".ply", ".obj", ".glb", ".gltf", ".stl")
"""Looked for in this order."""

MAX_HULL_POINTS = 4000
"""Hull vertices above which the diameter is taken from the extreme points of many directions."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in its own frame."""

    vertices_m: Float
    """(V, 3) [m]."""
    faces: NDArray[np.int32]
    """(F, 3), counter-clockwise seen from outside."""
    vertex_colors: NDArray[np.uint8] | None
    """(V, 3) RGB, or None where the file has no colours."""
    notes: tuple[str, ...] = ()
    """Things a person should know: texture missing, …"""

    @property
    def diameter_m(self) -> float:
        """Largest distance between two vertices [m]."""
        return largest_distance(self.vertices_m)


def unit_of_format(path: Path) -> float:
    """Metres per unit of a model file in a BOP folder: glTF is in metres by its standard, all others in millimetres."""
    return 1.0 if path.suffix.lower() in (".glb", ".gltf") else 1e-3


def read_mesh(path: Path, unit_m: float) -> Mesh:
    """The mesh of a file; textures are sampled at the vertices.

    Coincident vertices of open meshes are merged (texture seams, STL), faces are turned outwards.

    Args:
        path: PLY (ascii or binary), OBJ, GLB or STL.
        unit_m: metres per unit of the file (BOP: 1e-3).

    Raises:
        InputError: missing, damaged, no triangles, or coordinates that are not finite.
    """
    _check_file(path)
    texture = _texture_name(path)
    notes = _texture_notes(path, texture)
    # An image that cannot be used is kept from trimesh, which would log a traceback.
    loaded = _loaded(path, skip_materials=bool(notes))
    bare = path.suffix.lower() == ".ply" and texture is None and isinstance(loaded.visual, TextureVisuals)
    colors = None if notes or bare else _baked_colors(loaded)
    vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces)
    if not loaded.is_watertight:
        vertices, faces, colors = _merged(vertices, faces, colors)
    faces = _outward(vertices, faces)
    return Mesh(vertices * unit_m, faces.astype(np.int32), colors, notes)


def read_geometry(path: Path) -> tuple[Float, NDArray[np.int32]]:
    """Vertices (V, 3), every one that the file has, in its order and unit, and faces (F, 3) as they are.

    Numbers of ascii files keep all their digits, as the official toolkit reads them.

    Raises:
        InputError: as :func:`read_mesh`.
    """
    _check_file(path)
    loaded = _loaded(path, skip_materials=True)
    vertices = np.asarray(loaded.vertices, dtype=np.float64)
    written = _ascii_vertices(path)
    if written is not None and written.shape == vertices.shape:
        vertices = written
    return vertices, np.asarray(loaded.faces).astype(np.int32)


def largest_distance(points: Float) -> float:
    """The largest distance between two of the points (N, 3)."""
    try:
        hull = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        hull = np.unique(points, axis=0)  # flat or a line: no hull in 3D
    if len(hull) > MAX_HULL_POINTS:
        # A Fibonacci sphere: extremes along 2000 directions miss the true diameter by < 0.1 %.
        k = np.arange(2000) + 0.5
        phi, z = np.pi * (1 + 5**0.5) * k, 1 - k / 1000
        r = np.sqrt(1 - z * z)
        directions = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
        hull = hull[np.unique(np.argmax(hull @ directions.T, axis=0))]
    return float(pdist(hull).max(initial=0.0))


def _check_file(path: Path) -> None:
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path} is no mesh file; supported: {', '.join(f[1:] for f in FORMATS)}")
    if not path.is_file():
        raise InputError(f"{path} is missing")


def _loaded(path: Path, skip_materials: bool) -> trimesh.Trimesh:
    """The mesh of a file as trimesh reads it; refused where it is damaged or holds no triangles."""
    try:
        loaded = trimesh.load_mesh(path, process=False, skip_materials=skip_materials)
    except Exception as error:  # trimesh's loaders raise whatever their parsing stumbles over
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} is damaged, cut off or no mesh ({reason}); fetch it again") from None
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise InputError(f"{path} holds no triangles; a triangle mesh is expected, not a point cloud")
    if not np.isfinite(loaded.vertices).all():
        raise InputError(f"{path} holds vertices that are NaN or infinite")
    if len(loaded.faces) < (promised := _promised_faces(path)):
        raise InputError(f"{path} ends after {len(loaded.faces)} of {promised} faces; fetch it again")
    if loaded.faces.min() < 0 or loaded.faces.max() >= len(loaded.vertices):
        raise InputError(f"{path} has faces that name vertices that do not exist; the file is damaged")
    return loaded


def _ascii_vertices(path: Path) -> Float | None:
    """The vertices of an ascii PLY in double precision (trimesh rounds them to single); None for any other file."""
    if path.suffix.lower() != ".ply" or "format ascii" not in (header := _ply_header(path)):
        return None
    found = re.search(r"^element\s+vertex\s+(\d+)((?:\s+property.*)*)", header, re.MULTILINE)
    if found is None or header.find("element") != found.start():
        return None  # other elements come before the vertices
    names = [line.split()[-1] for line in found.group(2).strip().splitlines()]
    body = path.read_text("latin-1").split("end_header", 1)[1].lstrip("\r\n").splitlines()
    return np.loadtxt(body[: int(found.group(1))], usecols=[names.index(axis) for axis in "xyz"], ndmin=2)


def _baked_colors(mesh: trimesh.Trimesh) -> NDArray[np.uint8] | None:
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        visual = visual.to_color()
    if visual.kind not in ("vertex", "face"):
        return None
    colors = np.asarray(visual.vertex_colors, dtype=np.uint8)
    return colors[:, :3] if len(colors) == len(mesh.vertices) else None


def _texture_notes(path: Path, name: str | None) -> tuple[str, ...]:
    """Why the texture that the file names cannot be used; empty where it can, or where there is none."""
    if name is None:
        return ()
    if not (path.parent / name).is_file():
        return (f"texture {name} of {path.name} is missing; the model is drawn in one colour",)
    try:
        with Image.open(path.parent / name) as image:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return (f"texture {name} of {path.name} is damaged; the model is drawn in one colour",)
    return ()


def _texture_name(path: Path) -> str | None:
    """The image that a PLY header, or an OBJ's material file, names."""
    if path.suffix.lower() == ".ply":
        found = re.search(r"^comment\s+TextureFile\s+(.+?)\s*$", _ply_header(path), re.IGNORECASE | re.MULTILINE)
        return found.group(1) if found else None
    if path.suffix.lower() == ".obj":
        library = re.search(r"^mtllib\s+(.+?)\s*$", path.read_text("latin-1"), re.MULTILINE)
        if library and (path.parent / library.group(1)).is_file():
            material = (path.parent / library.group(1)).read_text("latin-1")
            found = re.search(r"^\s*map_Kd\s+(?:-\S+\s+\S+\s+)*(.+?)\s*$", material, re.MULTILINE)
            return found.group(1) if found else None
    return None


def _promised_faces(path: Path) -> int:
    """Faces that a PLY's header announces; an ascii file that was cut off reads without complaint. 0 = not said."""
    if path.suffix.lower() != ".ply":
        return 0
    found = re.search(r"^element\s+face\s+(\d+)", _ply_header(path), re.MULTILINE)
    return int(found.group(1)) if found else 0


def _ply_header(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(65536).split(b"end_header")[0].decode("latin-1")


def _merged(
    vertices: Float, faces: NDArray[np.integer], colors: NDArray[np.uint8] | None
) -> tuple[Float, NDArray[np.integer], NDArray[np.uint8] | None]:
    """The same surface with vertices at exactly the same place joined, in order of first appearance."""
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse.ravel()][faces]
    collapsed = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    kept = first[order]
    return vertices[kept], faces[~collapsed], None if colors is None else colors[kept]


def _outward(vertices: Float, faces: NDArray[np.integer]) -> NDArray[np.integer]:
    """The faces, neighbours turned alike and the enclosed volume positive."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        faces = np.asarray(mesh.faces)
    # Volume seen from the middle of the box: right for closed meshes, and a fair guess for open ones.
    a, b, c = np.moveaxis((vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2)[faces], 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return faces[:, ::-1] if volume < 0 else faces
