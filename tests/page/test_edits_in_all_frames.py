"""Poses that are edited in several frames of a session: where they hold, what is listed of them, what is saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.page.conftest import Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Change, Edit, MethodSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.export import Exporter
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.run.session_file import load_session

T_MOVED = (1.0, 0, 0, 0.05, 0, 1, 0, 0.08, 0, 0, 1, 0.7, 0, 0, 0, 1)


def session(*edits: Edit, changes: tuple[Change, ...] = ()) -> Session:
    return Session(title="boxes", method=MethodSettings(iterations=2), edits=edits, changes=changes)


def edit_of(instance: int, hypothesis: int = 0, frame: str = "", after: int = 0) -> Edit:
    return Edit(after_iteration=after, instance=instance, hypothesis=hypothesis, T_cam_obj=T_MOVED, frame=frame)


def opened(of: Session, posted: Posted | None = None, folder: Path | None = None) -> Debugger:
    """Open frame 0/1 with box 0, or 0/2 with boxes 0 and 1."""
    write = Exporter(folder) if folder is not None else None
    return Debugger(Workspace(of, None, FakeTools), Posted() if posted is None else posted, write=write)


def shown(d: Debugger) -> tuple[list[dict], list[str]]:
    """Return the edits that the page lists of the branch that was made last, and those of other frames."""
    posted = d.post
    assert isinstance(posted, Posted)
    d.send_branches()
    branch = posted.of("branches")[-1]["list"][-1]
    return branch["edits"], branch["elsewhere"]


def move(d: Debugger) -> None:
    """Edit a pose of the open frame, and look at the branch that goes on from it."""
    d.carry_out([p.Fork(0, max(d.space.branches), edit=p.EditedPose(0, 0, T_MOVED))])
    d.carry_out([p.Look(max(d.space.branches))])


def saved(path: Path) -> list[tuple[int, str]]:
    return [(edit.instance, edit.frame) for edit in load_session(path).edits]


def test_an_edit_holds_in_the_frames_that_have_its_hypothesis():
    d = opened(session(edit_of(1)))
    assert d.space.frame == "0/1"
    assert shown(d) == ([], ["hypothesis 1 of instance 1, which this frame does not have"])
    d.carry_out([p.Open(frame="0/2")])
    edits, elsewhere = shown(d)
    assert [(e["k"], e["obj"], e["arm"]) for e in edits] == [(0, 1, 0)]
    initial = d.space.problem.target(1).instance.hypotheses[0].T_cam_obj
    target = d.space.problem.target(1)
    centre = np.append(target.model.points.mean(axis=0), 1.0)
    far = np.linalg.norm((np.reshape(T_MOVED, (4, 4)) - initial) @ centre)
    assert edits[0]["mm"] == pytest.approx(1e3 * far)
    assert elsewhere == []


def test_what_lies_behind_the_end_of_the_run_is_noted():
    posted = Posted()
    late = edit_of(0, frame="0/1", after=999)
    change = Change(after_iteration=10**9, settings={"method": {"exploration": 0.2}})
    opened(session(late, changes=(change,)), posted).welcome(1)
    of_pose, of_setting = posted.of("run")[-1]["notes"]
    assert "after iteration 999" in of_pose
    assert "after iteration 1000000000" in of_setting
    longer = Change(after_iteration=2, settings={"method": {"iterations": 5}})
    d = opened(session(late, changes=(longer,)), posted)
    d.welcome(1)
    assert posted.of("run")[-1]["notes"] == [], "a change on the way may make it longer"
    d.carry_out([p.RunVerb()])
    assert "15 iterations" in posted.of("run")[-1]["notes"][0]


def test_poses_moved_in_each_frame_are_saved_together(tmp_path: Path):
    d = opened(session(), folder=tmp_path)
    move(d)
    d.carry_out([p.Open(frame="0/2")])
    move(d)
    d.carry_out([p.Save("session", max(d.space.branches), name="two")])
    assert sorted(frame for _, frame in saved(tmp_path / "two.toml")) == ["0/1", "0/2"]
    again = opened(load_session(tmp_path / "two.toml"))
    assert again.space.frame == "0/2", "the one that was shown"
    assert len(again.space.work.first.run.edits) == 1
    again.carry_out([p.Open(frame="0/1")])
    assert len(again.space.work.first.run.edits) == 1


def test_what_was_done_in_another_frame_is_named_where_it_is_not_saved(tmp_path: Path):
    posted = Posted()
    d = opened(session(), posted, tmp_path)
    d.carry_out([p.Fork(0, changes={"method.exploration": 0.4})])
    d.carry_out([p.Look(1), p.Open(frame="0/2")])
    move(d)
    d.carry_out([p.Save("session", max(d.space.branches), name="here")])
    assert "it does not hold what was done in frame 0/1" in posted.of("written")[-1]["note"]
    assert saved(tmp_path / "here.toml") == [(0, "0/2")]


def test_a_restart_says_what_it_does_not_repeat():
    posted = Posted()
    d = opened(
        session(edit_of(0), changes=(Change(after_iteration=2, settings={"method": {"exploration": 0.2}}),)), posted
    )
    d.carry_out([p.RunVerb(), p.Restart()])
    notes = [message["text"] for message in posted.of("note")]
    assert "1 edited pose is not moved again." in notes
    assert "The settings changed on the way now hold from iteration 1 on." in notes
    assert d.space.session_of(d.space.work.first).edits == ()
    assert d.space.work.first.settings.method.exploration == 0.2


def test_nothing_can_go_on_from_a_pose_where_no_iteration_is_left():
    d = opened(session())
    d.carry_out([p.RunVerb()])
    n = d.space.work.first.run.length
    with pytest.raises(InputError, match="no iteration is left for box"):
        d.carry_out([p.Fork(n, edit=p.EditedPose(0, 0, T_MOVED))])
    assert len(d.space.branches) == 1
    d.carry_out([p.Fork(n - 1, edit=p.EditedPose(0, 0, T_MOVED), run=True)])
    assert d.space.branches[1].run.is_done
