"""Meshes to score and colliders that are prepared at the same time: each comes from the mesh that was asked for."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh

from tests.physics.bodies import model
from verefine_viz.physics import colliders
from verefine_viz.physics.colliders import build
from verefine_viz.recording.verify import first_difference
from verefine_viz.rendering.simplify import simplified


@pytest.fixture
def _switching_often() -> Iterator[None]:
    """Threads take turns a thousand times as often as they usually do."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(interval_s)


@pytest.mark.usefixtures("_switching_often")
def test_threads_that_prepare_models_at_once_get_their_own_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = model(trimesh.creation.annulus(0.04, 0.06, 0.05, sections=128).subdivide(), name="ring")
    ball = model(trimesh.creation.icosphere(3, 0.8), name="ball")
    monkeypatch.setattr(colliders, "decomposed", lambda name, vertices, faces, progress: [vertices])

    def solid() -> object:
        return build(ring, "decomposition")

    def mesh() -> object:
        return simplified(ball.vertices, np.asarray(ball.faces), 0.01)

    alone = solid(), mesh()
    with ThreadPoolExecutor(2) as pool:
        at_once = [(pool.submit(solid), pool.submit(mesh)) for _ in range(10)]
    assert [first_difference(alone[0], one.result()) for one, _ in at_once] == [None] * 10
    assert [first_difference(alone[1], other.result()) for _, other in at_once] == [None] * 10
