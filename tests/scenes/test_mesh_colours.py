"""The colours of a mesh are those that its files mean, or there are none and a note says why."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes import materials
from verefine_viz.scenes.bop_entries import model_file
from verefine_viz.scenes.image_files import write_image
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.models import model_of_mesh
from verefine_viz.trace import Trace

SIZE_MM = np.array([100.0, 80.0, 60.0])
QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)
PLAIN = (255, 0, 128)
MTL = "newmtl top\nKd 1 1 1\nmap_Kd {skin}\nnewmtl side\nKd 1 0 0.5019608\nnewmtl bottom\nmap_Kd {other}\n"


def write_obj(folder: Path, skin: str = "skin.png", other: str = "other.png", mtllib: str = "mtllib cube.mtl") -> Path:
    """A cube: quarters of colour on top, the same negative and of another size below, one colour at its sides."""
    folder.mkdir(parents=True, exist_ok=True)
    pixels = QUARTERS.repeat(32, axis=0).repeat(32, axis=1)
    Image.fromarray(pixels).save(folder / "skin.png")
    Image.fromarray(255 - pixels[::2, :]).save(folder / "other.png")
    (folder / "cube.mtl").write_text(MTL.format(skin=skin, other=other))
    lines = [mtllib, *(f"v {x} {y} {z}" for z in (0, 1) for y in (0, 1) for x in (0, 1))]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    sides = [(1, 2, 6, 5), (2, 4, 8, 6), (4, 3, 7, 8), (3, 1, 5, 7)]
    for material, quads in (("top", [(5, 6, 8, 7)]), ("side", sides), ("bottom", [(1, 2, 4, 3)])):
        lines.append(f"usemtl {material}")
        for a, b, c, d in quads:
            lines += [f"f {a}/1 {b}/2 {c}/3", f"f {a}/1 {c}/3 {d}/4"]
    (folder / "cube.obj").write_text("\n".join(lines) + "\n")
    return folder / "cube.obj"


def model_at(path: Path) -> tuple[ObjectModel, tuple[str, ...]]:
    mesh = read_mesh(path, 0.1)
    return model_of_mesh(mesh, 1, "cube", 10, 0), mesh.notes


def assert_true_colours(model: ObjectModel) -> None:
    """Compare points all over the cube with what was painted."""
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(0, len(model.faces), 3000), rng.dirichlet([1, 1, 1], 3000)
    points = np.einsum("ik,ikj->ij", weights, model.vertices[model.faces[faces]]) * 10
    u, v = points[:, 0], points[:, 1]
    on_top, below = np.isclose(points[:, 2], 1), np.isclose(points[:, 2], 0)
    seen = QUARTERS[(v < 0.5).astype(int), (u > 0.5).astype(int)].astype(int)
    expected = np.where(on_top[:, None], seen, np.where(below[:, None], 255 - seen, PLAIN))
    is_inside = ~(on_top | below) | ((np.abs(u - 0.5) > 0.04) & (np.abs(v - 0.5) > 0.04))
    assert min(on_top.sum(), below.sum()) > 300
    np.testing.assert_allclose(model.colors(faces, weights)[is_inside], expected[is_inside], atol=1)


def moved(folder: Path, to: str, name: str = "skin.png") -> None:
    (folder / to).parent.mkdir(parents=True, exist_ok=True)
    shutil.move(folder / name, folder / to)


READ: dict[str, Callable[[Path], Any]] = {
    "plain": write_obj,
    "options": lambda folder: write_obj(folder, "-s 1 1 1 -clamp on skin.png", "-o 0 0 -bm 0.5 other.png"),
    "a folder": lambda folder: [write_obj(folder, "textures/skin.png"), moved(folder, "textures/skin.png")],
    "the folder above": lambda folder: [write_obj(folder, "../maps/skin.png"), moved(folder, "../maps/skin.png")],
    "backslashes": lambda folder: [write_obj(folder, "textures\\skin.png"), moved(folder, "textures/skin.png")],
    "spaces": lambda folder: [write_obj(folder, "-clamp on my  skin 1.png"), moved(folder, "my  skin 1.png")],
    "%20": lambda folder: [write_obj(folder, "my%20skin.png"), moved(folder, "my skin.png")],
    "another machine": lambda folder: write_obj(folder, "/home/kim/meshes/skin.png", "C:\\Users\\kim\\other.png"),
    "other case": lambda folder: [write_obj(folder, "Textures/SKIN.PNG"), moved(folder, "textures/skin.png")],
    "Latin-1": lambda folder: [
        write_obj(folder, "häut.png"), moved(folder, "häut.png"),
        (folder / "cube.mtl").write_text(MTL.format(skin="häut.png", other="other.png"), encoding="utf-8")],
    "no mtllib": lambda folder: write_obj(folder, mtllib=""),
    "mtllib of another case": lambda folder: write_obj(folder, mtllib="mtllib ./Cube.MTL"),
    "mtllib in a folder": lambda folder: [
        write_obj(folder, mtllib="mtllib mats/cube.mtl"), moved(folder, "mats/cube.mtl", "cube.mtl"),
        moved(folder, "mats/skin.png")],
    "two mtllib": lambda folder: [
        write_obj(folder, mtllib="mtllib a.mtl b.mtl"), (folder / "cube.mtl").unlink(),
        (folder / "a.mtl").write_text(MTL.partition("newmtl bottom")[0].format(skin="skin.png")),
        (folder / "b.mtl").write_text("newmtl bottom\nmap_Kd other.png")],
    "a texture that no face has": lambda folder: [
        write_obj(folder), Image.new("RGB", (9, 9)).save(folder / "third.png"),
        (folder / "cube.mtl").write_text((folder / "cube.mtl").read_text() + "newmtl free\nmap_Kd third.png\n")],
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_colours_are_those_that_the_files_mean_also_in_a_trace(tmp_path: Path, case: str) -> None:
    folder = tmp_path / "here" / "cube"
    READ[case](folder)
    model, notes = model_at(folder / "cube.obj")
    assert_true_colours(model)
    assert notes == (("cube.obj names no material file; cube.mtl beside it is read",) if case == "no mtllib" else ())
    trace = Trace(tmp_path / "trace", np.eye(3), np.ones((4, 4)))
    trace.object("cube", folder / "cube.obj")
    trace.close()
    assert trace.n_problems == 0
    shutil.rmtree(tmp_path / "here")
    (copy,) = (tmp_path / "trace").rglob("*.obj")
    assert_true_colours(model_at(copy)[0])


OFF: dict[str, tuple[Callable[[Path], Any], str]] = {
    "lost MTL": (lambda folder: [write_obj(folder), (folder / "cube.mtl").unlink()], "cube.mtl, which"),
    "lost texture": (lambda folder: [write_obj(folder), (folder / "skin.png").unlink()], "skin.png, which"),
    "second texture": (lambda folder: [write_obj(folder), (folder / "other.png").unlink()], "other.png, which"),
    "cut off": (
        lambda folder: [write_obj(folder), (folder / "skin.png").write_bytes((folder / "skin.png").read_bytes()[:90])],
        "skin.png, which",
    ),
    "scaled": (lambda folder: write_obj(folder, "-s 2 2 1 skin.png"), "skin.png, which"),
    "no such material": (
        lambda folder: (write_obj(folder) and (folder / "cube.mtl")).write_text(
            MTL.format(skin="skin.png", other="other.png").replace("newmtl side", "newmtl edge")
        ),
        "parts of cube.obj have no material",
    ),
    "repeated": (
        lambda folder: (write_obj(folder) and (folder / "cube.obj")).write_text(
            (folder / "cube.obj").read_text().replace("vt 1 1", "vt 2 2")
        ),
        "repeated",
    ),
}


@pytest.mark.parametrize("case", OFF)
def test_colours_are_off_with_one_note_where_they_cannot_be_true(tmp_path: Path, case: str) -> None:
    write, said = OFF[case]
    write(tmp_path / "cube")
    model, (note,) = model_at(tmp_path / "cube" / "cube.obj")
    assert not model.has_colors
    assert said in note


def test_a_trace_names_at_recording_time_what_its_mesh_lacks(tmp_path: Path, caplog: Any) -> None:
    write_obj(tmp_path / "cube", "maps/lost.png")
    with Trace(tmp_path / "trace", np.eye(3), np.ones((4, 4))) as trace:
        trace.object("cube", tmp_path / "cube" / "cube.obj")
    assert trace.n_problems == 1
    assert "maps/lost.png" in caplog.text
    assert len([*(tmp_path / "trace").rglob("*.obj")]) == 1


def test_a_kept_model_has_the_colours_of_several_materials(tmp_path: Path) -> None:
    mesh = read_mesh(write_obj(tmp_path / "cube"), 0.1)
    write_image(tmp_path / "kept.png", mesh.texture.image)
    (tmp_path / "kept.ply").write_bytes(model_file(mesh, tmp_path / "kept.png"))
    assert_true_colours(model_of_mesh(read_mesh(tmp_path / "kept.ply", 1e-3), 1, "cube", 10, 0))


def write_gltf(folder: Path, kind: str) -> Path:
    """The cube as glTF, its texture and buffer inside (glb) or beside it (gltf)."""
    scene = trimesh.load_scene(write_obj(folder), process=False)
    if kind == "glb":
        scene.export(folder / "cube.glb")
    for name, content in () if kind == "glb" else scene.export(file_type="gltf").items():
        (folder / name.replace("model.gltf", "cube.gltf")).write_bytes(content)
    edit(folder / f"cube.{kind}", linear)
    return folder / f"cube.{kind}"


def edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the header of a glTF file."""
    content = path.read_bytes()
    n = int.from_bytes(content[12:16], "little")
    header = json.loads(content[20 : 20 + n] if path.suffix == ".glb" else content)
    change(header)
    raw = json.dumps(header).encode()
    raw += b" " * (-len(raw) % 4)
    if path.suffix == ".glb":
        rest = content[20 + n :]
        size = (20 + len(raw) + len(rest)).to_bytes(4, "little")
        raw = content[:8] + size + len(raw).to_bytes(4, "little") + content[16:20] + raw + rest
    path.write_bytes(raw)


