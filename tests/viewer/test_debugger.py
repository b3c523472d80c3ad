"""The debugger without a page: what each command does, and that a list of them always does the same."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.protocols import Watcher
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import from_json, to_json
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.session_panel import opened


def debugger(session: Session | None = None) -> Debugger:
    return Debugger(session or Session(method=MethodSettings(iterations=2)), None, FakeTools)


def same(a: Debugger, b: Debugger) -> None:
    """Both are at the same place, in the same runs, looking at the same things."""
    assert a.options == b.options
    assert a.workspace.frame == b.workspace.frame
    assert a.workspace.work.index == b.workspace.work.index
    for one, other in zip(a.workspace.work.branches, b.workspace.work.branches, strict=True):
        assert one.name == other.name
        assert one.run.cursor == other.run.cursor
        assert first_difference(one.run.iterations, other.run.iterations) is None


ANY_MOVE = st.sampled_from(
    [
        c.Step(), c.StepStage(), c.Back(), c.Seek(3), c.Seek(99), c.SeekEnd(), c.SeekEvent(1), c.SeekEvent(-1),
        c.RunUntil("end"), c.RunUntil("event"), c.RunTo(4), c.Pause(), c.TogglePause(), c.Restart(),
        c.Restart((("method.exploration", 0.5),)), c.OpenFrame("0/1"), c.OpenFrame("0/2"), c.Focus(0), c.SelectArm(1),
        c.Fork(),
        c.Fork((("method.exploration", 0.3),), 0, run=True), c.EditPose(), c.ForkFromPose(),
        c.EditPose(False),
        c.DragPose(tuple(transform(np.eye(3), [0.01, 0.08, 0.6]).ravel())), c.ShowBranch(0), c.Compare(a="best"),
        c.ColorCloud(), c.ShowLayer("cloud"), c.ProbePixel(40, 30), c.ScrubPath(1), c.PlayPath(), c.ScoreGroundTruth(),
        c.PlaceRuler(), c.CutView(30), c.SetBreakpoints((("arm_switched", True),)),
    ]
)  # fmt: skip


def drive(target: Debugger, commands: list[c.Command]) -> None:
    for command in commands:
        with suppress(VerefineError):
            target.carry_out([command])


@settings(max_examples=40, deadline=None)
@given(st.lists(ANY_MOVE, max_size=12))
def test_the_log_repeats_the_session_bit_for_bit(commands: list[c.Command]) -> None:
    first = debugger()
    drive(first, commands)
    lines = [to_json(x) for x in first.log]
    second = debugger().carry_out(from_json(line) for line in lines)
    same(first, second)
    first.view()


@settings(max_examples=15, deadline=None)
@given(st.lists(ANY_MOVE, max_size=8))
def test_a_refused_command_leaves_everything_as_it_was(commands: list[c.Command]) -> None:
    target = debugger()
    drive(target, commands)
    before = debugger().carry_out(target.log)
    for bad in (c.OpenFrame("9/9"), c.Fork((("method.name", "nope"),)), c.ShowBranch(9), c.ShowLayer("x"), c.Focus(77),
                c.ProbePixel(-1, 0), c.OpenDemo("none"), c.Compare(a="x"), c.ShowMap("x"), c.Fork((), 999),
                c.SetBreakpoints((("jump_mm", -1),)), c.Restart((("physics.steps", 0),))):  # fmt: skip
        with pytest.raises(VerefineError):
            target.carry_out([bad])
    same(target, before)


def test_step_back_and_seek_move_the_cursor() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Back()])
    assert (d.workspace.run.cursor, d.workspace.run.length) == (1, 2)
    d.carry_out([c.Seek(99)])
    assert d.workspace.run.cursor == 2
    d.carry_out([c.Seek(-5)])
    assert d.workspace.run.cursor == 0


def test_stage_by_stage_reveals_one_pose_after_another() -> None:
    d = debugger()
    seen = []
    for _ in range(5):
        d.carry_out([c.StepStage()])
        seen.append([n for n in ("current", "simulated", "mixed", "refined", "accepted") if n in d.view().poses])
    assert seen == [
        ["current"], ["current", "simulated"], ["current", "simulated", "mixed"],
        ["current", "simulated", "mixed", "refined", "accepted"],
        ["current", "simulated", "mixed", "refined", "accepted"],
    ]  # fmt: skip
    assert d.workspace.run.length == 1


def test_run_stops_at_the_end_and_a_pause_keeps_what_was_made() -> None:
    d = debugger()
    d.apply(c.RunUntil("end"))
    d.tick()
    d.apply(c.TogglePause())
    assert d.running.goal is None
    assert d.workspace.run.length == 1
    d.carry_out([c.TogglePause()])
    assert d.workspace.run.is_done
    assert d.workspace.run.length == 6


def test_breakpoint_stops_a_run_and_says_why() -> None:
    d = debugger().carry_out([c.SetBreakpoints((("simulated_rejected", True),)), c.RunUntil("end")])
    assert d.workspace.run.length == 1
    assert d.message.startswith("Breakpoint at iteration 1: simulated pose rejected")
    d.carry_out([c.SetBreakpoints((("simulated_rejected", False),)), c.RunUntil("end")])
    assert d.workspace.run.is_done


def test_a_breakpoint_names_the_object_where_there_are_several() -> None:
    d = debugger().carry_out([c.OpenFrame("0/2"), c.Focus(1)])
    d.carry_out([c.SetBreakpoints((("simulated_rejected", True),)), c.RunUntil("end")])
    of = d.workspace.run.iterations[0].instance_id
    assert d.message.startswith(f"Breakpoint at iteration 1, box #{of}: ")


def test_fork_with_changed_settings_shares_the_past() -> None:
    d = debugger().carry_out([c.Step(), c.Step(), c.Step(), c.Fork((("method.exploration", 5.0),), 2, run=True)])
    first, second = d.workspace.work.branches
    assert first_difference(first.run.iterations[:2], second.run.iterations[:2]) is None
    assert second.run.is_done
    assert second.tools.session.method.exploration == 5.0
    assert d.workspace.session.changes[0].after_iteration == 2
    assert "exploration = 5.0" in second.name


def test_a_fork_is_restarted_with_the_settings_it_shows() -> None:
    d = debugger().carry_out([c.Step(), c.Fork((("method.exploration", 5.0),)), c.Restart((("score.tau_m", 0.01),))])
    assert (d.workspace.session.method.exploration, d.workspace.session.score.tau_m) == (5.0, 0.01)
    assert d.workspace.session.changes == ()


def test_the_time_left_is_that_of_the_open_run() -> None:
    d = debugger()
    assert d.view().progress.remaining_s is None
    assert (d.carry_out([c.Step()]).view().progress.remaining_s or 0.0) > 0.0
    assert d.carry_out([c.OpenFrame("0/2")]).view().progress.remaining_s is None, "it may be far slower"


def test_what_was_compared_comes_back_when_no_pose_is_edited_any_more() -> None:
    ends: tuple[list[c.Command], ...] = (
        [c.EditPose(False)], [DRAGGED, c.ForkFromPose()], [c.Back()], [c.Focus(0)], [c.ShowScene()], [c.SelectArm(0)]
    )  # fmt: skip
    for end in ends:
        d = debugger().carry_out([c.Step(), c.Compare("initial", "best"), c.EditPose()])
        assert (d.options.a, d.options.b) == ("accepted", "edited")
        d.carry_out([c.EditPose(), *end])
        assert d.options.edited is None, end
        assert (d.options.a, d.options.b) == ("initial", "best"), end
        d.carry_out([c.EditPose(), c.Compare("current", "edited"), c.EditPose(False)])
        assert d.options.a == "current", "what a person chose meanwhile stays"


def test_edited_pose_is_scored_and_continued_from() -> None:
    d = debugger().carry_out([c.Step(), c.SelectArm(1), c.EditPose()])
    assert "Continue from here" in d.message
    T_gt = d.view().target.instance.T_cam_obj_gt
    d.carry_out([c.DragPose(tuple(float(x) for x in T_gt.ravel()))])
    edited = d.view().poses["edited"]
    assert edited.score.score == pytest.approx(1.0)
    d.carry_out([c.ForkFromPose()])
    assert d.workspace.run.state.objects[0].arms[1].current.stage == "edited"
    assert d.workspace.session.edits[0].hypothesis == 1
    assert d.view().session.edits == d.workspace.session.edits
    d.carry_out([c.RunUntil("end")])
    assert d.workspace.run.final_state.best[0].score.score == pytest.approx(1.0)


def test_a_mirrored_pose_cannot_be_dragged_in() -> None:
    d = debugger().carry_out([c.EditPose()])
    with pytest.raises(VerefineError, match="not rigid"):
        d.carry_out([c.DragPose(tuple(np.diag([-1.0, 1, 1, 1]).ravel()))])
    with pytest.raises(VerefineError, match="shape"):
        d.carry_out([c.DragPose((1.0, 2.0))])


def test_frames_keep_their_runs() -> None:
    d = debugger().carry_out([c.Step(), c.OpenFrame("0/2"), c.Step(), c.Step(), c.OpenFrame("0/1")])
    assert d.workspace.run.length == 1
    assert d.carry_out([c.OpenFrame("0/2")]).workspace.run.length == 2


def test_the_object_in_focus_follows_the_run_unless_one_is_chosen() -> None:
    d = debugger().carry_out([c.OpenFrame("0/2"), c.RunUntil("end")])
    view = d.view()
    assert view.target.instance.instance_id == 1
    assert view.shown.index == view.cursor == 12
    view = d.carry_out([c.Focus(0)]).view()
    assert view.target.instance.instance_id == 0
    assert view.shown.index == 6
    assert not view.is_current


def test_looking_does_not_stop_a_run() -> None:
    d = debugger()
    d.apply(c.RunUntil("end"))
    d.tick()
    d.apply(c.ColorCloud())
    assert d.running.goal == "end"
    d.apply(c.Seek(0))
    assert d.running.goal is None


def test_saved_session_repeats_the_run(tmp_path: Path) -> None:
    from verefine_viz.run.session_file import load_session, save_session

    d = debugger().carry_out([c.Step(), c.Fork((("method.exploration", 2.0),)), c.Step(), c.EditPose()])
    T = np.array(d.options.edited).reshape(4, 4)
    T[0, 3] += 0.004
    d.carry_out([c.DragPose(tuple(float(x) for x in T.ravel())), c.ForkFromPose()])
    d.carry_out([c.SetBreakpoints((("jump_mm", 50.0),)), c.RunUntil("end")])
    save_session(d.workspace.session, tmp_path / "kept.toml")
    again = debugger(load_session(tmp_path / "kept.toml"))
    assert "After iteration 1: method.exploration = 2.0" in opened(again.view())
    again.carry_out([c.RunUntil("end")])
    assert first_difference(d.workspace.run.iterations, again.workspace.run.iterations) is None
    assert again.workspace.breakpoints.jump_mm == 50.0


def test_a_run_that_is_over_goes_to_its_end_or_says_that_it_is_over() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Step()])
    assert d.message.startswith("The run is over")
    for back in (c.Back(), c.Seek(0), c.SeekStage(1, "current")):
        for run in (c.RunUntil("end"), c.TogglePause()):
            d.carry_out([back, run])
            assert d.message == "", (back, run)
            assert d.view(deep=False).is_answer, (back, run)
            assert d.carry_out([run]).message.startswith("The run is over"), "nothing is left to go to"


def test_unknown_setting_names_what_exists() -> None:
    with pytest.raises(SettingsError, match=r"unknown field 'method.explore'; did you mean 'exploration'[?]"):
        debugger().carry_out([c.Fork((("method.explore", 1.0),))])
    with pytest.raises((SettingsError, InputError), match="section"):
        debugger().carry_out([c.Fork((("scene.demo", "x"),))])


def test_a_built_in_scene_opens_with_the_settings_of_its_session_file(tmp_path: Path) -> None:
    own = tmp_path / "tower.toml"
    own.write_text('[scene]\ndemo = "tower"\n[physics]\nsteps = 20\n')
    other = tmp_path / "mug.toml"  # Of that name, but of another scene.
    other.write_text('[scene]\ndemo = "tower"\n[physics]\nsteps = 9\n')
    target = Debugger(
        Session(method=MethodSettings(iterations=2)), None, FakeTools,
        demos=("tower", "mug"), sessions=lambda: (str(own), str(other)),
    )  # fmt: skip
    target.carry_out([c.OpenDemo("mug")])
    assert (target.workspace.session.scene.demo, target.workspace.session.physics.steps) == ("mug", 3)
    assert target.workspace.session.method.iterations == 2
    target.carry_out([c.OpenDemo("tower")])
    assert (target.workspace.session.scene.demo, target.workspace.session.physics.steps) == ("tower", 20)
    assert target.workspace.path == own


def test_new_initial_poses_need_a_restart_and_a_seed() -> None:
    target = debugger().carry_out([c.Step()])
    with pytest.raises(SettingsError, match="section that can change during a run"):
        target.carry_out([c.Fork((("hypotheses.seed", 3),))])
    with pytest.raises(SettingsError, match=r"hypotheses\.seed = -3"):
        target.carry_out([c.Restart((("hypotheses.seed", -3),))])
    assert target.workspace.run.cursor == 1
    target.carry_out([c.Restart((("hypotheses.seed", 3),))])
    assert target.workspace.session.hypotheses.seed == 3
    assert target.workspace.run.length == 0


def test_what_takes_seconds_is_said_before_it_begins() -> None:
    said: list[str] = []

    class Slow(FakeTools):
        def run(self, problem: Problem, watchers: Sequence[Watcher[Any]] = ()) -> Run:
            said.append("run")
            return super().run(problem, watchers)

    Debugger(Session(), None, Slow, progress=ProgressToken(lambda doing, _: said.append(doing)))
    assert said[-1] == "run"
    assert "box" in said[-2]
