"""Colours of a mesh file: the materials and textures that it names, and what of them cannot be used."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.resolvers import FilePathResolver
from trimesh.visual import TextureVisuals
from trimesh.visual.color import linear_to_srgb, to_float, to_rgba, uv_to_color

from verefine_viz.core.errors import ContentError, one_line
from verefine_viz.core.files import first_line, read_file
from verefine_viz.scenes.image_files import open_image
from verefine_viz.trace import file_beside, gltf_header, lines_that_name, material_files

Pixels = NDArray[np.uint8]

LONGEST_SHOWN = 80
"""Letters of a file's name, in a note [characters]."""
LARGEST_READ_PX = 4096
"""A texture is made smaller before anything is done with it until no side is longer."""
LARGEST_TEXTURE_PX = 1024
"""A texture is made smaller until no side is longer: a camera sees fewer pixels of an object."""
BEYOND = 0.01
"""How far texture coordinates may lie outside of an image that shares its texture with others."""
MOVED = re.compile(r"(?<!\S)-([sot])((?:\s+[-+]?[\d.]+)+)\s")
"""Options of a texture that scale or move it."""
MATERIALS = "materials"
"""What trimesh asks for in place of the material files of an OBJ, of which it reads one only."""


class MeshFiles(FilePathResolver):
    """The files that a mesh file names (materials, textures, buffers), opened like every other input."""

    def __init__(self, mesh: Path) -> None:
        super().__init__(str(mesh))
        self.mesh = mesh
        self._folders = [mesh.parent]
        self._materials = ""
        self.n_images = 0
        """Textures that were read."""
        self.faults: list[str] = []
        """Why the colours cannot be used."""
        self.notes: list[str] = []

    def fault(self, name: str, why: str) -> None:
        """Note that a file which the mesh names cannot be used."""
        shown = one_line(name if len(name) <= LONGEST_SHOWN else f"{name[:LONGEST_SHOWN]}…")
        self.faults.append(f"{shown}, which {self.mesh.name} names, cannot be used: {why}")

    def get(self, name: str) -> Any:
        """The content of a file; what fails is a fault, of which trimesh makes a grey texture."""
        if name == MATERIALS:
            return self._materials
        try:
            if any(float(n) != (option == "s") for option, values in MOVED.findall(name) for n in values.split()):
                raise ContentError("its material scales or moves it")
            path = file_beside(self._folders, name)
            if path is None:
                raise ContentError("it does not exist")
            content = read_file(path)
            if self.mesh.suffix.lower() == ".gltf" and path.suffix.lower() not in Image.registered_extensions():
                return content  # A buffer.
            content = _texture_file(content)
        except Exception as error:
            self.fault(name, first_line(error, "an image"))
            raise
        self.n_images += 1
        return content

    def with_materials(self, content: bytes) -> bytes:
        """Return the content of an OBJ whose material files, all of them, are what ``MATERIALS`` stands for."""
        names = lines_that_name(content, b"mtllib")
        own = file_beside(self._folders, self.mesh.stem + ".mtl")
        if not names and own is not None and re.search(rb"^\s*usemtl\s", content, re.MULTILINE):
            names = [own.name]
            self.notes.append(f"{self.mesh.name} names no material file; {own.name} beside it is read")
        for name in names:
            for one in material_files(self._folders, name):
                path = file_beside(self._folders, one)
                try:
                    if path is None:
                        raise ContentError("it does not exist")
                    text = read_file(path)
                except Exception as error:
                    self.fault(one, first_line(error, "text"))
                    continue
                self._materials += text.decode("utf-8", "surrogateescape") + "\n"
                self._folders.append(path.parent)
        content = re.sub(rb"mtllib", b"#", content)
        has_colours = re.search(rb"^v(?:[ \t]+[-+.\deE]+){6}\s*$", content, re.MULTILINE) is not None
        if not names or (has_colours and "map_kd" not in self._materials.lower()):
            return content
        return f"mtllib {MATERIALS}\n".encode() + content


def _texture_file(content: bytes) -> bytes:
    """A texture, made smaller where it would fill the memory."""
    with open_image(io.BytesIO(content)) as image:
        image.draft("RGB", (LARGEST_READ_PX, LARGEST_READ_PX))
        image.load()
        if max(image.size) <= LARGEST_READ_PX:
            return content
        image.thumbnail((LARGEST_READ_PX, LARGEST_READ_PX))
        smaller = io.BytesIO()
        image.convert("RGB").save(smaller, "PNG")
        return smaller.getvalue()


