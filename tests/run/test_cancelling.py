"""A frame that is cancelled while it is read, or a run while it is begun: nothing stays of it, the next is alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.progress import Countdown, asked, cancelled_everywhere, ending_after
from tests.scenes.bop_folder import make
from verefine_viz.core.errors import Cancelled
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.recording.verify import first_difference
from verefine_viz.rendering.simplify import scoring_mesh
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_models import demo_model

pytestmark = pytest.mark.usefixtures("long_run")

MODES: dict[str, dict[str, Any]] = {
    "perturb": {},
    "pcs": {"pcs": {"bases": 5}},
    "ppf": {"ppf": {"step": 0.1}},
}


def bop(tmp_path: Path, source: str) -> tuple[dict[str, Any], str]:
    made = make(tmp_path)
    scene = {"source": "bop", "dataset": str(made.root), "model_points": 200}
    return {"scene": scene, "hypotheses": {"source": source, "max_per_object": 2}, **MODES[source]}, made.frame


def facts(problem: Problem) -> tuple[object, ...]:
    models = tuple(problem.models[obj_id] for obj_id in sorted(problem.models))
    return problem.observation, problem.instances, models, problem.dependencies, problem.notes


@pytest.mark.parametrize("source", MODES)
def test_a_frame_of_a_folder_that_is_cancelled_can_be_read_again(tmp_path: Path, source: str) -> None:
    raw, frame = bop(tmp_path, source)
    expected = Toolbox(resolve(raw)).problem(frame)
    n = asked(lambda progress: Toolbox(resolve(raw), progress).problem(frame))
    countdown = Countdown()
    box = Toolbox(resolve(raw), countdown.progress)
    for k in range(0, n, 1 + n // 12):
        countdown.left = k
        try:
            box.problem(frame)
        except Cancelled:
            countdown.left = None
            assert first_difference(facts(box.problem(frame)), facts(expected)) is None
    # While colliders are made side by side, how often is asked depends on how long they take.
    with pytest.raises(Cancelled):
        Toolbox(resolve(raw), ending_after(n // 2)).problem(frame)


def test_reading_a_folder_has_a_checkpoint_before_each_model(tmp_path: Path) -> None:
    raw, frame = bop(tmp_path, "perturb")
    told: list[tuple[str, float | None]] = []
    Toolbox(resolve(raw), ProgressToken(lambda doing, share: told.append((doing, share)))).problem(frame)
    assert ("Reading the objects' models.", 0.0) in told
    assert ("", 0.5) in told


def test_a_built_in_scene_that_is_cancelled_can_be_read_again() -> None:
    raw = {"scene": {"demo": "stack"}}
    expected = Toolbox(resolve(raw)).problem("0/0")
    countdown = Countdown()
    box = Toolbox(resolve(raw), countdown.progress)
    for k in range(4):
        countdown.left = k
        with pytest.raises(Cancelled):
            box.problem("0/0")
    countdown.left = None
    assert first_difference(facts(box.problem("0/0")), facts(expected)) is None


def test_a_mesh_to_score_that_is_cancelled_is_not_kept(tmp_path: Path) -> None:
    model = demo_model("bottle", 100, 0)
    whole = scoring_mesh(model, 0.5, tmp_path / "whole")

    def work(progress: ProgressToken) -> object:
        return scoring_mesh(model, 0.5, tmp_path / "stopped", progress)

    n = asked(lambda progress: scoring_mesh(model, 0.5, tmp_path / "counted", progress))
    assert n > 2
    for _ in cancelled_everywhere(work, n, 3):
        assert not list((tmp_path / "stopped").glob("*.npz"))
    again = scoring_mesh(model, 0.5, tmp_path / "stopped")
    assert first_difference(again, whole) is None


def test_a_run_whose_beginning_is_cancelled_can_be_begun_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No mesh to score is on the disk yet: they are made when the initial poses are scored."""
    raw = {
        "scene": {"demo": "duck"}, "hypotheses": {"max_per_object": 2}, "physics": {"enabled": False},
        "method": {"iterations": 1},
    }  # fmt: skip
    problem = Toolbox(resolve(raw)).problem("0/0")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # The scene's solids are kept: making them takes seconds.
    countdown = Countdown()
    box = Toolbox(resolve(raw), countdown.progress)
    countdown.left = 1
    with pytest.raises(Cancelled):
        box.run(problem)
    assert not list((tmp_path / "verefine-viz" / "meshes").glob("*.npz"))
    countdown.left = None
    again, fresh = box.run(problem), Toolbox(resolve(raw)).run(problem)
    assert first_difference(again.finish().best, fresh.finish().best) is None
