"""Mesh files (PLY, OBJ, GLB, STL): geometry in metres, outward faces, colours at the vertices and textures."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist
from trimesh.resolvers import FilePathResolver
from trimesh.visual import TextureVisuals

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, in_one_line
from verefine_viz.core.json_files import id_of
from verefine_viz.core.model import Texture
from verefine_viz.core.paths import open_input, read_input
from verefine_viz.scenes.mesh_surface import edges, merged, turned_outward

FORMATS = (".ply", ".obj", ".glb", ".gltf", ".stl")
"""Looked for in this order."""

MAX_HULL_POINTS = 4000
"""Hull vertices above which the diameter is taken from the extreme points of many directions."""

HULL_AT_ONCE = 50_000
"""Most points of which a convex hull is made in one go, 0.1 GB."""

EXTREMES_AT_ONCE = 4000
"""Points among which extremes are looked for in one go, 0.06 GB."""

LARGEST_COORDINATE = 1e9
"""Of a vertex, in the unit of its file."""
LONGEST_SHOWN = 80
"""Of a texture's name, in a note [characters]."""
LARGEST_TEXTURE_PX = 1024
"""A texture is made smaller until no side is longer: a camera sees fewer pixels of an object."""


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

    @property
    def diameter_m(self) -> float:
        """Largest distance between two vertices [m]."""
        return largest_distance(self.vertices_m)


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
    _check_file(path)
    texture, notes = _texture(path)
    # trimesh would log a traceback of an image that cannot be used.
    loaded = _loaded(path, skip_materials=bool(notes))
    bare = path.suffix.lower() == ".ply" and texture is None and isinstance(loaded.visual, TextureVisuals)
    colors = None if notes or bare else _baked_colors(loaded)
    image = None if notes or bare else _texture_image(loaded)
    vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces)
    uv = None if image is None else np.asarray(loaded.visual.uv, dtype=np.float32)[faces]  # pyright: ignore
    if not (np.unique(edges(faces), return_counts=True)[1] == 2).all():
        vertices, faces, colors, is_whole = merged(vertices, faces, colors)
        uv = None if uv is None else uv[is_whole]
    turned = turned_outward(vertices, faces)
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    if image is not None and uv is not None:
        skin = Texture(image, np.where(turned[:, None, None], uv[:, ::-1], uv))
        return Mesh(vertices * unit_m, faces.astype(np.int32), colors, notes, skin)
    return Mesh(vertices * unit_m, faces.astype(np.int32), colors, notes)


