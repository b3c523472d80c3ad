"""Colours of mesh files: textures, colours of the vertices, and what is said where they cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from verefine_viz.scenes import materials
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.models import model_of_mesh

SIZE_MM = np.array([100.0, 80.0, 60.0])


def box() -> trimesh.Trimesh:
    return trimesh.creation.box(SIZE_MM)


def textured_ply(folder: Path, binary: bool) -> Path:
    """A square in four quarters of colour; texture v points up."""
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:32, :32], texture[:32, 32:] = (255, 0, 0), (0, 255, 0)
    texture[32:, :32], texture[32:, 32:] = (0, 0, 255), (255, 255, 0)
    Image.fromarray(texture).save(folder / "skin.png")
    corners = [(-1, -1, 0.0, 0.0), (1, -1, 1.0, 0.0), (1, 1, 1.0, 1.0), (-1, 1, 0.0, 1.0)]
    header = (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\ncomment TextureFile skin.png\n"
        "element vertex 4\n"
        + "".join(f"property float {p}\n" for p in ("x", "y", "z", "texture_u", "texture_v"))
        + "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [(100.0 * x, 100.0 * y, 0.0, u, v) for x, y, u, v in corners]
    if binary:
        faces = np.array([(3, [0, 1, 2]), (3, [0, 2, 3])], dtype=[("n", "u1"), ("i", "<i4", 3)])
        content = header.encode() + np.array(rows, dtype="<f4").tobytes() + faces.tobytes()
    else:
        content = (header + "".join(" ".join(map(str, r)) + "\n" for r in rows) + "3 0 1 2\n3 0 2 3\n").encode()
    path = folder / "square.ply"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("binary", [False, True])
def test_textures_are_baked_to_the_vertices(tmp_path: Path, binary: bool) -> None:
    mesh = read_mesh(textured_ply(tmp_path, binary), 1e-3)
    colors = {
        tuple(np.sign(v[:2]).astype(int)): tuple(c) for v, c in zip(mesh.vertices_m, mesh.vertex_colors, strict=True)
    }
    assert colors == {(-1, -1): (0, 0, 255), (1, -1): (255, 255, 0), (1, 1): (0, 255, 0), (-1, 1): (255, 0, 0)}


def test_a_damaged_or_missing_texture_is_a_note(tmp_path: Path) -> None:
    path = textured_ply(tmp_path, True)
    (tmp_path / "skin.png").write_bytes(b"no image")
    assert "skin.png, which square.ply names, cannot be used: " in read_mesh(path, 1e-3).notes[0]
    (tmp_path / "skin.png").unlink()
    mesh = read_mesh(path, 1e-3)
    assert (mesh.vertex_colors, mesh.texture, len(mesh.faces)) == (None, None, 2)
    assert "it does not exist" in mesh.notes[0]


def test_texture_seams_are_closed_and_closed_meshes_left_alone(tmp_path: Path) -> None:
    mesh = box()
    mesh.unmerge_vertices()
    mesh.export(tmp_path / "soup.ply")
    assert len(read_mesh(tmp_path / "soup.ply", 1e-3).vertices_m) == 8
    # Two closed boxes that touch in four vertices stay two closed boxes.
    other = box()
    other.apply_translation([SIZE_MM[0], 0, 0])
    both = trimesh.util.concatenate([box(), other])
    both.export(tmp_path / "both.ply")
    kept = read_mesh(tmp_path / "both.ply", 1e-3)
    assert len(kept.vertices_m) == 16
    assert trimesh.Trimesh(kept.vertices_m, kept.faces, process=False).is_watertight


def checked(folder: Path, uv_offset: float = 0.0, mode: str = "RGB", size: int = 64) -> Path:
    """A box whose faces each show the whole of a four-coloured image, as a PLY with coordinates at its vertices."""
    quarters = np.zeros((size, size, 3), np.uint8)
    half = size // 2
    quarters[:half, :half], quarters[:half, half:] = (255, 0, 0), (0, 255, 0)
    quarters[half:, :half], quarters[half:, half:] = (0, 0, 255), (255, 255, 0)
    Image.fromarray(quarters).convert(mode).save(folder / "skin.png")
    mesh = box()
    mesh.unmerge_vertices()
    flat = mesh.vertices / SIZE_MM + 0.5
    across = np.abs(mesh.face_normals).argmax(axis=1).repeat(3)
    uv = np.stack([flat[np.arange(36), (across + 1) % 3], flat[np.arange(36), (across + 2) % 3]], axis=1) + uv_offset
    header = (
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 36\n"
        + "".join(f"property float {p}\n" for p in ("x", "y", "z", "texture_u", "texture_v"))
        + "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = "".join(" ".join(map(str, r)) + "\n" for r in np.column_stack([mesh.vertices, uv]))
    (folder / "box.ply").write_text(header + rows + "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces))
    return folder / "box.ply"


def surface_colors(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the box, from 0 to 1 along its sides, the axis their face is across, and their colours."""
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 10, 0)
    rng = np.random.default_rng(3)
    faces, weights = rng.integers(0, len(model.faces), 400), rng.dirichlet([1, 1, 1], 400)
    corners = model.vertices[model.faces[faces]]
    points = np.einsum("ik,ikj->ij", weights, corners) / (SIZE_MM * 1e-3) + 0.5
    return points, np.ptp(corners, axis=1).argmin(axis=1), model.colors(faces, weights)


