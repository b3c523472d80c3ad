"""Every failure session shows its failure: what the page promises to make obvious really happens in the run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.records import Iteration
from verefine_viz.evaluation.pose_errors import PoseErrors, pose_errors
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
    state: Any
    iterations: tuple[Iteration, ...]

    @property
    def truth(self) -> Placed:
        return Placed(0, self.target.model, self.target.instance.T_cam_obj_gt)

    def errors(self, T_cam_obj: np.ndarray) -> PoseErrors:
        return pose_errors(self.target.model, T_cam_obj, self.truth.T_cam_obj)

    @property
    def truth_score(self):
        return self.toolbox.verifier.score(self.target, self.truth.T_cam_obj[None])[0]

    @property
    def best(self):
        best = self.state.best[0]
        assert best is not None
        return best


@cache
def as_it_is(name: str) -> Played:
    """Played once for all tests."""
    return play(name)


def play(name: str, **overrides: dict[str, object]) -> Played:
    toolbox = Toolbox(load_session(SESSIONS / f"{name}.toml", overrides))
    problem = toolbox.problem(toolbox.frames[0])
    run = toolbox.run(problem)
    state = run.finish()
    (target,) = problem.targets
    return Played(toolbox, target, state, run.iterations)


@pytest.mark.parametrize("name", sorted(FAILURES))
def test_every_failure_ends_wrong_and_neither_title_nor_notes_say_why(name: str) -> None:
    played = as_it_is(name)
    assert played.errors(played.best.T_cam_obj).relative > 0.1
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
    played = as_it_is("failure_arm_starved")
    assert 4 not in {i.arm for i in played.iterations}
    assert played.errors(played.best.T_cam_obj).relative > 0.1
    what_if = play("failure_arm_starved", method={"exploration": 0.2})
    assert 4 in {i.arm for i in what_if.iterations}
    assert what_if.best.arm == 4
    assert what_if.best.score.score > played.best.score.score + 0.1
    assert what_if.errors(what_if.best.T_cam_obj).relative < 0.02


def test_the_mug_gives_the_bandit_something_to_do() -> None:
    played = as_it_is("mug")
    assert len({i.arm for i in played.iterations}) >= 2
    assert played.best.score.score > 0.85
    assert played.errors(played.best.T_cam_obj).relative < 0.05


def test_score_prefers_flip() -> None:
    name = "failure_score_prefers_flip"
    played = as_it_is(name)
    assert played.errors(played.best.T_cam_obj).rotation_deg > 170
    assert abs(played.best.score.score - played.truth_score.score) < 0.01, "depth cannot tell"
    for w in (0.1, 0.4):
        by_colour = play(name, score={"colour_weight": w})
        assert by_colour.errors(by_colour.best.T_cam_obj).relative < 0.02
        assert by_colour.best.score.colour_fit > 0.9
        upside_down = by_colour.toolbox.verifier.score(by_colour.target, played.best.T_cam_obj[None])[0]
        assert by_colour.best.score.score > upside_down.score + 0.5 * w