@dataclass(frozen=True, eq=False)
class MeshColours:
    """The colours of a mesh."""

    vertices: Pixels
    """(V, 3) RGB at its vertices; where it has a texture, the texture's colours there."""
    image: Pixels | None = None
    """(h, w, 3) RGB."""
    uv: NDArray[np.float32] | None = None
    """(F, 3, 2) where its faces lie in the image."""


@dataclass(frozen=True, eq=False)
class _ColouredPart:
    vertices: Pixels
    """(V, 3) RGB."""
    image: Image.Image | None = None
    """RGB; of a material without a texture one pixel; parts of one material have the same."""
    uv: NDArray[np.float32] | None = None
    """(F, 3, 2)."""


def look_of(parts: Sequence[tuple[trimesh.Trimesh, Any]], files: MeshFiles) -> MeshColours | None:
    """The colours of the parts of a mesh together; None where it has none, or others than its files mean.

    Args:
        parts: meshes that follow each other, each with its visual as trimesh has read it.
        files: gets what is wrong.
    """
    name = files.mesh.name
    materials: dict[object, Image.Image] = {}
    own = [_part(mesh, visual, files, materials) for mesh, visual in parts]
    with_colours = [part for part in own if part is not None]
    if with_colours and len(with_colours) < len(parts):
        files.faults.append(f"parts of {name} have no material")
    if materials and any(part.image is None for part in with_colours):
        files.faults.append(f"parts of {name} have colours at their vertices, others materials")
    if files.n_images and not with_colours and not files.faults:
        files.faults.append(f"{name} has a texture, but not where its faces lie in it")
    if files.faults or not with_colours:
        return None
    vertices = np.concatenate([part.vertices for part in with_colours])
    textured = [(part.image, part.uv) for part in with_colours if part.image is not None and part.uv is not None]
    if not any(isinstance(key, int) for key in materials) and len(materials) < 2:
        return (
            None if materials and np.ptp(vertices[0]) == 0 else MeshColours(vertices)
        )  # One grey is what tools write.
    if len(materials) == 1:
        return MeshColours(
            vertices, np.asarray(_smaller(textured[0][0], 1)), np.concatenate([uv for _, uv in textured])
        )
    image, places = _side_by_side(list(materials.values()))
    moved = [_moved(uv, places[id(one)], image.size) for one, uv in textured]
    if any(np.isnan(uv).any() for uv in moved):
        files.faults.append(f"a texture of {name} is repeated, and it has others beside it")
        return None
    return MeshColours(vertices, np.asarray(image), np.concatenate(moved))


def _part(
    mesh: trimesh.Trimesh, visual: Any, files: MeshFiles, materials: dict[object, Image.Image]
) -> _ColouredPart | None:
    """The colours of one part; its image is added to ``materials``."""
    n, faces = len(mesh.vertices), np.asarray(mesh.faces)
    if not isinstance(visual, TextureVisuals):
        colors = np.asarray(visual.vertex_colors if visual.kind in ("vertex", "face") else (), dtype=np.uint8)
        return _ColouredPart(colors[:, :3]) if len(colors) == n else None
    material: Any = visual.material
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    at_vertices = visual.vertex_attributes.get("color")
    if image is None:
        if at_vertices is not None and len(at_vertices) == n:
            return _ColouredPart(to_rgba(at_vertices)[:, :3])
        colour = _one_colour(material)
        if colour is None:
            return None
        one = materials.setdefault(colour, Image.new("RGB", (1, 1), colour))
        return _ColouredPart(np.full((n, 3), colour, np.uint8), one, np.full((len(faces), 3, 2), 0.5, np.float32))
    if image.format is None or visual.uv is None or len(visual.uv) != n:  # Without a format: the grey of trimesh.
        return None
    if not np.isfinite(visual.uv).all():
        files.faults.append(f"texture coordinates of {files.mesh.name} are NaN or infinite")
        return None
    if at_vertices is not None and np.ptp(at_vertices) > 0:
        files.faults.append(f"{files.mesh.name} has colours at its vertices and a texture over them")
        return None
    try:
        image.thumbnail((LARGEST_READ_PX, LARGEST_READ_PX))
        colors = np.asarray(uv_to_color(visual.uv, image))
        rgb = materials.setdefault(id(image), image.convert("RGB"))
    except Exception as error:  # Cut off, inside of the mesh's file.
        files.faults.append(f"a texture in {files.mesh.name} cannot be used: {first_line(error, 'an image')}")
        return None
    return _ColouredPart(colors[:, :3], rgb, np.asarray(visual.uv, dtype=np.float32)[faces])


