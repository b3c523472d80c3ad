"""Grasping on the page: when it can be asked for, what is shown of it, and that nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.viewer.fake_tools import DRAGGED, FakeTools
from verefine_viz.core.errors import Cancelled, InputError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import MethodSettings, RecordingSettings, Session
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.grasp_picture import grasp_picture, moment_table
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.grasp_commands import PlayGrasp, ShowGrasp, TryGrasp
from verefine_viz.viewer.panels.grasp_panel import ends_html
from verefine_viz.viewer.state.grasp_trials import GraspTrials
from verefine_viz.viewer.text.empty_tabs import empty_tabs

pytestmark = pytest.mark.usefixtures("processes")
SESSION = Session(method=MethodSettings(name="rir", iterations=2))


def debugger(*commands: c.Command) -> Debugger:
    return Debugger(SESSION, None, FakeTools).carry_out([c.RunUntil("end"), *commands])


def test_both_outcomes_are_shown_side_by_side() -> None:
    d = debugger()
    assert "Grasp box by the answer" in ends_html(d.view())
    d.carry_out([TryGrasp()])
    view = d.view()
    assert (view.grasp.answer.verdict, view.grasp.ground_truth.verdict) == ("success", "success")
    assert f"{view.grasp.answer.is_free.sum()} free" in ends_html(view)
    shown = view.shown_grasp
    assert (shown.by, shown.stage) == ("pose", "hold")
    assert "<svg" in grasp_picture(shown)
    assert "150" in moment_table(shown, view)


def test_a_pose_that_is_off_is_grasped_while_it_is_edited() -> None:
    d = debugger(TryGrasp(), c.EditPose())
    before = d.view()
    d.carry_out([DRAGGED])
    assert d.view().shown_grasp is None, "it was another pose's"
    d.carry_out([TryGrasp()])
    view = d.view()
    assert view.grasp.answer.verdict == "collided with the target"
    assert "collided with the target" in ends_html(view)
    assert view.options.edited is not None
    assert view.iterations == before.iterations
    after = d.carry_out([c.EditPose(False)]).view()
    assert after.shown_grasp is None
    assert after.grasp is not None, "the answer's is still known"
    assert after.grasp.answer.verdict == "success"


def test_moments_are_shown_one_by_one_until_it_is_hidden() -> None:
    d = debugger(TryGrasp(), ShowGrasp(0))
    shown = d.view().shown_grasp
    assert (shown.moment, shown.stage) == (0, "settle")
    d.carry_out([ShowGrasp(by="ground truth")])
    shown = d.view().shown_grasp
    assert (shown.by, shown.moment) == ("ground truth", shown.n_moments - 1)
    assert shown.attempt.T_cam_obj is d.view().target.instance.T_cam_obj_gt
    with pytest.raises(InputError, match=r"the grasp has no moment 5000, expected 0 to \d+"):
        d.apply(ShowGrasp(5000))
    assert d.carry_out([ShowGrasp(3), PlayGrasp()]).options.grasp_moment == shown.n_moments - 1
    assert d.carry_out([ShowGrasp()]).view().shown_grasp is None
    assert d.carry_out([c.ShowLayer("cloud"), ShowGrasp(2), c.Seek(1)]).options.grasp_moment is None


def test_a_gripper_that_does_not_open_far_enough_has_no_grasp() -> None:
    session = SESSION.model_copy(update={"grasp": SESSION.grasp.model_copy(update={"opening_m": 0.02})})
    d = Debugger(session, None, FakeTools).carry_out([c.RunUntil("end"), TryGrasp()])
    view = d.view()
    assert view.grasp is not None
    shown = view.shown_grasp
    assert (shown.n_moments, shown.stage) == (1, "")
    assert "no collision-free grasp" in ends_html(view)
    assert "wider than the gripper opens" in moment_table(shown, view)


def test_what_was_not_carried_out_cannot_be_shown() -> None:
    d = debugger()
    for command in (ShowGrasp(3), PlayGrasp(), ShowGrasp(by="ground truth")):
        with pytest.raises(InputError, match="press Grasp first"):
            d.apply(command)


def test_without_ground_truth_the_tab_says_why_and_a_command_is_refused() -> None:
    d = debugger()
    view, problem = d.view(), d.workspace.work.problem
    unknown = replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))
    assert "Grasp" not in empty_tabs(view)
    assert empty_tabs(replace(view, problem=unknown))["Grasp"] in ends_html(replace(view, problem=unknown))
    with pytest.raises(InputError, match="object 1 has no ground truth; a simulated grasp needs it"):
        GraspTrials().carry_out(unknown, SESSION.grasp, 0, view.poses["best"].T_cam_obj)


def test_a_cancelled_grasp_leaves_everything_as_it_was() -> None:
    told: list[str] = []
    progress = ProgressToken(lambda doing, share: told.append(doing), lambda: "Grasping: close" not in told)
    d = Debugger(SESSION, None, FakeTools, progress=progress).carry_out([c.RunUntil("end")])
    before = d.options
    with pytest.raises(Cancelled):
        d.apply(TryGrasp())
    assert d.options == before
    assert d.view().grasp is None


@pytest.mark.parametrize(("answers", "tried", "n_grasped"), [(False, [], 0), (False, [TryGrasp()], 1), (True, [], 2)])
def test_an_exported_recording_holds_the_grasps(
    tmp_path: Path, answers: bool, tried: list[c.Command], n_grasped: int
) -> None:
    grasp, recording = SESSION.grasp.model_copy(update={"answers": answers}), RecordingSettings(maps=False)
    session = SESSION.model_copy(update={"grasp": grasp, "recording": recording})
    server: Any = None  # Nobody asks for the file.
    d = Debugger(session, None, FakeTools, write=Exporter(server, tmp_path))
    d.carry_out([c.OpenFrame("0/2"), c.RunUntil("end"), *tried, c.Export("recording")])
    tables = [chunk for chunk in chunks_of(d.written[-1].path) if chunk.entity_path == entities.GRASP_ENDS]
    assert len(tables) == min(n_grasped, 1)
    for table in tables:
        assert str(table.to_record_batch().to_pylist()).count("_box |") == n_grasped


def test_the_log_repeats_it() -> None:
    d = debugger(TryGrasp(), ShowGrasp(4))
    again = Debugger(SESSION, None, FakeTools).carry_out(d.log)
    assert again.options == d.options
    one, other = d.view().shown_grasp, again.view().shown_grasp
    assert one.attempt.path.Ts_world_gripper.tobytes() == other.attempt.path.Ts_world_gripper.tobytes()
