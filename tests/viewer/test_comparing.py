"""Two runs side by side: which is B, how it is computed beside the page, and what is refused."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.viewer.client import client, until
from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, SIR, TWO, debugger, same, sides
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.palette import SIDE_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.command_json import from_json, to_json
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.compare_panel import computing
from verefine_viz.viewer.panels.score_panel import maps_html, score_html
from verefine_viz.viewer.text.pose_words import compared


def test_b_is_computed_beside_the_open_run() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.Seek(3)])
    d.apply(c.CompareRun(SIR))
    d.tick()
    assert sides(d).running
    assert sides(d).effort_b.iterations == 1
    assert d.workspace.run.cursor == 3, "A is left alone"
    d.apply(c.Step())
    d.apply(c.ColorCloud())
    d.apply(c.ArrangeGallery())
    assert d.comparison.is_running, "looking around does not disturb it"
    d.apply(c.PauseB())
    assert not d.comparison.is_running
    assert sides(d).effort_b.iterations == 1
    d.carry_out([c.RunB()])
    assert sides(d).effort_b.iterations == sides(d).effort_b.planned == 4
    assert not sides(d).running


def test_b_waits_for_a_run_that_is_on() -> None:
    d = debugger()
    d.apply(TWO)
    d.apply(c.RunUntil("end"))
    d.tick()
    d.apply(c.CompareRun(SIR))
    assert "when A is through" in computing(sides(d), a_is_running=True)
    d.tick()
    assert (d.workspace.run.length, sides(d).effort_b.iterations) == (2, 0), "A goes on first"
    while d.is_busy:
        d.tick()
    assert d.workspace.run.is_done
    assert sides(d).effort_b.iterations == sides(d).effort_b.planned
    assert sides(d).place == len(sides(d).pairs)
    assert computing(sides(d), a_is_running=False) == ""
    same(debugger().carry_out(d.log), d)


def test_a_branch_can_be_b_and_is_refused_when_there_is_none() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Fork((("method.exploration", 5.0),), 2, run=True)])
    d.carry_out([c.CompareBranch(0)])
    v = sides(d)
    assert v.departures.deed.place > 2
    with pytest.raises(InputError, match="there is no branch 7 to compare with; this frame has 2"):
        d.carry_out([c.CompareBranch(7)])
    d.carry_out([c.Restart()])
    assert d.view().comparison is None, "a restart takes the branches away, and with them the comparison"
    with pytest.raises(InputError, match="there is no branch 1 to compare with; this frame has 1"):
        d.carry_out([c.CompareBranch(1)])


class FewerStarts(FakeTools):
    """As many initial poses as the session says, in the order of the session."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        most = self.session.hypotheses.max_per_object or 3
        instances = tuple(replace(i, hypotheses=i.hypotheses[:most]) for i in problem.instances)
        return self.ordered(replace(problem, instances=instances))


def test_b_with_other_initial_poses_and_another_order_is_shown_as_it_is() -> None:
    d = Debugger(SESSION, None, FewerStarts).carry_out([TWO])
    changes = (("hypotheses.max_per_object", 1), ("dependency.order", (("#1", "#0"),)), ("method.name", "vf_breadth"))
    view = d.carry_out([c.CompareRun(changes), c.SwapSides(), c.ShowScene()]).view()
    problem = d.workspace.run.problem
    assert view.problem is problem
    assert [o.instance_id for o in view.scene.objects] == [1, 0]
    assert all(o.target.instance is problem.target(o.instance_id).instance for o in view.scene.objects)


def test_b_that_became_the_open_run_is_restarted_and_kept_with_its_own_settings() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR), c.SwapSides()])
    assert d.workspace.session.method.name == "sir"
    assert d.carry_out([c.SwapSides()]).workspace.session.method.name == "rir"
    d.carry_out([c.SwapSides(), c.Restart((("method.iterations", 3),)), c.RunUntil("end")])
    assert d.view().session.method.name == "sir"
    assert d.workspace.run.length == 6
    assert d.carry_out([c.OpenFrame("0/1")]).view().session.method.name == "sir", "as all frames of the session"


def test_without_b_the_page_says_what_to_do() -> None:
    d = debugger()
    for command in (
        c.RunB(), c.SwapSides(), c.SeekMoment(1), c.StepMoment(1), c.SeekDifference(), c.ShowSide("A"),
        c.StopComparing(),
    ):  # fmt: skip
        with pytest.raises(InputError, match="nothing is compared yet; choose what B is"):
            d.carry_out([command])


