"""CoACD in a process of its own: it ends when nobody waits any more or its time is up, and says what is wrong when it
cannot.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.physics.bodies import angle, ball, ring, soup
from tests.progress import ending_after
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import Cancelled, ShapeError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.side_by_side import side_by_side
from verefine_viz.physics import colliders, decomposition
from verefine_viz.physics.colliders import Collider, build, collider, signed_distance
from verefine_viz.physics.decomposition import decomposed
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference

pytestmark = pytest.mark.usefixtures("processes")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """The processes that are started."""
    found: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def noted(*given, **named):
        found.append(start(*given, **named))
        return found[-1]

    monkeypatch.setattr(subprocess, "Popen", noted)
    return found


@pytest.mark.parametrize("n", [0, 1, 2])
def test_what_is_cancelled_leaves_neither_a_process_nor_a_file(
    tmp_path: Path, started: list[subprocess.Popen[bytes]], n: int
) -> None:
    with pytest.raises(Cancelled):
        collider(ring(), "decomposition", tmp_path, ending_after(n))
    assert list(tmp_path.iterdir()) == []
    assert len(started) == (n > 0)
    assert all(child.returncode == -9 for child in started)


def test_after_a_cancelled_one_the_same_collider_is_built(hollow_ring: Collider, tmp_path: Path) -> None:
    simulator = BulletSimulator(PhysicsSettings(), tmp_path, ending_after(2))
    with pytest.raises(Cancelled):
        simulator.collider(ring())
    again = BulletSimulator(PhysicsSettings(), tmp_path).collider(ring())
    assert first_difference(again, hollow_ring) is None


def test_a_process_that_fails_is_reported_in_one_line_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(ShapeError) as caught:
        decomposed("object 7 (ring)", ring().vertices, ring().faces)
    assert str(caught.value) == (
        "object 7 (ring) cannot be taken apart into convex parts (CoACD ended with exit code 1: no message); "
        'set physics.collider = "hull"'
    )


ELSEWHERE: list[Callable[[Float], Float]] = [
    lambda v: v + 0.2,
    lambda v: 10 * v,
    lambda v: 0.5 * v,
    lambda v: v / np.abs(v).max(),
    lambda v: v[:, ::-1],
]
"""Not where the mesh is: beside it, in another unit, smaller, in units of the simplifier, with other axes."""


def test_parts_that_do_not_lie_on_the_mesh_are_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    for moved in ELSEWHERE:
        monkeypatch.setattr(colliders, "decomposed", lambda *_, moved=moved: [moved(ring().vertices)])
        with pytest.raises(ShapeError, match=r'they do not lie on its mesh\); set physics.collider = "hull"$'):
            build(ring(), "decomposition")


def test_a_cached_collider_that_does_not_lie_on_the_mesh_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    large = build(ball(1.0), "hull")
    monkeypatch.setattr(colliders, "build", lambda *_: large)
    assert collider(ball(), "hull", tmp_path) is large  # As a writer with a defect would leave it.
    monkeypatch.undo()
    assert collider(ball(), "hull", tmp_path).parts[0].max() < 0.03
    assert "made again" in caplog.text
    assert collider(ball(), "hull", tmp_path).parts[0].max() < 0.03


def test_what_lies_in_the_working_folder_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "coacd.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    assert len(decomposed("angle", angle().vertices, angle().faces)) > 1


def test_a_mesh_larger_than_a_pipe_holds_is_taken_apart() -> None:
    mesh = trimesh.creation.box([0.1, 0.06, 0.04])
    for _ in range(4):
        mesh = mesh.subdivide()
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)
    assert vertices.nbytes + faces.nbytes > 65_536
    parts = decomposed("box", vertices, faces, ending_after(6_000))
    assert abs(signed_distance(parts, vertices)).max() < 0.005


def test_what_takes_too_long_is_its_hull_and_is_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, started: list[subprocess.Popen[bytes]]
) -> None:
    monkeypatch.setattr(decomposition, "LIMIT_S", 1)
    first = collider(soup(1000), "decomposition", tmp_path)
    assert first.took_too_long
    assert first_difference(first.parts, build(soup(1000), "hull").parts) is None
    assert "physics takes it for its convex hull" in first.note
    assert first_difference(first, collider(soup(1000), "decomposition", tmp_path)) is None
    assert len(started) == 1


def test_each_start_is_reported_once_and_how_long_it_takes_meanwhile() -> None:
    told: list[str] = []
    told_once: list[str] = []
    progress = ProgressToken(lambda doing, share: told.append(doing), report_once=told_once.append)
    decomposed("object 7 (angle)", angle().vertices, angle().faces, progress)
    assert len(told_once) == 1
    assert told[:1] == told_once
    assert all("object 7 (angle)" in doing for doing in told)
    assert [doing for doing in told[1:] if " s so far" not in doing] == []


def test_side_by_side_and_one_after_the_other_give_the_same_files(tmp_path: Path) -> None:
    things = [angle(), ring(0.03)]
    for thing in things:
        collider(thing, "decomposition", tmp_path / "one by one")
    jobs = [partial(collider, thing, "decomposition", tmp_path / "at once") for thing in things]
    assert len(side_by_side(jobs, ProgressToken())) == 2
    one, other = ({p.name: p.read_bytes() for p in (tmp_path / name).iterdir()} for name in ("one by one", "at once"))
    assert len(one) == 2
    assert one == other


def test_who_needs_the_same_model_at_the_same_time_waits_for_it(
    tmp_path: Path, started: list[subprocess.Popen[bytes]]
) -> None:
    with ThreadPoolExecutor(3) as pool:
        built = list(pool.map(lambda _: collider(angle(), "decomposition", tmp_path), range(3)))
    assert len(started) == 1
    assert [first_difference(built[0], other) for other in built[1:]] == [None, None]


KILLED = """
import sys
from pathlib import Path
from tests.physics.bodies import angle
from verefine_viz.physics.colliders import collider
collider(angle(), "decomposition", Path(sys.argv[1]))
"""


def test_after_a_killed_process_another_makes_it(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)]) as other:
        while not list(tmp_path.glob("*.lock")):
            time.sleep(0.02)
        other.kill()
    assert [path.suffix for path in tmp_path.iterdir()] == [".lock"]
    assert len(collider(angle(), "decomposition", tmp_path).parts) > 1
    assert [path.suffix for path in tmp_path.iterdir()] == [".npz"]
