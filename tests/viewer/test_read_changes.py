"""A session whose settings change on the way is shown as the branch that it was saved of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.run.session_file import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.export import Exporter, stem_of
from verefine_viz.viewer.panels.objects_panel import objects_table


class Clustered(FakeTools):
    """All objects have to do with each other."""

    def problem(self, frame: str) -> Problem:
        clusters = (tuple(range(int(frame[-1]))),)
        return replace(super().problem(frame), dependencies=DependencyGraph((), clusters, (), "given"))


FORK = c.Fork((("method.name", "vf_depth"),), 2, run=True)


def test_it_is_shown_as_it_was_saved(tmp_path: Path) -> None:
    server: Any = None  # Sessions are saved without a page.
    session = Session(title="two", method=MethodSettings(name="rir", iterations=2))
    saved = Debugger(session, None, Clustered, write=Exporter(server, tmp_path))
    saved.carry_out([c.OpenFrame("0/2"), c.RunTo(2), FORK, c.SaveSession("forked")])
    read = Debugger(load_session(tmp_path / "forked.toml"), None, Clustered)
    read.carry_out([c.OpenFrame("0/2"), c.RunUntil("end")])
    shown, expected = read.view(), saved.view()
    assert shown.scene.n_clusters == expected.scene.n_clusters == 1
    assert objects_table(shown) == objects_table(expected)
    assert shown.session.method.name == "vf_depth"
    assert stem_of(read) == stem_of(saved) == "two_0_2_vf_depth"
    assert read.workspace.session == load_session(tmp_path / "forked.toml")


def read(tmp_path: Path) -> Debugger:
    """A session that was saved with a pose moved before iteration 2 and another weight after it."""
    server: Any = None
    debugger = Debugger(
        Session(method=MethodSettings(exploration=0.1)), None, FakeTools, write=Exporter(server, tmp_path)
    )
    T_cam_obj = tuple(transform(np.eye(3), [0.01, 0.08, 0.6]).ravel())
    debugger.carry_out([c.Step(), c.EditPose(), c.DragPose(T_cam_obj), c.ForkFromPose(), c.Step()])
    debugger.carry_out([c.Fork((("method.exploration", 0.4),)), c.SaveSession("changed")])
    saved = load_session(tmp_path / "changed.toml")
    assert (len(saved.edits), len(saved.changes), saved.method.exploration) == (1, 1, 0.1)
    return Debugger(saved, tmp_path / "changed.toml", FakeTools)


def test_a_restart_begins_with_the_settings_that_are_shown_and_keeps_to_them(tmp_path: Path) -> None:
    debugger = read(tmp_path)
    assert debugger.view().session.method.exploration == 0.4
    for changes, expected in (
        ((), 0.4),
        ((("hypotheses.max_per_object", 3),), 0.4),
        ((("method.exploration", 5.0),), 5.0),
    ):
        debugger.carry_out([c.Restart(changes)])
        session = debugger.workspace.session
        assert (session.edits, session.changes, session.method.exploration) == ((), (), expected), changes
        assert debugger.view().session.method.exploration == expected
        plain = Debugger(Session(method=MethodSettings(exploration=expected)), None, FakeTools)
        for one in (debugger, plain):
            one.carry_out([c.RunUntil("end")])
        made, other = ([i.arm for i in d.workspace.run.iterations] for d in (debugger, plain))
        assert made == other, changes
        debugger.carry_out([c.OpenSession(str(tmp_path / "changed.toml"))])
        assert debugger.workspace.session == load_session(tmp_path / "changed.toml"), "it repeats what changed"


def test_a_fork_of_it_is_restarted_without_what_changed_on_the_way(tmp_path: Path) -> None:
    debugger = read(tmp_path).carry_out([c.RunTo(1), c.Fork((("method.exploration", 5.0),), 0), c.Restart()])
    session = debugger.workspace.session
    assert (session.edits, session.changes, session.method.exploration) == ((), (), 5.0)


def test_the_page_says_what_a_restart_does_not_repeat(tmp_path: Path) -> None:
    debugger = read(tmp_path).carry_out([c.RunUntil("end"), c.Restart()])
    assert "1 edited pose is not moved again" in debugger.message
    assert str(tmp_path / "changed.toml") in debugger.message
    assert debugger.carry_out([c.Step(), c.Restart()]).message == ""