def test_nonsense_is_refused_in_one_line_and_changes_nothing() -> None:
    d = debugger().carry_out([c.Step(), c.CompareRun(SIR)])
    before = debugger().carry_out(d.log)
    nonsense: tuple[tuple[tuple[str, object], str], ...] = (
        (("method.name", "nope"), "unknown method 'nope'; available: "),
        (("physics.steps", 0), r"physics\.steps = 0"),
        (("preset", "nice"), "unknown preset 'nice'; available: recommended, published"),
        (("scene.demo", "x"), "unknown section to compare 'scene'"),
    )
    for change, words in nonsense:
        with pytest.raises(SettingsError, match=words) as caught:
            d.carry_out([c.CompareRun((change,))])
        assert "\n" not in str(caught.value), change
    same(d, before)


ANY_MOVE = st.sampled_from(
    [
        c.Step(), c.Back(), c.Seek(3), c.SeekEnd(), c.RunUntil("end"), c.RunTo(4), c.Restart(), c.OpenFrame("0/1"),
        c.OpenFrame("0/2"), c.Focus(0), c.Fork((("method.exploration", 0.3),), 0, run=True), c.ShowBranch(0),
        c.ShowBranch(1), c.ShowLayer("hypotheses"), c.ShowLayer("accepted", False), c.TogglePause(), c.ColorCloud(),
        c.CompareRun(SIR), c.CompareRun(SIR, run=False), c.CompareRun((("preset", "published"),)), c.CompareBranch(0),
        c.CompareBranch(1), c.RunB(), c.RunB(2), c.PauseB(), c.StopComparing(), c.SwapSides(), c.SeekMoment(2),
        c.SeekMoment(9), c.StepMoment(-1), c.SeekDifference(), c.ShowSide("B"), c.ShowSidePoses("kept"),
    ]
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(ANY_MOVE, st.integers(0, 3)), max_size=12))
def test_the_log_repeats_the_comparison_bit_for_bit(moves: list[tuple[c.Command, int]]) -> None:
    first = debugger()
    for command, ticks in moves:  # As on the page: the next command comes while B, or A, is still being computed.
        with suppress(VerefineError):
            first.apply(command)
        for _ in range(ticks):
            first.tick()
        first.view(deep=False)
    first.apply(c.Pause())
    second = debugger().carry_out(from_json(to_json(x)) for x in first.log)
    same(first, second)
    first.view()


def test_b_is_computed_while_the_page_lives_and_every_browser_can_drive_it(app: App) -> None:
    app.send(c.RunUntil("end"))
    app.wait_until_idle()
    panel = app.page.layout.compare
    with client(app.url) as browser, client(app.url) as another:
        browser.set(panel.choice.fields["method.name"], "sir")
        browser.set(panel.choice.run, True)
        until(app, lambda: app.debugger.view().comparison is not None)
        app.wait_until_idle()
        assert sides(app.debugger).effort_b.iterations == 2
        another.set(panel.slider, 2)
        until(app, lambda: app.debugger.workspace.run.cursor == 2)
        another.set(panel.moves, "First difference")
        until(app, lambda: sides(app.debugger).which == "kept")
        browser.set(panel.choice.more, "score.tau_m")
        browser.set(panel.choice.run, True)
        until(app, lambda: "is no setting; expected a name and a value" in app.debugger.message)


# One meaning of A and B on a page: while two runs are compared it is theirs.


def test_maps_and_scores_are_of_the_two_runs() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR), c.Focus(1)])
    for commands in ([], [c.SeekMoment(0)], [c.SeekMoment(2)]):
        view = d.carry_out(commands).view()
        assert view.b is not None
        for side, T_cam_obj, name in zip((view.a, view.b), view.comparison.poses[1], ("rir", "sir"), strict=True):
            assert T_cam_obj is not None
            np.testing.assert_array_equal(side.pose.T_cam_obj, T_cam_obj)
            assert side.pose.label == name, commands
            assert side.maps is not None
        assert [side.pose.color for side in (view.a, view.b)] == [SIDE_COLORS["A"], SIDE_COLORS["B"]]
        assert compared(view) == "", commands
        assert "rir" in maps_html(view)
        assert f"{view.a.pose.score.score:.3f}"[:4] in score_html(view), commands


def test_of_a_whole_scene_as_well() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR), c.ShowScene()])
    view = d.view()
    np.testing.assert_array_equal(view.b.pose.T_cam_obj, [view.comparison.poses[k][1] for k in (0, 1)])
    assert view.b.pose.label == "sir"


def test_an_edited_pose_is_compared_with_the_accepted_one_meanwhile() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Seek(2), c.CompareRun(SIR), c.EditPose()])
    view = d.view()
    assert (view.a.pose.name, view.b.pose.name) == ("accepted", "edited")
