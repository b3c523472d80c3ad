"""Two runs side by side: commands, one timeline, B computed beside the page, and what is refused."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.viewer.client import client
from tests.viewer.test_app import until
from tests.viewer.tools import FakeTools
from verefine_viz.core.compare import first_difference
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import MethodSettings, SceneSettings, Session
from verefine_viz.recording.recorder import Recorder
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import side_commands as s
from verefine_viz.viewer.app import App
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.markup import sentence
from verefine_viz.viewer.panels.compare import computing
from verefine_viz.viewer.side_view import SidesView
from verefine_viz.viewer.side_words import legend, now_table, outcome_table, settings_list, summary

SESSION = Session(method=MethodSettings(iterations=2))
SIR = (("method.name", "sir"),)
TWO = c.OpenFrame("0/2")


def debugger(session: Session = SESSION) -> Debugger:
    return Debugger(session, None, FakeTools)


def sides(d: Debugger) -> SidesView:
    found = d.view().sides
    assert found is not None
    return found


def same(a: Debugger, b: Debugger) -> None:
    assert a.look == b.look
    for one, other in zip(a.workspace.work.branches, b.workspace.work.branches, strict=True):
        assert (one.name, one.run.cursor) == (other.name, other.run.cursor)
        assert first_difference(one.run.iterations, other.run.iterations) is None
    assert (a.workspace.work.index, a.workspace.work.sides) == (b.workspace.work.index, b.workspace.work.sides)


def test_b_is_computed_beside_the_open_run() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.Seek(3)])
    d.apply(s.CompareRun(SIR))
    d.tick()
    assert sides(d).running
    assert sides(d).effort_b.iterations == 1
    assert d.workspace.run.cursor == 3, "A is left alone"
    d.apply(c.Step())
    d.apply(c.ColorCloud())
    assert d.comparing.is_running, "looking around does not disturb it"
    d.apply(s.PauseB())
    assert not d.comparing.is_running
    assert sides(d).effort_b.iterations == 1
    d.carry_out([s.RunB()])
    assert sides(d).effort_b.iterations == sides(d).effort_b.planned == 4
    assert not sides(d).running


def test_b_waits_for_a_run_that_is_on() -> None:
    d = debugger()
    d.apply(TWO)
    d.apply(c.RunUntil("end"))
    d.tick()
    d.apply(s.CompareRun(SIR))
    assert "when A is through" in computing(sides(d), a_is_running=True)
    d.tick()
    assert (d.workspace.run.length, sides(d).effort_b.iterations) == (2, 0), "A goes on first"
    while d.is_busy:
        d.tick()
    assert d.workspace.run.is_done
    assert sides(d).effort_b.iterations == sides(d).effort_b.planned
    assert sides(d).place == len(sides(d).timeline)
    assert computing(sides(d), a_is_running=False) == ""
    same(debugger().carry_out(d.log), d)


def test_both_move_along_one_timeline() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), s.CompareRun(SIR)])
    v = sides(d)
    # Three hypotheses and K = 2: A takes six refiner calls an object, B two.
    assert len(v.timeline) == 12
    assert v.place == 12
    d.carry_out([s.SeekMoment(2)])
    v = sides(d)
    assert (v.place, d.workspace.run.cursor) == (2, 2)
    assert v.moment is not None
    assert (v.moment.a, v.moment.b) == (2, 2)
    d.carry_out([s.StepMoment(1)])
    v = sides(d)
    assert v.moment is not None
    assert (v.place, v.moment.b) == (3, None)
    assert v.now_b is not None
    assert v.now_b.iteration is not None
    assert v.now_b.iteration.index == 2, "B stays where it was when A goes on alone"
    d.carry_out([c.Seek(8)])
    v = sides(d)
    assert v.moment is not None
    assert (v.moment.a, v.moment.b) == (8, 4), "A's own slider moves both"
    d.carry_out([s.SeekMoment(0)])
    assert sides(d).place == 0
    assert d.workspace.run.cursor == 0
    assert sides(d.carry_out([s.SeekMoment(99)])).place == 12


def test_moments_that_only_b_has_can_be_reached() -> None:
    d = debugger(Session(method=MethodSettings(name="sir", iterations=1)))
    d.carry_out([TWO, c.RunUntil("end"), s.CompareRun((("method.iterations", 3),))])
    assert len(sides(d).timeline) == 6
    d.carry_out([s.SeekMoment(3)])
    v = sides(d)
    assert v.moment is not None
    assert (v.place, v.moment.a, v.moment.b, d.workspace.run.cursor) == (3, None, 3, 1)
    assert d.view().target.instance.instance_id == 0
    d.carry_out([s.SeekMoment(6)])
    assert (sides(d).place, d.workspace.run.cursor) == (6, 2)


def test_the_first_difference_is_reached_and_said() -> None:
    d = debugger().carry_out([c.RunUntil("end"), s.CompareRun((("method.exploration", 5.0),))])
    v = sides(d)
    assert v.differences.deed is not None
    assert v.differences.deed.kind == "hypothesis"
    d.carry_out([s.SeekDifference()])
    v = sides(d)
    assert v.place == v.differences.deed.place  # type: ignore[union-attr]
    assert v.which == "kept"
    said = summary(v)
    assert said.startswith("B (exploration = 5) leaves A (exploration = 0.7) at iteration")
    assert "it works on hypothesis" in said
    assert "At the end A 0." in said


def test_a_run_beside_itself_has_no_difference_to_jump_to() -> None:
    d = debugger().carry_out([c.RunUntil("end"), s.CompareRun(), s.SeekDifference()])
    assert d.message == "No difference in the 6 iterations that both have made."
    assert "did the same in all 6 iterations that both have made, bit for bit" in summary(sides(d))
    assert {o.winner for o in sides(d).outcomes} == {"even"}


def test_scores_by_another_rule_are_told_and_judged_by_one() -> None:
    d = debugger().carry_out([c.RunUntil("end"), s.CompareRun((("score.tau_m", 0.01),))])
    v = sides(d)
    assert not v.scores_alike
    assert v.settings == (("score.tau_m", 0.02, 0.01),)


def test_swapping_makes_b_the_open_run_at_the_same_moment() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), s.CompareRun(SIR), s.SeekMoment(2)])
    before = sides(d)
    d.carry_out([s.SwapSides()])
    after = sides(d)
    assert (after.name_a, after.name_b) == (before.name_b, before.name_a) == ("sir", "rir")
    assert after.moment is not None
    assert before.moment is not None
    assert after.moment.key == before.moment.key
    assert d.workspace.run.method.n_iterations(d.workspace.run.state) == 4
    swapped = {"A": "B", "B": "A", "even": "even", None: None}
    assert [o.winner for o in after.outcomes] == [swapped[o.winner] for o in before.outcomes]
    for k, (T_a, T_b) in before.poses.items():
        np.testing.assert_array_equal(after.poses[k][0], T_b)
        np.testing.assert_array_equal(after.poses[k][1], T_a)
    d.carry_out([s.SwapSides()])
    assert sides(d).place == before.place


def test_a_branch_can_be_b_and_is_refused_when_there_is_none() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Fork((("method.exploration", 5.0),), 2, run=True)])
    d.carry_out([s.CompareBranch(0)])
    v = sides(d)
    assert v.differences.deed is not None
    assert v.differences.deed.place > 2
    with pytest.raises(InputError, match="there is no branch 7 to compare with; this frame has 2"):
        d.carry_out([s.CompareBranch(7)])
    d.carry_out([c.Restart()])
    assert d.view().sides is None, "a restart takes the branches away, and with them the comparison"
    with pytest.raises(InputError, match="there is no branch 1 to compare with; this frame has 1"):
        d.carry_out([s.CompareBranch(1)])


@pytest.mark.parametrize(
    "command",
    [s.RunB(), s.SwapSides(), s.SeekMoment(1), s.StepMoment(1), s.SeekDifference(), s.ShowSide("A"), s.StopComparing()],
)
def test_without_b_the_page_says_what_to_do(command: c.Command) -> None:
    with pytest.raises(InputError, match="nothing is compared yet; choose what B is in the A/B panel first"):
        debugger().carry_out([command])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ((("method.name", "nope"),), "unknown method 'nope'; available: "),
        ((("physics.steps", 0),), r"physics\.steps = 0"),
        ((("preset", "nice"),), "unknown preset 'nice'; available: recommended, published"),
        ((("scene.demo", "x"),), "unknown section to compare 'scene'"),
    ],
)
def test_nonsense_is_refused_in_one_line_and_changes_nothing(changes: Any, words: str) -> None:
    d = debugger().carry_out([c.Step(), s.CompareRun(SIR)])
    before = debugger().carry_out(d.log)
    with pytest.raises(SettingsError, match=words) as caught:
        d.carry_out([s.CompareRun(changes)])
    assert "\n" not in str(caught.value)
    same(d, before)


def test_stage_layers_are_put_away_and_come_back() -> None:
    d = debugger().carry_out([c.Step()])
    before = d.view().look.layers
    d.carry_out([s.CompareRun(SIR)])
    assert not d.view().look.layers & {"simulated", "refined", "accepted", "hypotheses"}
    assert {"cloud", "ground truth"} <= d.view().look.layers
    d.carry_out([c.ShowLayer("hypotheses")])
    assert "hypotheses" in d.view().look.layers
    d.carry_out([s.StopComparing()])
    assert d.view().look.layers == before
    assert d.view().sides is None


def test_sides_can_be_hidden_and_show_best_or_kept() -> None:
    d = debugger().carry_out([c.RunUntil("end"), s.CompareRun((("method.exploration", 5.0),)), s.ShowSide("B")])
    assert sides(d).shown == {"A"}
    assert sides(d.carry_out([s.ShowSide("B")])).shown == {"A", "B"}
    d.carry_out([s.SeekMoment(3), s.ShowSidePoses("kept")])
    v = sides(d)
    T_a, T_b = v.poses[0]
    runs = [b.run for b in d.workspace.work.branches]
    np.testing.assert_array_equal(T_a, runs[0].iterations[2].accepted_stage.T_cam_obj)
    np.testing.assert_array_equal(T_b, runs[1].iterations[2].accepted_stage.T_cam_obj)
    T_a, T_b = sides(d.carry_out([s.ShowSidePoses("best")])).poses[0]
    np.testing.assert_array_equal(T_a, runs[0].iterations[2].best.T_cam_obj)
    np.testing.assert_array_equal(T_b, runs[1].iterations[2].best.T_cam_obj)


def test_curves_run_over_the_calls_of_the_object_in_focus() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), s.CompareRun(SIR), c.Focus(0)])
    curves = sides(d).curves
    assert curves.calls == (0, 1, 2, 3, 4, 5, 6)
    assert len(curves.score_a) == len(curves.score_b) == 7
    assert curves.score_b[2:] == (curves.score_b[2],) * 5, "a run that has ended stays where it was"
    assert curves.error_a is not None
    assert list(curves.score_a) == sorted(curves.score_a)


ANY_MOVE = st.sampled_from(
    [
        c.Step(), c.Back(), c.Seek(3), c.SeekEnd(), c.RunUntil("end"), c.RunTo(4), c.Restart(), c.OpenFrame("0/1"),
        c.OpenFrame("0/2"), c.Focus(0), c.Fork((("method.exploration", 0.3),), 0, run=True), c.ShowBranch(0),
        c.ShowBranch(1), c.ShowLayer("hypotheses"), c.ShowLayer("accepted", False), c.TogglePause(), c.ColorCloud(),
        s.CompareRun(SIR), s.CompareRun(SIR, run=False), s.CompareRun((("preset", "published"),)), s.CompareBranch(0),
        s.CompareBranch(1), s.RunB(), s.RunB(2), s.PauseB(), s.StopComparing(), s.SwapSides(), s.SeekMoment(2),
        s.SeekMoment(9), s.StepMoment(-1), s.SeekDifference(), s.ShowSide("B"), s.ShowSidePoses("kept"),
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
    second = debugger().carry_out(c.from_json(c.to_json(x)) for x in first.log)
    same(first, second)
    first.view()


# Recordings


class Numbered(FakeTools):
    """Frames whose number is in the problem as well, as in real data."""

    def problem(self, frame: str) -> Problem:
        return replace(super().problem(frame), im_id=int(frame[-1]))


def record(path: Path, session: Session, frame: str = "0/2") -> Path:
    tools = Numbered(session)
    problem = tools.problem(frame)
    tools.run(problem, (Recorder(path, session, problem, None),)).finish()
    return path


def page(session: Session = SESSION) -> Debugger:
    return Debugger(session, None, Numbered)


def test_a_recording_beside_the_run_it_was_made_of(tmp_path: Path) -> None:
    path = record(tmp_path / "rir.rrd", SESSION)
    d = page().carry_out([TWO, c.RunUntil("end"), s.CompareRecording(str(path))])
    v = sides(d)
    assert "did the same in all 12 iterations that both have made, bit for bit" in summary(v)
    assert {o.winner for o in v.outcomes} == {"even"}
    again = page().carry_out(d.log)
    same(d, again)


def test_two_recordings_from_disk(tmp_path: Path) -> None:
    one = record(tmp_path / "rir.rrd", SESSION)
    other = record(tmp_path / "sir.rrd", Session(method=MethodSettings(name="sir", iterations=2)))
    d = page().carry_out([s.OpenRecording(str(one)), s.CompareRecording(str(other))])
    assert d.workspace.frame == "0/2"
    v = sides(d)
    assert (v.name_a, v.name_b) == ("rir, rir.rrd", "sir, sir.rrd")
    assert (v.effort_a.iterations, v.effort_b.iterations) == (12, 4)
    assert d.workspace.run.cursor == 0
    for command in (c.Step(), s.SeekDifference(), s.SwapSides(), c.SelectArm(0), s.SeekMoment(99), c.Focus(1)):
        d.carry_out([command])
        d.view()
    live = page().carry_out([TWO, c.RunUntil("end"), s.CompareRun(SIR)])
    ours, theirs = sides(d.carry_out([s.SwapSides(), s.SeekMoment(99)])), sides(live)
    assert [m.key for m in ours.timeline.moments] == [m.key for m in theirs.timeline.moments]
    assert ours.differences.deed == theirs.differences.deed
    assert [o.winner for o in ours.outcomes] == [o.winner for o in theirs.outcomes]


def test_a_recording_is_not_continued_but_can_be_run_again(tmp_path: Path) -> None:
    path = record(tmp_path / "rir.rrd", SESSION)
    d = page().carry_out([s.OpenRecording(str(path)), c.Seek(3)])
    with pytest.raises(InputError, match=r"rir\.rrd was read from a file and cannot be continued"):
        d.carry_out([c.Fork((("method.exploration", 5.0),))])
    d.carry_out([s.CompareRun((("method.exploration", 5.0),))])
    assert sides(d).effort_b.iterations == 12
    d.carry_out([c.Restart()])
    assert d.workspace.run.length == 0
    d.carry_out([c.RunUntil("end"), s.CompareRecording(str(path))])
    assert sides(d).differences.first is None


def test_recordings_that_do_not_fit_are_refused_in_one_line(tmp_path: Path) -> None:
    one = record(tmp_path / "one.rrd", SESSION)
    elsewhere = record(tmp_path / "elsewhere.rrd", SESSION, frame="0/1")
    tower = SESSION.model_copy(update={"scene": SceneSettings(demo="tower")})
    other_scene = record(tmp_path / "tower.rrd", tower)
    damaged = tmp_path / "damaged.rrd"
    damaged.write_bytes(one.read_bytes()[:200])
    no_rrd = tmp_path / "no.rrd"
    no_rrd.write_text("hello")
    d = page().carry_out([s.OpenRecording(str(one))])
    before = page().carry_out(d.log)
    for path, words in (
        (elsewhere, "elsewhere.rrd shows frame 0/1 of mug, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (other_scene, "tower.rrd shows frame 0/2 of tower, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (damaged, "damaged.rrd"),
        (no_rrd, "no.rrd is not a rerun recording"),
        (tmp_path / "gone.rrd", "gone.rrd does not exist"),
    ):
        for command in (s.CompareRecording(str(path)), s.OpenRecording(str(path))):
            if isinstance(command, s.OpenRecording) and path in (elsewhere, other_scene):
                continue
            with pytest.raises(VerefineError) as caught:
                d.carry_out([command])
            assert words in str(caught.value)
            assert "\n" not in str(caught.value)
    same(d, before)


def test_a_page_opens_with_two_recordings_or_says_why_not(tmp_path: Path) -> None:
    one = record(tmp_path / "rir.rrd", SESSION)
    other = record(tmp_path / "sir.rrd", Session(method=MethodSettings(name="sir", iterations=2)))
    elsewhere = record(tmp_path / "elsewhere.rrd", SESSION, frame="0/1")
    app = App(SESSION, None, port=0, make_tools=Numbered, first=(s.OpenRecording(str(one)),)).start()
    try:
        app.wait_until_idle()
        app.send(s.CompareRecording(str(other)))
        app.wait_until_idle()
        assert "leaves A (rir, rir.rrd)" in app.layout.compare._words._handle.content
        app.send(s.CompareRecording(str(elsewhere)))
        app.wait_until_idle()
        assert "two runs are compared on the same frame" in app.debugger.message
    finally:
        app.stop()
    bad = (s.OpenRecording(str(one)), s.CompareRecording(str(elsewhere)))
    app = App(SESSION, None, port=0, make_tools=Numbered, first=bad).start()
    try:
        with pytest.raises(VerefineError, match="two runs are compared on the same frame"):
            app.wait_until_ready(30)
    finally:
        app.stop()


def test_b_is_computed_while_the_page_lives_and_every_browser_can_drive_it(tmp_path: Path) -> None:
    app = App(SESSION, None, port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        app.send(c.RunUntil("end"))
        app.wait_until_idle()
        with client(app.url) as browser, client(app.url) as another:
            browser.set(app.layout.compare.choice.fields["method.name"], "sir")
            browser.set(app.layout.compare.choice.run, True)
            until(app, lambda: app.debugger.view().sides is not None)
            app.wait_until_idle()
            assert sides(app.debugger).effort_b.iterations == 2
            another.set(app.layout.compare.slider, 2)
            until(app, lambda: app.debugger.workspace.run.cursor == 2)
            another.set(app.layout.compare.moves, "First difference")
            until(app, lambda: sides(app.debugger).which == "kept")
            browser.set(app.layout.compare.choice.more, "score.tau_m")
            browser.set(app.layout.compare.choice.run, True)
            until(app, lambda: "is no setting; expected a name and a value" in app.debugger.message)
    finally:
        app.stop()


def test_without_ground_truth_nobody_is_called_nearer() -> None:
    v = sides(debugger().carry_out([TWO, c.RunUntil("end"), s.CompareRun(SIR)]))
    assert "of 2 objects nearer" in summary(v)
    blind = tuple(
        replace(o, a=o.a and replace(o.a, errors=None), b=o.b and replace(o.b, errors=None)) for o in v.outcomes
    )
    assert "of 2 objects scoring higher" in summary(replace(v, outcomes=blind))
    assert "nearer" not in summary(replace(v, outcomes=blind))


def test_names_from_data_are_text() -> None:
    evil = "<img src=x onerror=alert(1)>"

    class Evil(FakeTools):
        def problem(self, frame: str) -> Problem:
            problem = super().problem(frame)
            return replace(problem, models={k: replace(m, name=evil) for k, m in problem.models.items()})

    d = Debugger(SESSION, None, Evil).carry_out([TWO, c.RunUntil("end"), s.CompareRun()])
    v = replace(sides(d), name_a=evil, name_b=evil, settings=(("method.name", evil, evil),))
    shown = "".join([sentence(summary(v)), legend(v), now_table(v), outcome_table(v), settings_list(v)])
    assert "<img src=x" not in shown
    assert "&lt;img src=x" in shown
