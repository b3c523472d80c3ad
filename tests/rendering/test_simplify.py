"""Simplified meshes keep their promise, on disk too."""

from __future__ import annotations

import gc
import io
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.rendering.witness import model_of
from verefine_viz.core.model import ObjectModel
from verefine_viz.rendering.simplify import deviation_m, scoring_mesh, simplified

pytestmark = pytest.mark.usefixtures("long_run")


@cache
def ball(subdivisions: int = 4) -> ObjectModel:
    return model_of(trimesh.creation.icosphere(subdivisions, 0.05))


@pytest.fixture(scope="module")
def by_tolerance_mm() -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """A finely meshed ball, simplified."""
    model = ball(5)
    return {t: simplified(model.vertices, model.faces, t / 1000) for t in (0.05, 0.2, 1.0)}


def brute_force_deviation_m(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> float:
    """An independent look at it: other sample points, trimesh's closest points."""
    there, back = (trimesh.Trimesh(*m, process=False) for m in (a, b))
    distances = [
        trimesh.proximity.closest_point(y, trimesh.sample.sample_surface(x, 2000, seed=3)[0])[1].max()
        for x, y in ((there, back), (back, there))
    ]
    return float(max(distances))


def test_the_deviation_is_within_the_tolerance_and_a_looser_one_gives_fewer_faces(
    by_tolerance_mm: dict[float, tuple[np.ndarray, np.ndarray]],
) -> None:
    original = ball(5).vertices, np.asarray(ball(5).faces)
    n_faces = 0.7 * len(original[1])
    for tolerance_mm, mesh in by_tolerance_mm.items():
        assert deviation_m(original, mesh) <= tolerance_mm / 1000, tolerance_mm
        assert brute_force_deviation_m(original, mesh) <= 1.05 * tolerance_mm / 1000, tolerance_mm
        assert len(mesh[1]) < n_faces, tolerance_mm
        n_faces = len(mesh[1])


def test_small_parts_do_not_vanish_and_seams_do_not_tear() -> None:
    speck = trimesh.creation.icosphere(0, 0.001).apply_translation([0.08, 0, 0])
    model = model_of(trimesh.util.concatenate([trimesh.creation.icosphere(4, 0.05), speck]))
    vertices, _ = simplified(model.vertices, model.faces, 0.0005)
    assert vertices[:, 0].max() > 0.0805
    # Vertices doubled along a texture seam are one place.
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


def test_a_damaged_file_is_made_again(tmp_path: Path) -> None:
    model = ball()
    first = scoring_mesh(model, 0.2, tmp_path)
    (file,) = tmp_path.iterdir()
    whole, foreign = file.read_bytes(), io.BytesIO()
    np.savez(foreign, vertices=np.zeros((2, 3)), faces=np.array([[0, 1, 9]]))
    for damaged in (b"", whole[: len(whole) // 2], b"\x80\x04." * 50, foreign.getvalue()):
        file.write_bytes(damaged)
        again = scoring_mesh(model, 0.2, tmp_path)
        assert np.array_equal(first.faces, again.faces), damaged[:20]
        assert len(file.read_bytes()) == len(whole), damaged[:20]


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