def _one_colour(material: Any) -> tuple[int, int, int] | None:
    """The colour that a material without a texture states: Kd of an OBJ, in glTF a linear one."""
    if getattr(material, "baseColorFactor", None) is not None:
        rgb = np.round(255 * linear_to_srgb(to_float(material.baseColorFactor)[:3]))
    elif "kd" in getattr(material, "kwargs", ()):
        rgb = material.diffuse[:3]
    else:
        return None
    return int(rgb[0]), int(rgb[1]), int(rgb[2])


def _smaller(image: Image.Image, n_in_row: int) -> Image.Image:
    side = LARGEST_TEXTURE_PX // n_in_row
    if max(image.size) > side:
        image = image.copy()
        image.thumbnail((side, side))
    return image


def _side_by_side(images: Sequence[Image.Image]) -> tuple[Image.Image, dict[int, tuple[int, int, int, int]]]:
    """One image of several, each with its outermost pixels repeated around it, and where each is (x, y, w, h).

    trimesh's own packer moves coordinates by up to a pixel and mixes its black gaps into small images.
    """
    n_in_row = int(np.ceil(np.sqrt(len(images))))
    framed = [np.pad(np.asarray(_smaller(image, n_in_row)), ((1, 1), (1, 1), (0, 0)), "edge") for image in images]
    height, width = np.max([one.shape[:2] for one in framed], axis=0)
    whole = np.zeros((-(-len(images) // n_in_row) * height, n_in_row * width, 3), np.uint8)
    places: dict[int, tuple[int, int, int, int]] = {}
    for k, (image, one) in enumerate(zip(images, framed, strict=True)):
        y, x = k // n_in_row * height, k % n_in_row * width
        h, w = one.shape[:2]
        whole[y : y + h, x : x + w] = one
        places[id(image)] = x + 1, y + 1, w - 2, h - 2
    return Image.fromarray(whole), places


def _moved(uv: NDArray[np.float32], place: tuple[int, int, int, int], size: tuple[int, int]) -> NDArray[np.float32]:
    """Coordinates in the whole for those in one of its images; NaN where a face goes beyond that image."""
    x, y, w, h = place
    within = uv - np.floor(uv.mean(axis=1, keepdims=True))
    within = np.where(np.abs(within - 0.5) <= 0.5 + BEYOND, np.clip(within, 0, 1), np.nan)
    u, v = (x + within[..., 0] * w) / size[0], 1 - (y + (1 - within[..., 1]) * h) / size[1]
    return np.stack([u, v], axis=-1).astype(np.float32)


def check_gltf(file: BinaryIO, scene: trimesh.Scene, files: MeshFiles) -> None:
    """Note what trimesh leaves out of the textures of a glTF file without a word."""
    header = gltf_header(file)
    materials, textured = header.get("materials", []), 0
    for primitive in (one for mesh in header.get("meshes", []) for one in mesh.get("primitives", [])):
        k = primitive.get("material")
        texture = None if k is None else materials[k].get("pbrMetallicRoughness", {}).get("baseColorTexture")
        if texture is None or primitive.get("mode", 4) not in (4, 5):
            continue
        textured += 1
        if texture.get("texCoord", 0) != 0 or "KHR_texture_transform" in texture.get("extensions", {}):
            files.faults.append(f"a texture of {files.mesh.name} is moved, or has coordinates of its own")
    visuals: list[Any] = [one.visual for one in scene.geometry.values() if isinstance(one.visual, TextureVisuals)]
    if sum(getattr(visual.material, "baseColorTexture", None) is not None for visual in visuals) < textured:
        files.faults.append(f"a texture of {files.mesh.name} is missing, or of a kind that is not read")
