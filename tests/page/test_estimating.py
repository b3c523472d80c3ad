"""Initial poses by an estimator from the page: for one object of one frame, with the run before still there."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.page.conftest import Posted
from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.estimators import registry
from verefine_viz.page import protocol as p
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.session_file import load_session, resolve, save_session
from verefine_viz.run.toolbox import Toolbox


class Estimator:
    """Gives everything the same two poses."""

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        return tuple(Hypothesis(transform(np.eye(3), [0, 0.02 * k, 0.6]), 0.5, "ppf") for k in range(2))


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Session:
    """Frames "7/3" and "8/3" with the same three instances."""
    for name in registry.ESTIMATORS:
        monkeypatch.setitem(registry.ESTIMATORS, name, lambda session: Estimator())
    made = make(tmp_path / "data", targets=False)
    shutil.copytree(made.scene, made.scene.parent / "000008")
    raw: dict[str, Any] = {
        "scene": {"source": "bop", "dataset": str(made.root), "model_points": 200},
        "hypotheses": {"max_per_object": 3},
        "method": {"iterations": 1},
        "physics": {"enabled": False},
        "score": {"renderer": "cpu"},
    }
    return resolve(raw)


def opened(of: Session, posted: Posted | None = None) -> Debugger:
    return Debugger(Workspace(of, None, Toolbox), Posted() if posted is None else posted)


def sources(d: Debugger, branch: int | None = None) -> list[set[str]]:
    """Return where the initial poses of each instance come from; in the branch made last."""
    of = d.space.branch(max(d.space.branches) if branch is None else branch)
    return [{h.source.split()[0] for h in i.hypotheses} for i in of.run.problem.instances]


FROM_SESSION = [{"perturbed"}] * 3
ESTIMATED = [{"perturbed"}, {"ppf"}, {"perturbed"}]


def test_they_hold_for_that_object_of_that_frame(session: Session):
    d = opened(session).carry_out([p.Estimate(1, "ppf")])
    assert sources(d) == ESTIMATED
    assert sources(d.carry_out([p.Open(frame="8/3")])) == FROM_SESSION
    assert sources(d.carry_out([p.Open(frame="7/3")])) == ESTIMATED
    d.carry_out([p.Open(frame="8/3")])
    d.carry_out([p.Estimate(0, "pcs", max(d.space.branches))])
    assert d.space.tools.session.hypotheses.estimate == (("7/3", 1, "ppf"), ("8/3", 0, "pcs"))


def test_the_run_before_stays_as_a_branch_and_windows_get_both_starts(session: Session):
    posted = Posted()
    d = opened(session, posted).carry_out([p.RunVerb()])
    before = d.space.work.first.run
    d.carry_out([p.Estimate(1, "ppf")])
    first, new = d.space.branches.values()
    assert first.run is before
    assert (first.name, new.name) == ("first run", f"{posted.of('frame')[-1]['objects'][1]['label']} from ppf")
    assert [sources(d, index) for index in d.space.branches] == [FROM_SESSION, ESTIMATED]
    arms = {o["id"]: len(o["arms"]) for o in posted.of("frame")[-1]["objects"]}
    start = [m["start"] for m in posted.of("run") if m["branch"] == new.index][-1]
    assert arms == {0: 3, 1: 3, 2: 3}
    assert {own: len(poses) for own, poses in start.items()} == {"1": 2}
    again = opened(session).carry_out(d.log)
    assert [sources(again, index) for index in again.space.branches] == [FROM_SESSION, ESTIMATED]


def test_a_reopened_session_gives_an_object_its_own_initial_poses_back(session: Session, tmp_path: Path):
    d = opened(session).carry_out([p.Estimate(1, "ppf")])
    save_session(d.space.session_of(d.space.branch(1)), tmp_path / "s.toml")
    again = opened(load_session(tmp_path / "s.toml"))
    assert sources(again) == ESTIMATED
    again.carry_out([p.Estimate(1, "session")])
    assert sources(again) == FROM_SESSION
    with pytest.raises(InputError, match="already has the session's initial poses"):
        again.apply(None, p.Estimate(1, "session", max(again.space.branches)))
