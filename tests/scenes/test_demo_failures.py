"""Every failure session shows its failure: what the page promises to make obvious really happens in the run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.breakpoints import hits
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo import demo_objects
from verefine_viz.scenes.demo_scenes import FAILURES

pytestmark = pytest.mark.usefixtures("long_run")

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"


@dataclass(frozen=True, eq=False)
class Played:
    """A session, run to its end."""

    toolbox: Toolbox
    target: Target
    iterations: tuple[Iteration, ...]
    best: Best

    @property
    def errors(self) -> PoseErrors:
        return pose_errors(self.target.model, self.best.T_cam_obj, self.target.instance.T_cam_obj_gt)

    def score_of(self, T_cam_obj: np.ndarray) -> float:
        return self.toolbox.verifier.score(self.target, T_cam_obj[None])[0].score


def play(name: str, **overrides: dict[str, object]) -> Played:
    toolbox = Toolbox(load_session(SESSIONS / f"{name}.toml", overrides))
    problem = toolbox.problem(toolbox.frames[0])
    run = toolbox.run(problem)
    (best,), (target,) = run.finish().best, problem.targets
    return Played(toolbox, target, run.iterations, best)


@pytest.mark.parametrize("name", sorted(FAILURES))
def test_every_failure_ends_wrong_and_neither_title_nor_notes_say_why(name: str) -> None:
    played = play(name)
    assert played.errors.relative > 0.1
    title = played.toolbox.session.title
    assert title.startswith("What went wrong? ")
    assert not set(name.removeprefix("failure_").split("_")) & set(title.lower().split())
    problem = played.toolbox.problem(played.toolbox.frames[0])
    assert all(note.startswith("the initial poses belong to this scene") for note in problem.notes)
    assert demo_objects(name) == {obj_id: model.name for obj_id, model in problem.models.items()}


def test_every_failure_has_its_session() -> None:
    # Out of range is a session of its own: the scene is the duck, and a learned refiner starts too far away.
    assert {p.stem for p in SESSIONS.glob("failure_*.toml")} == {*FAILURES, "failure_out_of_range"}


@pytest.mark.parametrize("steps", [3, 20])
def test_what_topples_is_marked_however_short_the_simulation(steps: int) -> None:
    played = play("failure_simulation_topples", method={"name": "rir"}, physics={"steps": steps})
    for arm in (0, 1):
        first = next(i for i in played.iterations if i.arm == arm)
        (text,) = (e.text for e in first.events if e.kind == "unstable")
        assert text.startswith("Would tip: after step 3 of 3" if steps == 3 else ("Would tip", "Tipped over"))
        assert "mm outside its support" in text
        problem = played.toolbox.problem(played.toolbox.frames[0])
        assert hits(played.toolbox.session.breakpoints, problem, first) == (text,)


def test_a_promising_arm_is_starved() -> None:
    played = play("failure_arm_starved")
    assert 4 not in {i.arm for i in played.iterations}
    what_if = play("failure_arm_starved", method={"exploration": 0.2})
    assert what_if.best.arm == 4
    assert what_if.best.score.score > played.best.score.score + 0.1
    assert what_if.errors.relative < 0.02


def test_the_mug_gives_the_bandit_something_to_do() -> None:
    played = play("mug")
    assert len({i.arm for i in played.iterations}) >= 2
    assert played.best.score.score > 0.85
    assert played.errors.relative < 0.05


def test_score_prefers_flip() -> None:
    name = "failure_score_prefers_flip"
    played = play(name)
    assert played.errors.rotation_deg > 170
    at_truth = played.score_of(played.target.instance.T_cam_obj_gt)
    assert abs(played.best.score.score - at_truth) < 0.01, "depth cannot tell"
    for w in (0.1, 0.4):
        by_colour = play(name, score={"colour_weight": w})
        assert by_colour.errors.relative < 0.02
        assert by_colour.best.score.colour_fit > 0.9
        assert by_colour.best.score.score > by_colour.score_of(played.best.T_cam_obj) + 0.5 * w
