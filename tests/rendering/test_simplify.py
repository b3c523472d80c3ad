"""Simplified meshes keep their promise, on disk too."""

from __future__ import annotations

import gc
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.rendering.witness import model_of
from verefine_viz.core.model import ObjectModel
from verefine_viz.rendering.simplify import deviation_m, scoring_mesh, simplified

pytestmark = pytest.mark.usefixtures("long_run")


def ball() -> ObjectModel:
    return model_of(trimesh.creation.icosphere(5, 0.05))


def brute_force_deviation_m(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> float:
    """An independent look at it: other sample points, trimesh's closest points."""
    there, back = (trimesh.Trimesh(*m, process=False) for m in (a, b))
    distances = [
        trimesh.proximity.closest_point(y, trimesh.sample.sample_surface(x, 2000, seed=3)[0])[1].max()
        for x, y in ((there, back), (back, there))
    ]
    return float(max(distances))


@pytest.mark.parametrize("tolerance_mm", [0.05, 0.2, 1.0])
def test_the_deviation_is_within_the_tolerance(tolerance_mm: float) -> None:
    model = ball()
    mesh = simplified(model.vertices, model.faces, tolerance_mm / 1000)
    original = model.vertices, np.asarray(model.faces)
    assert deviation_m(original, mesh) <= tolerance_mm / 1000
    assert brute_force_deviation_m(original, mesh) <= 1.05 * tolerance_mm / 1000
    assert len(mesh[1]) < 0.7 * len(model.faces)


def test_a_looser_tolerance_gives_fewer_faces() -> None:
    model = ball()
    n = [len(simplified(model.vertices, model.faces, t / 1000)[1]) for t in (0.05, 0.2, 1.0)]
    assert n[0] > n[1] > n[2]


def test_small_parts_do_not_vanish() -> None:
    speck = trimesh.creation.icosphere(0, 0.001).apply_translation([0.08, 0, 0])
    model = model_of(trimesh.util.concatenate([trimesh.creation.icosphere(4, 0.05), speck]))
    vertices, _ = simplified(model.vertices, model.faces, 0.0005)
    assert vertices[:, 0].max() > 0.0805


def test_seams_do_not_tear() -> None:
    """Vertices doubled along a texture seam are one place."""
    mesh = trimesh.creation.icosphere(4, 0.05)
    split = model_of(
        trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(len(mesh.faces) * 3).reshape(-1, 3), process=False)
    )
    result = trimesh.Trimesh(*simplified(split.vertices, split.faces, 0.0005), process=False)
    assert result.is_watertight


def test_0_keeps_every_triangle(tmp_path: Path) -> None:
    model = ball()
    mesh = scoring_mesh(model, 0, tmp_path)
    assert np.array_equal(mesh.faces, model.faces)
    assert not list(tmp_path.iterdir())


def test_the_second_call_reads_the_first_one_s_file(tmp_path: Path) -> None:
    model = ball()
    first = scoring_mesh(model, 0.2, tmp_path)
    (file,) = tmp_path.iterdir()
    assert model.mesh_hash in file.name
    written = file.stat().st_mtime_ns
    second = scoring_mesh(model, 0.2, tmp_path)
    assert file.stat().st_mtime_ns == written
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)
    assert first.closed.all()
    assert np.array_equal(first.closed, second.closed)
    scoring_mesh(model, 0.5, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("damage", ["empty", "truncated", "garbage", "foreign"])
def test_a_damaged_file_is_made_again(tmp_path: Path, damage: str) -> None:
    model = ball()
    first = scoring_mesh(model, 0.2, tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    if damage == "foreign":
        with file.open("wb") as stream:
            np.savez(stream, vertices=np.zeros((2, 3)), faces=np.array([[0, 1, 9]]))
    else:
        file.write_bytes({"empty": b"", "truncated": whole[: len(whole) // 2], "garbage": b"\x80\x04." * 50}[damage])
    again = scoring_mesh(model, 0.2, tmp_path)
    assert np.array_equal(first.faces, again.faces)
    assert len(file.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("not a folder")
    assert len(scoring_mesh(ball(), 0.5, blocker / "meshes").faces) > 10


def test_threads_read_cached_meshes_at_the_same_time(tmp_path: Path) -> None:
    """Python 3.11 fails where another thread parses the header of an array while this one's garbage is collected."""
    model = ball()
    expected = scoring_mesh(model, 0.5, tmp_path)
    threshold, callback = gc.get_threshold(), lambda *_: time.sleep(0)
    gc.set_threshold(10)
    gc.callbacks.append(callback)
    try:
        with ThreadPoolExecutor(4) as pool:
            meshes = list(pool.map(lambda _: scoring_mesh(model, 0.5, tmp_path), range(100)))
    finally:
        gc.callbacks.remove(callback)
        gc.set_threshold(*threshold)
    assert all(np.array_equal(mesh.vertices, expected.vertices) for mesh in meshes)
