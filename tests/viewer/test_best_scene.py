"""Where whole scenes are searched, the pose handed on is called the answer: alone another may score higher."""

from __future__ import annotations

from tests.viewer.test_answer import SearchTools
from tests.viewer.test_read_changes import Clustered
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.pose_tables import errors_table, score_table
from verefine_viz.viewer.panels.score_panel import maps_html
from verefine_viz.viewer.snapshot.snapshot import Snapshot


def after(*commands: c.Command, name: str) -> Snapshot:
    d = Debugger(Session(method=MethodSettings(name=name, iterations=2)), None, Clustered)
    return d.carry_out([c.OpenFrame("0/2"), *commands, c.Compare(a="initial", b="best")]).view()


def said(view: Snapshot) -> tuple[str, ...]:
    """Everything that names the poses of both sides."""
    a, b = (side.pose if side else None for side in (view.a, view.b))
    return maps_html(view), score_table(a, b), errors_table(view)


def test_the_answer_of_a_search_of_scenes_is_not_called_the_best() -> None:
    for words in said(after(c.RunUntil("end"), name="vf_depth")):
        assert "answer" in words
        assert "best<" not in words
        assert "best pose" not in words


def test_nor_is_that_of_a_tree_search_on_its_way() -> None:
    d = Debugger(Session(method=MethodSettings(name="physim_mcts")), None, SearchTools)
    for commands in ([c.OpenFrame("0/2"), c.Compare(a="initial", b="best")], [c.RunTo(3)], [c.RunUntil("end")]):
        pose = d.carry_out(commands).view().poses["best"]
        assert pose.label == "answer"


def test_it_has_one_name_on_the_way_and_at_the_end() -> None:
    for view in (after(c.RunTo(3), name="vf_depth"), after(c.RunUntil("end"), name="rir")):
        for words in said(view):
            assert "answer" in words
            assert "best<" not in words
