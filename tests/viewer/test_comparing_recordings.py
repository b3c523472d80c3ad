"""Two runs of which one or both come from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.viewer.fake_tools import DRAGGED
from tests.viewer.two_runs import SESSION, SIR, TWO, Numbered, page, record, same, sides
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import MethodSettings, SceneSettings, Session
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.run_file import RunFile
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.drawing.comparison_tables import parting
from verefine_viz.viewer.text.verdict import verdict

pytestmark = pytest.mark.usefixtures("processes")


@dataclass(frozen=True)
class Recordings:
    """Files of two methods, and of another frame."""

    rir: Path
    sir: Path
    elsewhere: Path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    folder = tmp_path_factory.mktemp("recordings")
    return Recordings(
        record(folder / "rir.rrd", SESSION),
        record(folder / "sir.rrd", Session(method=MethodSettings(name="sir", iterations=2))),
        record(folder / "elsewhere.rrd", SESSION, frame="0/1"),
    )


def test_a_recording_beside_the_run_it_was_made_of(recordings: Recordings) -> None:
    path = recordings.rir
    d = page().carry_out([TWO, c.RunUntil("end"), c.CompareRecording(str(path))])
    v = sides(d)
    assert "the same in all 12 iterations" in parting(v)
    assert {o.winner for o in v.outcomes} == {"even"}
    again = page().carry_out(d.log)
    same(d, again)


def test_two_recordings_from_disk(recordings: Recordings) -> None:
    one, other = recordings.rir, recordings.sir
    d = page().carry_out([c.OpenRecording(str(one)), c.CompareRecording(str(other))])
    assert d.workspace.frame == "0/2"
    v = sides(d)
    assert (v.name_a, v.name_b) == ("rir, rir.rrd", "sir, sir.rrd")
    assert (v.effort_a.iterations, v.effort_b.iterations) == (12, 4)
    assert d.workspace.run.cursor == 0
    for command in (c.Step(), c.SeekDifference(), c.SwapSides(), c.SelectArm(0), c.SeekMoment(99), c.Focus(1)):
        d.carry_out([command])
        d.view()
    live = page().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR)])
    ours, theirs = sides(d.carry_out([c.SwapSides(), c.SeekMoment(99)])), sides(live)
    assert ours.pairs == theirs.pairs
    assert ours.departures.deed == theirs.departures.deed
    assert [o.winner for o in ours.outcomes] == [o.winner for o in theirs.outcomes]


def test_a_recording_goes_on_from_any_iteration_as_the_run_itself_would(recordings: Recordings) -> None:
    fork = c.Fork((("method.exploration", 5.0),), run=True)
    read = page().carry_out([c.OpenRecording(str(recordings.rir)), c.Seek(3), fork])
    made = page().carry_out([TWO, c.RunUntil("end"), c.Seek(3), fork])
    assert first_difference(read.workspace.run.iterations, made.workspace.run.iterations) is None
    d = page().carry_out([c.OpenRecording(str(recordings.rir)), c.CompareRun((("method.exploration", 5.0),))])
    assert sides(d).effort_b.iterations == 12
    d.carry_out([c.Restart()])
    assert d.workspace.run.length == 0
    d.carry_out([c.RunUntil("end"), c.CompareRecording(str(recordings.rir))])
    assert sides(d).departures == (None, None)


def test_a_run_that_ended_early_gets_no_verdict_and_goes_on(tmp_path: Path) -> None:
    tools = Numbered(SESSION)
    file = RunFile(tmp_path / "a.vfrun", SESSION)
    run = tools.run(tools.problem("0/2"), (file,))
    for _ in range(5):
        run.step()
    d = page().carry_out([c.OpenRecording(str(file.path)), c.SeekEnd()])
    found = verdict(d.view())
    assert found.mark == "…"
    assert found.cause.startswith("the run ended early (it was stopped or cut off); 5 iterations are in it")
    d.carry_out([c.Fork((), run=True)])
    run.finish()
    assert first_difference(d.workspace.run.iterations, run.iterations) is None
    assert verdict(d.view()).mark in "✓✗?"


def test_a_pose_in_a_recording_can_be_moved_and_gone_on_from(recordings: Recordings) -> None:
    moves = [c.Seek(3), c.EditPose(), DRAGGED, c.ForkFromPose(), c.RunUntil("end")]
    read = page().carry_out([c.OpenRecording(str(recordings.rir)), *moves])
    made = page().carry_out([TWO, c.RunUntil("end"), *moves])
    assert len(read.workspace.run.edits) == 1
    assert first_difference(read.workspace.run.iterations, made.workspace.run.iterations) is None


def test_recordings_that_do_not_fit_are_refused_in_one_line(recordings: Recordings, tmp_path: Path) -> None:
    one, elsewhere = recordings.rir, recordings.elsewhere
    tower = SESSION.model_copy(update={"scene": SceneSettings(demo="tower")})
    other_scene = record(tmp_path / "tower.rrd", tower)
    damaged = tmp_path / "damaged.rrd"
    damaged.write_bytes(one.read_bytes()[:200])
    no_rrd = tmp_path / "no.rrd"
    no_rrd.write_text("hello")
    d = page().carry_out([c.OpenRecording(str(one))])
    before = page().carry_out(d.log)
    for path, words in (
        (elsewhere, "elsewhere.rrd shows frame 0/1 of mug, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (other_scene, "tower.rrd shows frame 0/2 of tower, seed 0, A shows frame 0/2 of mug, seed 0; "),
        (damaged, "damaged.rrd"),
        (no_rrd, "no.rrd is not a rerun recording"),
        (tmp_path / "gone.rrd", "gone.rrd does not exist"),
    ):
        for command in (c.CompareRecording(str(path)), c.OpenRecording(str(path))):
            if isinstance(command, c.OpenRecording) and path in (elsewhere, other_scene):
                continue
            with pytest.raises(VerefineError) as caught:
                d.carry_out([command])
            assert words in str(caught.value)
            assert "\n" not in str(caught.value)
    same(d, before)


def test_a_page_opens_with_two_recordings_or_says_why_not(recordings: Recordings) -> None:
    one, other = c.OpenRecording(str(recordings.rir)), c.CompareRecording(str(recordings.sir))
    elsewhere = c.CompareRecording(str(recordings.elsewhere))
    app = App(SESSION, None, port=0, make_tools=Numbered, first=(one, other)).start()
    try:
        app.wait_until_idle()
        assert sides(app.debugger).name_b == "sir, sir.rrd"
        app.send(elsewhere)
        app.wait_until_idle()
        assert "two runs are compared on the same frame" in app.debugger.message
    finally:
        app.stop()
    app = App(SESSION, None, port=0, make_tools=Numbered, first=(one, elsewhere)).start()
    try:
        with pytest.raises(VerefineError, match="two runs are compared on the same frame"):
            app.wait_until_ready(30)
    finally:
        app.stop()