def read_geometry(path: Path) -> tuple[Float, NDArray[np.int32]]:
    """Vertices (V, 3), every one that the file has, in its order and unit, and faces (F, 3) as they are.

    Numbers of ascii files have all their digits, as the official toolkit reads them.

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


def _check_file(path: Path) -> None:
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path} is no mesh file; supported: {', '.join(f[1:] for f in FORMATS)}")
    if not os.path.lexists(path):
        raise InputError(f"{path} is missing")


def _loaded(path: Path, skip_materials: bool) -> trimesh.Trimesh:
    """The mesh of a file as trimesh reads it; refused where it is damaged or holds no triangles."""
    try:
        with open_input(path) as file:
            loaded = trimesh.load_mesh(
                file, path.suffix[1:], resolver=_Beside(str(path)), process=False, skip_materials=skip_materials
            )
    except InputError:
        raise
    except Exception as error:  # trimesh's loaders raise whatever their parsing stumbles over
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} is damaged, cut off or no mesh ({reason}); fetch it again") from None
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise InputError(f"{path} holds no triangles; a triangle mesh is expected, not a point cloud")
    if not np.isfinite(loaded.vertices).all():
        raise InputError(f"{path} holds vertices that are NaN or infinite")
    if np.abs(loaded.vertices).max() > LARGEST_COORDINATE:
        raise InputError(
            f"{path} has a vertex at {np.abs(loaded.vertices).max():.3g}, expected coordinates within "
            f"±{LARGEST_COORDINATE:g}"
        )
    if len(loaded.faces) < (promised := _promised_faces(path)):
        raise InputError(f"{path} ends after {len(loaded.faces)} of {promised} faces; fetch it again")
    if loaded.faces.min() < 0 or loaded.faces.max() >= len(loaded.vertices):
        raise InputError(f"{path} has faces that name vertices that do not exist; the file is damaged")
    return loaded


def _ascii_vertices(path: Path) -> Float | None:
    """The vertices of an ascii PLY in double precision (trimesh rounds them to single); None for any other file."""
    if path.suffix.lower() != ".ply" or "format ascii" not in (header := _ply_header(path)):
        return None
    element = re.search(r"^element\s+vertex\s+(\d+)((?:\s+property.*)*)", header, re.MULTILINE)
    if element is None or header.find("element") != element.start():
        return None  # other elements come before the vertices
    names = [line.split()[-1] for line in element.group(2).strip().splitlines()]
    with TextIOWrapper(open_input(path), "latin-1") as lines:
        while not next(lines).startswith("end_header"):
            pass
        body = (line for line in lines if line.strip())
        return np.loadtxt(islice(body, int(element.group(1))), usecols=[names.index(axis) for axis in "xyz"], ndmin=2)


def _baked_colors(mesh: trimesh.Trimesh) -> NDArray[np.uint8] | None:
    visual: Any = mesh.visual
    if isinstance(visual, TextureVisuals):
        visual = visual.to_color()
    if visual.kind not in ("vertex", "face"):
        return None
    colors = np.asarray(visual.vertex_colors, dtype=np.uint8)
    return colors[:, :3] if len(colors) == len(mesh.vertices) else None


def _texture_image(mesh: trimesh.Trimesh) -> NDArray[np.uint8] | None:
    """(h, w, 3) the texture of a mesh as trimesh reads it; None where there is none that covers it."""
    visual: Any = mesh.visual
    if not isinstance(visual, TextureVisuals) or visual.uv is None or len(visual.uv) != len(mesh.vertices):
        return None
    material: Any = visual.material
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if not isinstance(image, Image.Image) or not np.isfinite(visual.uv).all():
        return None
    image = image.convert("RGB")
    if max(image.size) > LARGEST_TEXTURE_PX:
        image.thumbnail((LARGEST_TEXTURE_PX, LARGEST_TEXTURE_PX))
    return np.asarray(image)


class _Beside(FilePathResolver):
    """The files that a mesh file names (materials, textures, buffers), opened like every other input."""

    def get(self, name: str) -> bytes:
        return read_input(self.absolute(name))


def _texture(path: Path) -> tuple[str | None, tuple[str, ...]]:
    """The texture that a mesh file names, None without one, and why it cannot be used (empty = it can)."""
    try:
        names = _texture_names(path)
        name = names[0] if names else None
        why = None if name is None else _unusable(path.parent / name)
    except InputError as error:
        return None, (f"{error}; {path.name} is drawn in one colour",)
    if path.suffix.lower() == ".ply" and len(names) > 1:
        return None, (f"{path.name} names {len(names)} textures, of which one is read; it is drawn in one colour",)
    if name is None or why is None:
        return name, ()
    shown = in_one_line(name if len(name) <= LONGEST_SHOWN else f"{name[:LONGEST_SHOWN]}…")
    return name, (f"texture {shown} of {path.name} {why}; the model is drawn in one colour",)


def _unusable(texture: Path) -> str | None:
    """What is wrong with an image; None where it can be used.

    Raises:
        InputError: something that is no file stands in its place.
    """
    if not os.path.lexists(texture):
        return "is missing"
    try:
        with open_input(texture) as file, Image.open(file) as image:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        return "is damaged"
    return None


def _texture_names(path: Path) -> list[str]:
    """The images that a PLY header, or an OBJ's material file, names."""
    if path.suffix.lower() == ".ply":
        return re.findall(r"^comment\s+TextureFile\s+(.+?)\s*$", _ply_header(path), re.IGNORECASE | re.MULTILINE)
    if path.suffix.lower() == ".obj":
        library = re.search(rb"^mtllib\s+(.+?)\s*$", read_input(path), re.MULTILINE)
        materials = path.parent / os.fsdecode(library.group(1)) if library else path
        if library and os.path.lexists(materials):
            material = read_input(materials).decode("latin-1")
            return re.findall(r"^\s*map_Kd\s+(?:-\S+\s+\S+\s+)*(.+?)\s*$", material, re.MULTILINE)
    return []


def _promised_faces(path: Path) -> int:
    """Faces that a PLY's header announces; a truncated ascii file reads without complaint. 0 = unknown."""
    if path.suffix.lower() != ".ply":
        return 0
    element = re.search(r"^element\s+face\s+(\d+)", _ply_header(path), re.MULTILINE)
    return int(element.group(1)) if element else 0


def _ply_header(path: Path) -> str:
    with open_input(path) as file:
        return file.read(65536).split(b"end_header")[0].decode("latin-1")


# Models as BOP has them: binary PLY files in millimetres, and their entries in models_info.json.


def ply_bytes(
    vertices_m: Float,
    faces: NDArray[np.int32],
    vertex_colors: NDArray[np.uint8] | None,
    texture: tuple[str, NDArray[np.float32]] | None = None,
) -> bytes:
    """The content of a PLY file; coordinates are doubles, so that the vertices come back as they were.

    Args:
        vertices_m: (V, 3) [m]; millimetres in the file.
        faces: (F, 3) vertex indices.
        vertex_colors: (V, 3) RGB, or None.
        texture: the name of its image beside the file, and where each face's corners lie in it (F, 3, 2), as
            :class:`Texture` has them; or None.
    """
    fields: list[tuple[str, str]] = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    if vertex_colors is not None:
        fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.empty(len(vertices_m), dtype=fields)
    for k, axis in enumerate("xyz"):
        vertices[axis] = vertices_m[:, k] * 1e3
    if vertex_colors is not None:
        for k, channel in enumerate(("red", "green", "blue")):
            vertices[channel] = vertex_colors[:, k]
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
        f"ply\nformat binary_little_endian 1.0\n{comment}element vertex {len(vertices)}\n{properties}"
        f"element face {len(records)}\nproperty list uchar int vertex_indices\n{lists}end_header\n"
    )
    return header.encode("ascii") + vertices.tobytes() + records.tobytes()


def size_entry(vertices_m: Float, diameter_m: float) -> dict[str, Any]:
    """The size of a model [mm], as in models_info.json."""
    low, high = vertices_m.min(axis=0) * 1e3, vertices_m.max(axis=0) * 1e3
    entry: dict[str, Any] = {"diameter": diameter_m * 1e3}
    entry |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    entry |= {f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)}
    return entry
