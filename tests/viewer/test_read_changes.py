"""A session whose settings change on the way is shown as the branch that it was saved of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.viewer.tools import FakeTools
from verefine_viz.core.dependency import DependencyGraph
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.session.files import load_session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.keeping import Keeping, stem_of
from verefine_viz.viewer.panels.objects import objects_table


class Clustered(FakeTools):
    """All objects have to do with each other."""

    def problem(self, frame: str) -> Problem:
        clusters = (tuple(range(int(frame[-1]))),)
        return replace(super().problem(frame), dependencies=DependencyGraph((), clusters, (), "given"))


FORK = c.Fork((("method.name", "vf_depth"),), 2, run=True)


def test_it_is_shown_as_it_was_saved(tmp_path: Path) -> None:
    server: Any = None  # Sessions are saved without a page.
    session = Session(title="two", method=MethodSettings(name="rir", iterations=2))
    saved = Debugger(session, None, Clustered, keep=Keeping(server, tmp_path))
    saved.carry_out([c.OpenFrame("0/2"), c.RunTo(2), FORK, c.SaveSession("forked")])
    read = Debugger(load_session(tmp_path / "forked.toml"), None, Clustered)
    read.carry_out([c.OpenFrame("0/2"), c.RunUntil("end")])
    shown, expected = read.view(), saved.view()
    assert shown.scene.n_clusters == expected.scene.n_clusters == 1
    assert objects_table(shown) == objects_table(expected)
    assert shown.session.method.name == "vf_depth"
    assert stem_of(read) == stem_of(saved) == "two_0_2_vf_depth"
    assert read.workspace.session == load_session(tmp_path / "forked.toml")