def linear(header: dict[str, Any]) -> None:
    """State the one colour as glTF has it; trimesh writes Kd as it is."""
    for material in header["materials"]:
        if "baseColorTexture" not in material["pbrMetallicRoughness"]:
            material["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0, 0.2158605, 1]


def spaced(header: dict[str, Any]) -> None:
    for one in [*header["buffers"], *header["images"]]:
        if "uri" in one:
            one["uri"] = f"parts%201/{one['uri']}"


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_of_several_materials(tmp_path: Path, kind: str) -> None:
    path = write_gltf(tmp_path / "here" / "cube", kind)
    for name in ("cube.obj", "cube.mtl", "skin.png", "other.png"):
        (path.parent / name).unlink(missing_ok=True)
    if kind == "gltf":
        edit(path, spaced)
        for name in [one.name for one in path.parent.iterdir() if one != path]:
            moved(path.parent, f"parts 1/{name}", name)
    model, notes = model_at(path)
    assert notes == ()
    assert_true_colours(model)
    with Trace(tmp_path / "trace", np.eye(3), np.ones((4, 4))) as trace:
        trace.object("cube", path)
    assert trace.n_problems == 0
    shutil.rmtree(tmp_path / "here")
    (copy,) = (tmp_path / "trace").rglob(f"*.{kind}")
    assert_true_colours(model_at(copy)[0])


def test_a_texture_in_a_glb_that_is_not_read_is_a_note(tmp_path: Path) -> None:
    moved_texture = {"KHR_texture_transform": {"scale": [2, 2]}}
    for k, (image, texture) in enumerate(
        (
            ({"mimeType": "image/ktx2"}, {}),
            ({"bufferView": 0}, {}),
            ({}, {"texCoord": 1}),
            ({}, {"extensions": moved_texture}),
        )
    ):
        path = write_gltf(tmp_path / str(k), "glb")

        def change(header: dict[str, Any], image: dict = image, texture: dict = texture) -> None:
            header["images"][0].update(image)
            parts = [material["pbrMetallicRoughness"] for material in header["materials"]]
            next(part["baseColorTexture"] for part in parts if "baseColorTexture" in part).update(texture)

        edit(path, change)
        model, (note,) = model_at(path)
        assert not model.has_colors
        assert "cube.glb" in note


def test_colours_of_vertices_win_over_a_material_without_a_texture(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 0.7 0.7 0.7\n")
    corners = [(0, 0, 0, 1, 0, 0), (1, 0, 0, 0, 1, 0), (0, 1, 0, 0, 0, 1), (0, 0, 1, 1, 1, 0)]
    lines = ["mtllib a.mtl", "usemtl m", *("v " + " ".join(map(str, corner)) for corner in corners)]
    (tmp_path / "a.obj").write_text("\n".join([*lines, "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]) + "\n")
    colors = read_mesh(tmp_path / "a.obj", 1.0).vertex_colors
    assert {tuple(color) for color in colors} == {tuple(255 * c for c in corner[3:]) for corner in corners}


def test_one_grey_is_no_colour_and_one_red_is(tmp_path: Path) -> None:
    path = write_obj(tmp_path)
    text = path.read_text().replace("usemtl top", "usemtl side").replace("usemtl bottom", "usemtl side")
    path.write_text(text)
    mesh = read_mesh(path, 1.0)
    assert mesh.texture is None
    assert {tuple(color) for color in mesh.vertex_colors} == {PLAIN}
    (tmp_path / "cube.mtl").write_text("newmtl side\nKd 0.8 0.8 0.8\n")
    assert read_mesh(path, 1.0).vertex_colors is None


def write_ply(path: Path, vertices: Any, uv: Any, faces: Any, binary: bool = False) -> Path:
    """A mesh [mm] with the texture skin.png and its coordinates at the vertices; v points up."""
    rows, faces = np.column_stack([vertices, uv]).astype("<f4"), np.asarray(faces)
    header = (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\ncomment TextureFile skin.png\n"
        f"element vertex {len(rows)}\n"
        + "".join(f"property float {p}\n" for p in ("x", "y", "z", "texture_u", "texture_v"))
        + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if binary:
        packed = np.array([(3, face) for face in faces.tolist()], dtype=[("n", "u1"), ("i", "<i4", 3)])
        path.write_bytes(header.encode() + rows.tobytes() + packed.tobytes())
    else:
        lines = [*(" ".join(map(str, row)) for row in rows.tolist()), *(f"3 {a} {b} {c}" for a, b, c in faces)]
        path.write_text(header + "\n".join(lines) + "\n")
    return path


def textured_ply(folder: Path, binary: bool) -> Path:
    """A square in four quarters of colour."""
    Image.fromarray(QUARTERS.repeat(32, axis=0).repeat(32, axis=1)).save(folder / "skin.png")
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    vertices = np.column_stack([200.0 * corners - 100, np.zeros(4)])
    return write_ply(folder / "square.ply", vertices, corners, [(0, 1, 2), (0, 2, 3)], binary)


@pytest.mark.parametrize("binary", [False, True])
def test_textures_are_baked_to_the_vertices_or_a_note_says_why_not(tmp_path: Path, binary: bool) -> None:
    path = textured_ply(tmp_path, binary)
    mesh = read_mesh(path, 1e-3)
    colors = {
        tuple(np.sign(v[:2]).astype(int)): tuple(c) for v, c in zip(mesh.vertices_m, mesh.vertex_colors, strict=True)
    }
    assert colors == {(-1, -1): (0, 0, 255), (1, -1): (255, 255, 0), (1, 1): (0, 255, 0), (-1, 1): (255, 0, 0)}
    for spoil in (lambda file: file.write_bytes(b"no image"), Path.unlink):
        spoil(tmp_path / "skin.png")
        mesh = read_mesh(path, 1e-3)
        assert (mesh.vertex_colors, mesh.texture, len(mesh.faces)) == (None, None, 2)
        assert "skin.png" in mesh.notes[0]


def checked(folder: Path, uv_offset: float = 0.0, mode: str = "RGB", size: int = 64, is_turned: bool = False) -> Path:
    """A box whose faces each show the whole of a four-coloured image."""
    Image.fromarray(QUARTERS.repeat(size // 2, axis=0).repeat(size // 2, axis=1)).convert(mode).save(
        folder / "skin.png"
    )
    mesh = trimesh.creation.box(SIZE_MM)
    mesh.unmerge_vertices()
    flat = mesh.vertices / SIZE_MM + 0.5
    across = np.abs(mesh.face_normals).argmax(axis=1).repeat(3)
    uv = np.stack([flat[np.arange(36), (across + 1) % 3], flat[np.arange(36), (across + 2) % 3]], axis=1) + uv_offset
    return write_ply(folder / "box.ply", mesh.vertices, uv, mesh.faces[:, ::-1] if is_turned else mesh.faces)


def surface_colors(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the box, from 0 to 1 along its sides, the axis their face is across, and their colours."""
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 10, 0)
    rng = np.random.default_rng(3)
    faces, weights = rng.integers(0, len(model.faces), 400), rng.dirichlet([1, 1, 1], 400)
    corners = model.vertices[model.faces[faces]]
    points = np.einsum("ik,ikj->ij", weights, corners) / (SIZE_MM * 1e-3) + 0.5
    return points, np.ptp(corners, axis=1).argmin(axis=1), model.colors(faces, weights)


@pytest.mark.parametrize(("uv_offset", "is_turned"), [(0.0, False), (-2.0, False), (0.0, True)])
def test_a_texture_colours_the_faces_between_the_vertices(tmp_path: Path, uv_offset: float, is_turned: bool) -> None:
    """Also those of a mesh that is inside out, whose faces are turned."""
    points, across, colors = surface_colors(checked(tmp_path, uv_offset, is_turned=is_turned))
    u, v = points[np.arange(400), (across + 1) % 3], points[np.arange(400), (across + 2) % 3]
    inner = (np.abs(u - 0.5) > 0.02) & (np.abs(v - 0.5) > 0.02)
    assert inner.sum() > 300
    expected = QUARTERS[(v < 0.5).astype(int), (u > 0.5).astype(int)]
    np.testing.assert_allclose(colors[inner], expected[inner], atol=1e-6)


def test_a_texture_of_any_kind_of_image_is_rgb_and_a_large_one_is_made_smaller(tmp_path: Path) -> None:
    for mode in ("L", "RGBA", "P"):
        texture = read_mesh(checked(tmp_path, mode=mode), 1e-3).texture
        assert texture.image.shape == (64, 64, 3)
        assert (np.ptp(texture.image, axis=2) == 0).all() == (mode == "L")
    texture = read_mesh(checked(tmp_path, size=3000), 1e-3).texture
    assert texture.image.shape == (materials.LARGEST_TEXTURE_PX, materials.LARGEST_TEXTURE_PX, 3)
    points, _, colors = surface_colors(tmp_path / "box.ply")
    assert len(np.unique(colors.round(), axis=0)) < len(points) / 10


def test_a_ply_of_two_textures_is_of_one_colour_and_says_so(tmp_path: Path) -> None:
    path = checked(tmp_path)
    comment = "comment TextureFile skin.png\n"
    path.write_text(path.read_text().replace(comment, comment + "comment TextureFile other.png\n"))
    mesh = read_mesh(path, 1e-3)
    assert mesh.texture is None
    assert len(mesh.notes) == 1


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
