"""Initial poses by an estimator from the page: for one object of one frame, with the run before still there."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.run.kept_frames import box_mesh, found, kept
from tests.scenes.bop_folder import make
from tests.viewer.client import client, until
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.estimators import registry
from verefine_viz.run.session_file import load_session, resolve, save_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger

ESTIMATE = c.Estimate(1, "ppf")


class Estimator:
    """Finds the same two poses of everything."""

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        return tuple(Hypothesis(transform(np.eye(3), [0, 0.02 * k, 0.6]), 0.5, "ppf") for k in range(2))


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Session:
    """Frames "7/3" and "8/3" with the same three instances."""
    monkeypatch.setattr(registry, "make_estimator", lambda name, session: Estimator())
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


def methods(debugger: Debugger) -> list[set[str]]:
    """Where the initial poses of each instance of the open frame come from."""
    return [{h.source.split()[0] for h in i.hypotheses} for i in debugger.workspace.work.problem.instances]


FROM_SESSION = [{"perturbed"}] * 3
ESTIMATED = [{"perturbed"}, {"ppf"}, {"perturbed"}]


def test_they_hold_for_that_object_of_that_frame_and_are_still_there_when_one_comes_back(session: Session) -> None:
    d = Debugger(session, None, Toolbox).carry_out([ESTIMATE])
    assert methods(d) == ESTIMATED
    assert d.view().target.instance.instance_id == 1
    assert methods(d.carry_out([c.OpenFrame("8/3")])) == FROM_SESSION
    assert methods(d.carry_out([c.OpenFrame("7/3")])) == ESTIMATED
    d.carry_out([c.OpenFrame("8/3"), c.Estimate(0, "pcs")])
    assert d.workspace.session.hypotheses.estimate == (("7/3", 1, "ppf"), ("8/3", 0, "pcs"))
    assert methods(d.carry_out([c.OpenFrame("7/3")])) == ESTIMATED


def test_the_run_before_stays_as_a_branch_and_the_page_says_so(session: Session) -> None:
    d = Debugger(session, None, Toolbox).carry_out([c.RunUntil("end")])
    before = d.workspace.run
    d.carry_out([ESTIMATE])
    label = d.view().scene.object(1).label
    assert d.message.startswith(f"{label} in frame 7/3 now has 2 initial poses by ppf")
    assert "Other objects and frames keep theirs." in d.message
    assert "“first run”" in d.message
    assert [b.name for b in d.workspace.work.branches] == ["first run", f"{label} from ppf"]
    assert d.workspace.run.length == 0
    d.carry_out([c.ShowBranch(0)])
    assert d.workspace.run is before
    assert methods(d) == FROM_SESSION
    assert d.workspace.session.hypotheses.estimate == ()
    assert methods(d.carry_out([c.Restart()])) == FROM_SESSION
    again = Debugger(session, None, Toolbox).carry_out(d.log)
    assert methods(again) == FROM_SESSION


def test_a_reopened_session_gives_an_object_its_own_initial_poses_back(session: Session, tmp_path: Path) -> None:
    d = Debugger(session, None, Toolbox).carry_out([ESTIMATE, c.OpenFrame("8/3"), c.Estimate(0, "pcs")])
    save_session(d.workspace.session, tmp_path / "s.toml")
    again = Debugger(load_session(tmp_path / "s.toml"), None, Toolbox).carry_out([c.OpenFrame("7/3")])
    assert methods(again) == ESTIMATED
    again.carry_out([c.Estimate(1, "session")])
    label = again.view().scene.object(1).label
    assert methods(again) == FROM_SESSION
    assert again.message.startswith(f"{label} in frame 7/3 now has 3 initial poses")
    assert again.workspace.session.hypotheses.estimate == (("8/3", 0, "pcs"),)
    with pytest.raises(InputError, match="already has the session's initial poses"):
        again.apply(c.Estimate(1, "session"))


@pytest.mark.usefixtures("processes")
def test_a_built_in_scene_opens_without_what_was_estimated_elsewhere(session: Session) -> None:
    d = Debugger(session, None, Toolbox, demos=("mug",)).carry_out([ESTIMATE, c.OpenDemo("mug")])
    assert d.workspace.session.scene.demo == "mug"
    assert methods(d) == [{"perturbed"}]


def test_an_object_that_is_not_there_is_refused_and_other_frames_that_begin_anew_are_reported(session: Session) -> None:
    d = Debugger(session, None, Toolbox)
    with pytest.raises(InputError, match="unknown instance 9"):
        d.apply(c.Estimate(9, "ppf"))
    assert len(d.workspace.work.branches) == 1
    d.carry_out([c.OpenFrame("8/3"), ESTIMATE])
    assert "their runs start again" in d.message


@pytest.mark.usefixtures("processes")
def test_the_button_asks_for_the_object_in_focus(session: Session, tmp_path: Path) -> None:
    app = App(session, port=0, make_tools=Toolbox, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        app.send(c.Focus(1))
        app.wait_until_idle()
        with client(app.url) as browser:
            browser.set(app.page.layout.settings.estimate, True)
            until(app, lambda: methods(app.debugger) == ESTIMATED)
            settings = app.page.layout.settings
            assert settings.estimate.label.startswith("Estimate ")
            browser.set(settings.estimator, "the session's")
            until(app, lambda: settings.estimate.label.startswith("Restore "))
            browser.set(settings.estimate, True)
            until(app, lambda: methods(app.debugger) == FROM_SESSION)
    finally:
        app.stop()


def test_notes_on_initial_poses_go_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "make_estimator", lambda name, session: Estimator())
    problem = box_problem(n_instances=2)
    posed, bare = (found(problem, box_mesh(tmp_path / "box.stl"), k) for k in range(2))
    far = np.array(problem.instances[0].hypotheses[0].T_cam_obj)
    far[2, 3] = 6.0
    kept(tmp_path / "kept", problem, [replace(posed, poses={"net": far}), replace(bare, poses={})])
    d = Debugger(load_session(tmp_path / "kept" / "session.toml"), None, Toolbox)
    notes = d.view().problem.notes
    of_far, of_none = ("its pose lies far from the depth", "box (#1) has no hypothesis")
    assert [sum(words in note for note in notes) for words in (of_far, of_none)] == [1, 1]
    of_second = d.carry_out([c.Estimate(1, "ppf")]).view().problem.notes
    assert "instead of" not in d.message, "there were none"
    assert [sum(words in note for note in of_second) for words in (of_far, of_none)] == [1, 0]
    of_both = d.carry_out([c.Estimate(0, "ppf")]).view().problem.notes
    assert [sum(words in note for note in of_both) for words in (of_far, of_none)] == [0, 0]
    again = d.carry_out([c.Estimate(1, "session")]).view().problem.notes
    assert [sum(words in note for note in again) for words in (of_far, of_none)] == [0, 1]