@pytest.mark.parametrize("uv_offset", [0.0, -2.0])
def test_a_texture_colours_the_faces_between_the_vertices(tmp_path: Path, uv_offset: float) -> None:
    points, across, colors = surface_colors(checked(tmp_path, uv_offset))
    u, v = points[np.arange(400), (across + 1) % 3], points[np.arange(400), (across + 2) % 3]
    inner = (np.abs(u - 0.5) > 0.02) & (np.abs(v - 0.5) > 0.02)
    assert inner.sum() > 300
    expected = np.where(
        v[:, None] > 0.5,
        np.where(u[:, None] < 0.5, (255, 0, 0), (0, 255, 0)),
        np.where(u[:, None] < 0.5, (0, 0, 255), (255, 255, 0)),
    )
    np.testing.assert_allclose(colors[inner], expected[inner], atol=1e-6)


def test_a_texture_of_any_kind_of_image_is_rgb(tmp_path: Path) -> None:
    for mode in ("L", "RGBA", "P"):
        texture = read_mesh(checked(tmp_path, mode=mode), 1e-3).texture
        assert texture.image.shape == (64, 64, 3)
        assert (np.ptp(texture.image, axis=2) == 0).all() == (mode == "L")


def test_a_large_texture_is_made_smaller(tmp_path: Path) -> None:
    texture = read_mesh(checked(tmp_path, size=3000), 1e-3).texture
    assert texture.image.shape == (materials.LARGEST_TEXTURE_PX, materials.LARGEST_TEXTURE_PX, 3)
    points, _, colors = surface_colors(tmp_path / "box.ply")
    assert len(np.unique(colors.round(), axis=0)) < len(points) / 10


def test_a_texture_turns_with_the_faces_of_an_inside_out_mesh(tmp_path: Path) -> None:
    path = checked(tmp_path)
    head, _, body = path.read_text().partition("end_header\n")
    lines = [line.split() for line in body.splitlines()]
    turned = [f"3 {c} {b} {a}" if line[0] == "3" and len(line) == 4 else " ".join(line)
              for line in lines for _, a, b, c in [line if len(line) == 4 else [0, 0, 0, 0]]]  # fmt: skip
    path.write_text(head + "end_header\n" + "\n".join(turned) + "\n")
    points, across, colors = surface_colors(path)
    u, v = points[np.arange(400), (across + 1) % 3], points[np.arange(400), (across + 2) % 3]
    inner = (u < 0.48) & (v > 0.52)
    np.testing.assert_allclose(colors[inner], np.tile([255, 0, 0], (int(inner.sum()), 1)), atol=1e-6)


def test_a_ply_of_two_textures_is_of_one_colour_and_says_so(tmp_path: Path) -> None:
    path = checked(tmp_path)
    comment = "comment TextureFile skin.png\n"
    path.write_text(path.read_text().replace(comment, comment + "comment TextureFile other.png\n"))
    mesh = read_mesh(path, 1e-3)
    assert mesh.texture is None
    assert "cannot be used" in mesh.notes[0]


def test_coordinates_at_the_corners_of_faces_are_read(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8).repeat(8, axis=1)).save(tmp_path / "skin.png")
    # Both triangles share two vertices, at which each shows its own half of the image.
    (tmp_path / "two.ply").write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 2\nproperty list uchar int vertex_indices\n"
        "property list uchar float texcoord\nend_header\n0 0 0\n100 0 0\n100 100 0\n0 100 0\n"
        "3 0 1 2 6 0.1 0.5 0.2 0.5 0.3 0.5\n3 0 2 3 6 0.7 0.5 0.8 0.5 0.9 0.5\n"
    )
    model = model_of_mesh(read_mesh(tmp_path / "two.ply", 1e-3), 1, "two", 10, 0)
    middle = np.full((2, 3), 1 / 3)
    np.testing.assert_allclose(model.colors(np.array([0, 1]), middle), [[255, 0, 0], [0, 0, 255]], atol=1e-6)
