"""The strip of a sequence: where its numbers come from, what it draws, and that it opens frames."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest

from tests.batch.test_motion_table import at, result, rows_of
from tests.fakes import box_problem
from tests.scenes.test_pose_sequence import source_of, write_sequence
from tests.scenes.test_trace import write_box, write_trace
from tests.viewer.fake_tools import FakeTools
from verefine_viz.batch.motion_table import MOTION, write_motion
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings, Session
from verefine_viz.evaluation.pose_motion import Motion
from verefine_viz.scenes.source import open_scene
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command_json import from_json
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.frame_strip import MOST, WIDTH, frame_strip
from verefine_viz.viewer.snapshot.frame_track import TrackFrame, frame_track


def opened_by(strip: str) -> list[str]:
    """The frames that its columns open."""
    commands = [from_json(html.unescape(found)) for found in re.findall(r'data-cmd="([^"]*)"', strip)]
    return [command.frame for command in commands if isinstance(command, c.OpenFrame)]


def track(n: int, flips: tuple[int, ...] = (), **facts: float) -> list[TrackFrame]:
    return [
        TrackFrame(Motion(f"0/{k}", "flip" if k in flips else "moved", moved_mm=k % 3, turned_deg=1.0), **facts)
        for k in range(n)
    ]


def test_each_frame_has_a_column_that_opens_it() -> None:
    strip = frame_strip(track(5, flips=(3,)), "0/2")
    assert opened_by(strip) == [f"0/{k}" for k in range(5)]
    assert "5 frames, 1 flip (20 per 100), 0 jumps" in strip
    assert "frame 0/3: 0.0 mm, 1.0° (flip)" in strip
    assert strip.count('class="open"') == 1
    assert "score" not in strip


def test_of_many_frames_a_column_opens_the_one_that_flips() -> None:
    strip = frame_strip(track(1000, flips=(500, 777)), "0/500")
    opened = opened_by(strip)
    assert 100 < len(opened) <= MOST
    assert {"0/500", "0/777"} <= {*opened}
    assert len(strip) < 100_000


def test_rows_are_there_where_their_numbers_are_known() -> None:
    full = track(4, score=0.8, recorded_score=3.5, undetermined_mm=6.0, undetermined_deg=20.0, missing_depth=0.25)
    words = html.unescape(frame_strip(full, "0/0"))
    for known in ("score 0.80", "theirs 3.5", "6 mm, 20°", "25% without depth"):
        assert known in words
    assert "depth" not in frame_strip(track(4, score=0.8), "0/0")
    assert frame_strip(full[:1], "0/0") == ""
    one = TrackFrame(Motion("0/1", "moved", moved_mm=3.0, turned_deg=1.0, lifted_mm=-0.4, tilted_deg=0.2))
    assert "on the table -0.4 mm, 0.2°" in frame_strip([one, one], "0/1")


def test_nothing_is_drawn_outside() -> None:
    for n in (2, 145, 146, 1000):
        strip = frame_strip(track(n, score=0.5, missing_depth=1.0, undetermined_mm=99.0, undetermined_deg=180.0), "0/1")
        height = float(re.search(r'<svg[^>]* height="([\d.]+)"', strip)[1])  # type: ignore[index]
        for x, y, w, h in re.findall(r'<rect x="([\d.-]+)" y="([\d.-]+)" width="([\d.]+)" height="([\d.]+)"', strip):
            assert -0.1 <= float(x) <= float(x) + float(w) <= WIDTH + 0.3, n
            assert -0.1 <= float(y) <= float(y) + float(h) <= height, n


def test_a_sequence_shows_recorded_poses_with_scores_of_what_was_solved_here(tmp_path: Path) -> None:
    source = source_of(write_sequence(tmp_path / "mustard"))
    target = source.problem("0/2").targets[0]
    frames = frame_track(None, source, target, "0/2", None, {"0/2": 0.9})
    assert [(f.frame, f.score) for f in frames] == [("0/1", None), ("0/2", 0.9), ("0/3", None)]
    assert [f.motion.moved_mm for f in frames] == pytest.approx([0, 2, 2], abs=1e-3)


def test_traces_named_by_numbers_show_their_own_scores_and_others_are_no_sequence(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "box.obj")
    for name in ("runs/000001", "runs/000002", "drops/drop_1", "drops/drop_2"):
        write_trace(tmp_path / name, mesh)
    sources = [
        open_scene(SceneSettings(source="trace", dataset=str(tmp_path / name)), HypothesesSettings(source="recorded"))
        for name in ("runs", "drops")
    ]
    of_runs, of_drops = (
        frame_track(None, source, source.problem(source.frames[0]).targets[0], source.frames[0], None, {})
        for source in sources
    )
    assert [(f.frame, f.recorded_score) for f in of_runs] == [("0/1", 0.9), ("0/2", 0.9)]
    assert of_drops == ()


def test_an_open_batch_wins_and_shows_all_its_numbers(tmp_path: Path) -> None:
    target = box_problem().targets[0]
    instance = target.instance
    poses = [{(instance.obj_id, instance.instance_id): at(x)} for x in (0, 7)]
    write_motion(tmp_path / MOTION, rows_of([result(k, of_frame) for k, of_frame in enumerate(poses)]))
    frames = frame_track(tmp_path, None, target, "0/1", None, {"0/1": 0.1})
    assert [(f.frame, f.score, round(f.motion.moved_mm)) for f in frames] == [("0/0", 0.5, 0), ("0/1", 0.5, 7)]
    assert frame_track(tmp_path, None, target, "0/9", None, {}) == ()
    assert frame_track(tmp_path / "gone", None, target, "0/1", None, {}) == ()


def test_keys_open_the_frame_beside_and_say_where_there_is_none() -> None:
    debugger = Debugger(Session(), None, FakeTools)
    debugger.carry_out([c.OpenNeighbour(1)])
    assert debugger.workspace.frame == "0/2"
    assert debugger.log[-1] == c.OpenFrame("0/2")
    with pytest.raises(InputError, match="that is the last frame"):
        debugger.apply(c.OpenNeighbour(1))
    debugger.carry_out([c.OpenNeighbour(-1)])
    assert debugger.workspace.frame == "0/1"
    with pytest.raises(InputError, match="that is the first frame"):
        debugger.apply(c.OpenNeighbour(-1))


def test_a_finished_run_on_the_page_gives_its_score() -> None:
    debugger = Debugger(Session(), None, FakeTools)
    obj_id = debugger.workspace.work.problem.instances[0].obj_id
    assert debugger.workspace.final_scores(obj_id) == {}
    debugger.carry_out([c.RunUntil("end")])
    (score,) = debugger.workspace.final_scores(obj_id).values()
    best = debugger.run.final_state.best[0]
    assert score == best.score.score
    assert np.isfinite(score)
