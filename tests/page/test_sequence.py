"""The want ``sequence``: objects over frames as a browser gets them, of batches, watched folders, frames solved."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made_runs import answer, finished
from tests.page.test_views_tabs import asked
from tests.page.test_views_tabs import opened as opened
from tests.planted_sequence import AROUND, HALF_TURN, planted
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.motion_table import motion_rows, tracks_of
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.batch.watch import WatchedDataset
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.pose_motion import NO_SYMMETRY
from verefine_viz.page import protocol as p
from verefine_viz.page.verbs import Debugger
from verefine_viz.run.record import RunRecord

N = 2000
OBJECTS = {obj_id: planted(N, 20, obj_id, is_bowl=obj_id == 3) for obj_id in (1, 2, 3, 4)}
BOWL = 3


class Shapes:
    """Number 3 is a bowl; the others look nearly the same turned by half."""

    def symmetries_of(self, obj_id: int, frame: str) -> Float:
        return AROUND if obj_id == BOWL else NO_SYMMETRY

    def turns_of(self, obj_id: int, frame: str) -> Float:
        return HALF_TURN


def record(i: int, has_truth: bool = False) -> RunRecord:
    answers = []
    for obj_id, one in OBJECTS.items():
        T = one.poses[i]
        errors = {"add_s_mm": 0.01 * i, "diameter_mm": 100.0} if has_truth and T is not None else {}
        answers.append(
            answer(0, i, instance_id=obj_id, obj_id=obj_id, name=f"object {obj_id}", T_cam_obj=T, middle_m=np.zeros(3),
                   status="no_answer" if T is None else "ok", score=None if T is None else i / N, **errors)
        )  # fmt: skip
    return finished(f"0/{i}", answers)


def rows_of(records: list[RunRecord]) -> tuple[Any, ...]:
    return tuple(row for one in records if one.end for row in one.end.answers)


def batch_of(records: list[RunRecord]) -> BatchIndex:
    tracks = partial(tracks_of, motion_rows(records, Shapes()))
    return BatchIndex(Path("run"), Session(), BatchInfo(), rows_of(records), motion=tracks)


def columns(debugger: Debugger, got: dict[str, Any]) -> dict[str, Any]:
    """The arrays (lanes, frames) of an answer."""
    data, shape = debugger.blobs.data(got["blob"]), (len(got["lanes"]), len(got["frames"]))
    return {name: np.frombuffer(data, kind, n, at).reshape(shape) for name, kind, at, n, _ in got["arrays"]}


def looking_at(opened: Any, *runs: BatchIndex) -> Debugger:
    debugger = opened()
    debugger.space.runs = {f"run {k}": index for k, index in enumerate(runs)}
    debugger.space.batch_run = "run 0"
    return debugger


@pytest.mark.parametrize("has_truth", [False, True])
def test_a_batch_of_2000_frames_has_the_marks_that_were_planted(opened: Any, has_truth: bool) -> None:
    other = batch_of([record(0)])
    d = looking_at(opened, other, batch_of([record(i, has_truth) for i in range(N)]))
    got = asked(d, p.SequenceWanted("run 1"))
    assert [lane["object"] for lane in got["lanes"]] == [*OBJECTS]
    for lane, one in enumerate(OBJECTS.values()):
        marks = [(frame, kind) for at, frame, kind in got["marks"] if at == lane]
        assert marks == [*one.marks], lane
    arrays = columns(d, got)
    assert ({"err", "share"} <= {*arrays}) == has_truth
    has_pose = np.array([[T is not None for T in one.poses] for one in OBJECTS.values()])
    assert np.array_equal(arrays["state"], np.where(has_pose, 1, 2))
    assert np.array_equal(arrays["score"][has_pose], np.tile(np.float32(np.arange(N) / N), (4, 1))[has_pose])
    assert arrays["key"][2, 5] == 4 + 5 * 4 + 2, "keys go on over the runs"
    if has_truth:
        assert arrays["share"][0, 10] == pytest.approx(0.001)
        assert np.isnan(arrays["err"][~has_pose]).all()


def test_a_watched_folder_grows_and_what_waits_is_not_lost(opened: Any) -> None:
    watched = WatchedDataset(Path("run"), Session(), tuple(f"0/{i}" for i in range(60)))
    watched.shapes = Shapes()  # type: ignore[assignment]
    d, seen = looking_at(opened), []
    for n in (0, 20, 40):
        watched.results |= {f"0/{i}": record(i) for i in range(n)} | {
            f"0/{i}": record(i) for i in range(50, 50 + n // 10)
        }
        d.space.runs = {"run 0": watched.index}
        got = asked(d, p.SequenceWanted(done=n))
        seen.append((len(got["lanes"]), len(got["frames"])))
    assert seen == [(0, 0), (4, 60), (4, 60)]
    arrays = columns(d, got)
    assert (arrays["state"][:, 40:50] == 3).all()
    assert (arrays["state"][:, 54:] == 3).all()
    planted_there = {(k, f, kind) for k, one in enumerate(OBJECTS.values()) for f, kind in one.marks if f < 40}
    assert {tuple(mark) for mark in got["marks"] if mark[1] < 40} == planted_there
    assert not [mark for mark in got["marks"] if mark[1] >= 54]


def test_frames_in_no_order_have_cells_and_no_marks(opened: Any) -> None:
    index = BatchIndex(Path("no folder"), Session(), BatchInfo(), rows_of([record(i) for i in (0, 700, 1400)]))
    d = looking_at(opened, index)
    got = asked(d, p.SequenceWanted())
    assert (got["marks"], got["legend"]) == ([], {})
    assert {"state", "key", "score"} == {*columns(d, got)}
    with pytest.raises(InputError, match="unknown scene 9"):
        asked(d, p.SequenceWanted(scene=9))


def test_frames_that_were_solved_here_are_lanes(opened: Any) -> None:
    d = opened(p.RunVerb())
    assert asked(d, p.SequenceWanted())["lanes"] == []
    best = d.space.work.first.run.final_state.best[0]
    d.carry_out([p.Open(frame="0/2")])
    d.carry_out([p.RunVerb(d.space.work.first.index)])
    got = asked(d, p.SequenceWanted())
    arrays = columns(d, got)
    assert [*arrays["state"][0][:2]] == [1, 1]
    assert got["frames"][:2] == ["0/1", "0/2"]
    assert arrays["score"][0][0] == np.float32(best.score.score)
    target, now = d.space.problem.targets[0], d.space.work.first.run.final_state.best[0]
    error = add_s_mm(target.model, now.T_cam_obj, target.instance.T_cam_obj_gt)
    assert arrays["err"][0][1] == np.float32(error)
