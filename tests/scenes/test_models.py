"""Meshes of every format come out in metres, with outward sampled normals, closed, and with their symmetries."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import decoded_json
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.settings import ModelSampling
from verefine_viz.scenes import meshes
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.meshes import Mesh, hull_vertices, largest_distance, read_mesh
from verefine_viz.scenes.models import ModelInfo, ModelLibrary, model_of_mesh, symmetry_transforms

SIZE_MM = np.array([100.0, 80.0, 60.0])


def model_info(written: dict) -> ModelInfo:
    return decoded_json(json.dumps(written).encode(), ModelInfo)


def box() -> trimesh.Trimesh:
    return trimesh.creation.box(SIZE_MM)


def boxed(folder: Path, name: str, scale: float = 1.0) -> Path:
    """A BOP folder with a model of the box."""
    (folder / "models").mkdir(exist_ok=True)
    trimesh.creation.box(SIZE_MM * scale).export(folder / "models" / name)
    return folder


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb"])
def test_every_format_gives_the_same_box(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box.{suffix}"
    box().export(path)
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 500, 0)
    assert model.vertices.shape == (8, 3)
    assert model.faces.shape == (12, 3)
    assert model.diameter_m == pytest.approx(np.linalg.norm(SIZE_MM) * 1e-3, rel=1e-6)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), SIZE_MM * 1e-3, rtol=1e-6)


@pytest.mark.parametrize("sampling", ["random", "even"])
def test_sampled_points_lie_on_the_surface_with_outward_normals(tmp_path: Path, sampling: ModelSampling) -> None:
    path = tmp_path / "box.ply"
    box().export(path)
    model = model_of_mesh(read_mesh(path, 1e-3), 1, "box", 3000, 0, sampling=sampling)
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


def test_an_even_cloud_is_spread_far_more_uniformly_and_depends_on_the_seed_only(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    box().export(path)
    mesh = read_mesh(path, 1e-3)
    random, a, b, c = (
        model_of_mesh(mesh, 1, "box", 1000, seed, sampling=sampling)
        for sampling, seed in (("random", 4), ("even", 4), ("even", 4), ("even", 5))
    )
    assert a.points.tobytes() == b.points.tobytes() != c.points.tobytes()

    def variation(model: ObjectModel) -> float:
        """Deviation of the distances to the nearest point, as a share of their mean."""
        nearest_m = KDTree(model.points).query(model.points, 2)[0][:, 1]
        return float(nearest_m.std() / nearest_m.mean())

    assert len(a.points) == 1000
    assert variation(random) > 0.4
    assert variation(a) < 0.2


@pytest.mark.parametrize("source", ["bop", "demo"])
def test_a_session_says_how_model_clouds_are_spread(source: str, tmp_path: Path) -> None:
    gaps_m = []
    for sampling in ("random", "even"):
        library = ModelLibrary(boxed(tmp_path, "obj_000001.ply"), 300, 0, sampling)
        model = library.get(1) if source == "bop" else demo_model("mug", 300, 0, sampling)
        gaps_m.append(KDTree(model.points).query(model.points, 2)[0][:, 1].min())
    assert gaps_m[1] > 5 * gaps_m[0]


def test_units_and_diameters_of_a_bop_folder(tmp_path: Path) -> None:
    """A GLB is in metres; without models_info.json the diameter is measured, and a millimetre speck is noted."""
    for name, scale in (("obj_000001.ply", 1.0), ("obj_000002.ply", 1e-3), ("obj_000003.glb", 1e-3)):
        boxed(tmp_path, name, scale)
    diameter_mm = np.linalg.norm(SIZE_MM)
    library = ModelLibrary(tmp_path, 100, 0)
    assert library.get(1).diameter_m == pytest.approx(diameter_mm * 1e-3)
    assert library.notes(1) == ()
    assert "unit" in library.notes(2)[0]
    (tmp_path / "models" / "models_info.json").write_text(json.dumps({"3": {"diameter": diameter_mm}}))
    library = ModelLibrary(tmp_path, 100, 0)
    np.testing.assert_allclose(np.ptp(library.get(3).vertices, axis=0), SIZE_MM * 1e-3, rtol=1e-6)
    assert library.notes(3) == ()


def test_symmetries_are_the_official_ones(shared_data: Path) -> None:
    vectors = json.loads((shared_data / "bop_vectors" / "vectors.json").read_text())
    for case in vectors["symmetries"]:
        info = vectors["meshes"][case["mesh"]]["models_info"]
        steps = int(np.ceil(np.pi / case["max_sym_disc_step"]))
        S = symmetry_transforms(model_info(info), case["mesh"], steps)
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
    S = symmetry_transforms(model_info(info), "cylinder", 64)
    assert len(S) == 128
    np.testing.assert_array_equal(S[0], np.eye(4))
    points = (np.asarray(cylinder.vertices) + offset) * 1e-3
    for T in S:
        distances = np.linalg.norm(apply(T, points)[:, None] - points[None], axis=2).min(axis=1)
        assert distances.max() < 1e-9


def test_a_mesh_without_area_is_refused() -> None:
    line = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]], np.int32), None)
    with pytest.raises(InputError, match="degenerate"):
        model_of_mesh(line, 1, "line", 10, 0)


def test_a_hull_put_together_from_samples_is_the_hull(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(0).normal(size=(5000, 3))
    whole = hull_vertices(points)
    monkeypatch.setattr(meshes, "HULL_AT_ONCE", 700)
    assert set(hull_vertices(points)) == set(whole)
    points[:, 2] = 0.0
    assert largest_distance(points) == pytest.approx(max(np.linalg.norm(points - p, axis=1).max() for p in points))
