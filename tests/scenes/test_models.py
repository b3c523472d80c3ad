"""Meshes of every format come out in metres, coloured, with outward sampled normals."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from verefine_viz.core.geometry import apply
from verefine_viz.scenes import meshes
from verefine_viz.scenes.meshes import hull_vertices, largest_distance, read_mesh
from verefine_viz.scenes.models import ModelLibrary, model_of_mesh, symmetry_transforms

SIZE_MM = np.array([100.0, 80.0, 60.0])


def box() -> trimesh.Trimesh:
    return trimesh.creation.box(SIZE_MM)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb"])
def test_every_format_gives_the_same_box(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box.{suffix}"
    box().export(path)
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 500, 0)
    assert model.vertices.shape == (8, 3)
    assert model.faces.shape == (12, 3)
    assert model.diameter_m == pytest.approx(np.linalg.norm(SIZE_MM) * 1e-3, rel=1e-6)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), SIZE_MM * 1e-3, rtol=1e-6)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_ascii_and_binary_ply_agree(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "box.ply"
    path.write_bytes(trimesh.exchange.ply.export_ply(box(), encoding=encoding.split("_")[0]))
    assert encoding.encode() in path.read_bytes()[:60]
    np.testing.assert_allclose(np.abs(read_mesh(path, 1e-3).vertices_m), np.tile(SIZE_MM / 2e3, (8, 1)), rtol=1e-6)


def test_sampled_points_lie_on_the_surface_with_outward_normals(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    box().export(path)
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 3000, 0)
    depth_inside = (SIZE_MM / 2e3 - np.abs(model.points)).min(axis=1)
    np.testing.assert_allclose(depth_inside, 0, atol=1e-9)
    face = np.argmin(SIZE_MM / 2e3 - np.abs(model.points), axis=1)
    outward = np.sign(model.points[np.arange(3000), face])
    np.testing.assert_allclose(model.point_normals[np.arange(3000), face], outward, atol=1e-9)
    # Area-weighted: each pair of sides gets its share of the points.
    areas = np.array([80 * 60, 100 * 60, 100 * 80]) / (80 * 60 + 100 * 60 + 100 * 80)
    np.testing.assert_allclose(np.bincount(face) / 3000, areas, atol=0.04)


def test_an_inside_out_mesh_is_turned(tmp_path: Path) -> None:
    mesh = box()
    mesh.invert()
    mesh.export(tmp_path / "box.ply")
    model = model_of_mesh(read_mesh(tmp_path / "box.ply", 1e-3), 1, "box", 200, 0)
    assert (np.einsum("ij,ij->i", model.points, model.point_normals) > 0).all()


def test_mixed_winding_is_repaired(tmp_path: Path) -> None:
    mesh = box()
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    trimesh.Trimesh(mesh.vertices, faces, process=False).export(tmp_path / "box.ply")
    model = model_of_mesh(read_mesh(tmp_path / "box.ply", 1e-3), 1, "box", 200, 0)
    assert (np.einsum("ij,ij->i", model.points, model.point_normals) > 0).all()


def test_sampling_depends_on_the_seed_only(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    box().export(path)
    a, b, c = (model_of_mesh(read_mesh(path, 1e-3), 1, "box", 100, seed) for seed in (4, 4, 5))
    assert a.points.tobytes() == b.points.tobytes()
    assert a.points.tobytes() != c.points.tobytes()
    assert a.mesh_hash == b.mesh_hash == c.mesh_hash


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
    assert mesh.vertex_colors is not None
    colors = {
        tuple(np.sign(v[:2]).astype(int)): tuple(c) for v, c in zip(mesh.vertices_m, mesh.vertex_colors, strict=True)
    }
    assert colors == {(-1, -1): (0, 0, 255), (1, -1): (255, 255, 0), (1, 1): (0, 255, 0), (-1, 1): (255, 0, 0)}


def test_a_missing_texture_is_a_note(tmp_path: Path) -> None:
    path = textured_ply(tmp_path, True)
    (tmp_path / "skin.png").unlink()
    mesh = read_mesh(path, 1e-3)
    assert mesh.vertex_colors is None
    assert len(mesh.faces) == 2
    assert "texture skin.png of square.ply is missing" in mesh.notes[0]


def test_a_damaged_texture_is_a_note(tmp_path: Path) -> None:
    path = textured_ply(tmp_path, False)
    (tmp_path / "skin.png").write_bytes(b"no image")
    mesh = read_mesh(path, 1e-3)
    assert mesh.vertex_colors is None
    assert "texture skin.png of square.ply is damaged" in mesh.notes[0]


def test_texture_coordinates_without_a_texture_have_no_colour(tmp_path: Path) -> None:
    path = textured_ply(tmp_path, False)
    path.write_text(path.read_text().replace("comment TextureFile skin.png\n", ""))
    mesh = read_mesh(path, 1e-3)
    assert mesh.vertex_colors is None
    assert mesh.notes == ()


def test_a_textured_glb_is_baked(tmp_path: Path) -> None:
    read_from = trimesh.load_mesh(textured_ply(tmp_path, True), process=False)
    read_from.export(tmp_path / "square.glb")
    mesh = read_mesh(tmp_path / "square.glb", 1e-3)
    assert mesh.vertex_colors is not None
    assert {tuple(c) for c in mesh.vertex_colors} == {(0, 0, 255), (255, 255, 0), (0, 255, 0), (255, 0, 0)}


def test_vertex_colours_are_kept(tmp_path: Path) -> None:
    mesh = box()
    colors = np.arange(24, dtype=np.uint8).reshape(8, 3)
    mesh.visual.vertex_colors = np.hstack([colors, np.full((8, 1), 255, np.uint8)])
    mesh.export(tmp_path / "box.ply")
    np.testing.assert_array_equal(read_mesh(tmp_path / "box.ply", 1e-3).vertex_colors, colors)


def test_a_textured_obj_takes_its_colour_from_the_material(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (10, 200, 30)).save(tmp_path / "skin.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    lines = ["mtllib a.mtl", "usemtl m", "v 0 0 0", "v 100 0 0", "v 0 100 0", "v 0 0 100", "vt 0.5 0.5"]
    lines += [f"f {a}/1 {b}/1 {c}/1" for a, b, c in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    mesh = read_mesh(tmp_path / "a.obj", 1e-3)
    assert mesh.vertex_colors is not None
    assert set(map(tuple, mesh.vertex_colors)) == {(10, 200, 30)}
    (tmp_path / "skin.png").unlink()
    assert "texture skin.png of a.obj is missing" in read_mesh(tmp_path / "a.obj", 1e-3).notes[0]


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


def test_glb_is_metres_in_a_bop_folder(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    trimesh.creation.box(SIZE_MM * 1e-3).export(tmp_path / "models" / "obj_000001.glb")
    info = {"1": {"diameter": float(np.linalg.norm(SIZE_MM))}}
    (tmp_path / "models" / "models_info.json").write_text(json.dumps(info))
    library = ModelLibrary(tmp_path, 100, 0)
    np.testing.assert_allclose(np.ptp(library.get(1).vertices, axis=0), SIZE_MM * 1e-3, rtol=1e-6)
    assert library.notes(1) == ()


def test_without_models_info_the_diameter_is_measured(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    box().export(tmp_path / "models" / "obj_000001.ply")
    library = ModelLibrary(tmp_path, 100, 0)
    assert library.get(1).diameter_m == pytest.approx(np.linalg.norm(SIZE_MM) * 1e-3)
    assert library.notes(1) == ()


def test_a_millimetre_speck_without_models_info_is_noted(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    trimesh.creation.box(SIZE_MM * 1e-3).export(tmp_path / "models" / "obj_000001.ply")
    assert "check its unit" in ModelLibrary(tmp_path, 100, 0).notes(1)[0]


def test_largest_distance_of_many_and_of_flat_points() -> None:
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(9000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    assert largest_distance(sphere) == pytest.approx(2.0, rel=1e-3)
    assert largest_distance(np.array([[0.0, 0, 0], [3, 4, 0], [1, 0, 0], [0, 1, 0]])) == 5.0


def test_symmetries_are_the_official_ones(shared_data: Path) -> None:
    vectors = json.loads((shared_data / "bop_vectors" / "vectors.json").read_text())
    for case in vectors["symmetries"]:
        info = vectors["meshes"][case["mesh"]]["models_info"]
        steps = int(np.ceil(np.pi / case["max_sym_disc_step"]))
        S = symmetry_transforms(info, case["mesh"], steps)
        assert len(S) == case["count"]
        np.testing.assert_allclose(S[:, :3, :3].sum(axis=0), case["sum_R"], atol=1e-9)
        np.testing.assert_allclose(S[:, :3, 3].sum(axis=0) * 1e3, case["sum_t"], atol=1e-6)
        for sample in case["samples"]:
            np.testing.assert_allclose(S[sample["index"], :3, :3], sample["R"], atol=1e-12)
            np.testing.assert_allclose(S[sample["index"], :3, 3] * 1e3, sample["t"], atol=1e-9)


def test_symmetries_leave_the_object_where_it_is() -> None:
    cylinder = trimesh.creation.cylinder(30, 100, sections=64)
    offset = np.array([5.0, -3.0, 7.0])
    flip = np.diag([1.0, -1, -1, 1])
    flip[:3, 3] = offset - flip[:3, :3] @ offset
    info = {
        "symmetries_discrete": [flip.ravel().tolist()],
        "symmetries_continuous": [{"axis": [0, 0, 2], "offset": offset.tolist()}],
    }
    S = symmetry_transforms(info, "cylinder", 64)
    assert len(S) == 128
    np.testing.assert_array_equal(S[0], np.eye(4))
    points = (np.asarray(cylinder.vertices) + offset) * 1e-3
    for T in S:
        distances = np.linalg.norm(apply(T, points)[:, None] - points[None], axis=2).min(axis=1)
        assert distances.max() < 1e-9


def test_a_mesh_without_area_is_refused() -> None:
    from verefine_viz.core.errors import InputError
    from verefine_viz.scenes.meshes import Mesh

    line = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]], np.int32), None)
    with pytest.raises(InputError, match="all its triangles are degenerate"):
        model_of_mesh(line, 1, "line", 10, 0)


def sphere_points(n: int) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(n, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def test_the_diameter_of_many_points_takes_little_memory() -> None:
    points = sphere_points(60_000)
    tracemalloc.start()
    found = largest_distance(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == pytest.approx(2.0, rel=1e-3)
    assert peak < 200e6, "the products of all points and directions would be a gigabyte"


def test_a_hull_put_together_from_samples_is_the_hull(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(0).normal(size=(5000, 3))
    whole = hull_vertices(points)
    monkeypatch.setattr(meshes, "HULL_AT_ONCE", 700)
    assert set(hull_vertices(points)) == set(whole)
    points[:, 2] = 0.0
    assert largest_distance(points) == pytest.approx(max(np.linalg.norm(points - p, axis=1).max() for p in points))


def test_parts_wound_in_any_way_are_turned_alike_each(tmp_path: Path) -> None:
    parts = [trimesh.creation.icosphere(2, 50), trimesh.creation.torus(40, 10).apply_translation((200, 0, 0))]
    mesh = trimesh.util.concatenate(parts)
    faces = np.array(mesh.faces)
    turned = np.random.default_rng(0).random(len(faces)) < 0.4
    turned[0] = turned[len(parts[0].faces)] = False
    faces[turned] = faces[turned][:, ::-1]
    trimesh.Trimesh(mesh.vertices, faces, process=False).export(tmp_path / "a.ply")
    read = read_mesh(tmp_path / "a.ply", 1e-3)
    back = trimesh.Trimesh(read.vertices_m, read.faces, process=False)
    assert back.is_winding_consistent
    assert back.volume * 1e9 == pytest.approx(mesh.volume, rel=1e-5)


def test_a_surface_with_one_side_stays_as_it_is(tmp_path: Path) -> None:
    n, height = 40, np.array([-10.0, 10.0])
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)[:, None]
    radius = 100 + height * np.cos(turn / 2)
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), height * np.sin(turn / 2)], axis=2).reshape(
        -1, 3
    )
    rim = [(2 * k, 2 * k + 1) for k in range(n)] + [(1, 0)]
    quads = [(*rim[k], *rim[k + 1]) for k in range(n)]
    faces = np.array([face for p, q, r, s in quads for face in ((p, r, q), (q, r, s))])
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "moebius.ply")
    read = read_mesh(tmp_path / "moebius.ply", 1e-3)
    assert len(read.faces) == len(faces)
    assert len(np.unique(np.sort(read.faces, axis=1), axis=0)) == len(faces)


# Textures


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


@pytest.mark.parametrize("uv_offset", [0.0, 3.0, -2.0])
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


def test_a_texture_does_not_change_the_shape(tmp_path: Path) -> None:
    textured = read_mesh(checked(tmp_path), 1e-3)
    (tmp_path / "skin.png").unlink()
    plain = read_mesh(tmp_path / "box.ply", 1e-3)
    assert textured.texture is not None
    assert plain.texture is None
    np.testing.assert_array_equal(textured.vertices_m, plain.vertices_m)
    np.testing.assert_array_equal(textured.faces, plain.faces)
    assert len(textured.vertices_m) == 8


@pytest.mark.parametrize("mode", ["L", "RGBA", "P"])
def test_a_texture_of_any_kind_of_image_is_rgb(tmp_path: Path, mode: str) -> None:
    texture = read_mesh(checked(tmp_path, mode=mode), 1e-3).texture
    assert texture is not None
    assert texture.image.shape == (64, 64, 3)
    assert (np.ptp(texture.image, axis=2) == 0).all() == (mode == "L")


def test_a_large_texture_is_made_smaller(tmp_path: Path) -> None:
    texture = read_mesh(checked(tmp_path, size=3000), 1e-3).texture
    assert texture is not None
    assert texture.image.shape == (meshes.LARGEST_TEXTURE_PX, meshes.LARGEST_TEXTURE_PX, 3)
    points, _, colors = surface_colors(tmp_path / "box.ply")
    assert len(np.unique(colors.round(), axis=0)) < len(points) / 10


def test_a_texture_turns_with_the_faces_of_an_inside_out_mesh(tmp_path: Path) -> None:
    path = checked(tmp_path)
    _, _, outward = surface_colors(path)
    head, _, body = path.read_text().partition("end_header\n")
    lines = [line.split() for line in body.splitlines()]
    turned = [f"3 {c} {b} {a}" if line[0] == "3" and len(line) == 4 else " ".join(line)
              for line in lines for _, a, b, c in [line if len(line) == 4 else [0, 0, 0, 0]]]  # fmt: skip
    path.write_text(head + "end_header\n" + "\n".join(turned) + "\n")
    points, across, colors = surface_colors(path)
    u, v = points[np.arange(400), (across + 1) % 3], points[np.arange(400), (across + 2) % 3]
    inner = (u < 0.48) & (v > 0.52)
    np.testing.assert_allclose(colors[inner], np.tile([255, 0, 0], (int(inner.sum()), 1)), atol=1e-6)
    assert len(outward) == 400


def test_a_ply_of_two_textures_is_of_one_colour_and_says_so(tmp_path: Path) -> None:
    path = checked(tmp_path)
    comment = "comment TextureFile skin.png\n"
    path.write_text(path.read_text().replace(comment, comment + "comment TextureFile other.png\n"))
    mesh = read_mesh(path, 1e-3)
    assert mesh.texture is None
    assert "names 2 textures" in mesh.notes[0]


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


def test_an_obj_s_texture_is_kept(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8).repeat(8, axis=1)).save(tmp_path / "skin.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    lines = ["mtllib a.mtl", "usemtl m", "v 0 0 0", "v 100 0 0", "v 0 100 0", "v 0 0 100", "vt 0.1 0.5", "vt 0.9 0.5"]
    lines += [
        f"f {a}/{t} {b}/{t} {c}/{t}"
        for (a, b, c), t in zip([(1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)], (1, 1, 2, 2), strict=True)
    ]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    model = model_of_mesh(read_mesh(tmp_path / "a.obj", 1e-3), 1, "a", 10, 0)
    assert model.texture is not None
    seen = model.colors(np.arange(4), np.full((4, 3), 1 / 3)).round()
    assert sorted(map(tuple, seen)) == [(0, 0, 255), (0, 0, 255), (255, 0, 0), (255, 0, 0)]
