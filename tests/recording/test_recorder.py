from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.changing import replace
from tests.fakes import box_problem
from tests.recording.runs import n_drawn, new_run, recorded_run, session
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.recording.entities import CHOICE, CURVES, PROPERTIES, hypotheses
from verefine_viz.recording.iteration_text import plain
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.iteration_words import sentence
from verefine_viz.run.run_file import RunFile

pytestmark = pytest.mark.usefixtures("processes")


@pytest.mark.parametrize("block", [1, 7])
def test_blocks_change_nothing(tmp_path: Path, block: int) -> None:
    s = session(maps=False)
    recorded_run(tmp_path / "a.rrd", s, block=25)
    recorded_run(tmp_path / "b.rrd", s, block=block)
    a, b = read_recording(tmp_path / "a.rrd"), read_recording(tmp_path / "b.rrd")
    assert first_difference(a.iterations, b.iterations) is None


def test_recorder_does_not_change_the_run(tmp_path: Path) -> None:
    problem = box_problem(3, 2)
    watched = recorded_run(tmp_path / "run.rrd", session(), problem)
    alone = new_run(session(), problem)
    alone.finish()
    assert first_difference(watched.iterations, alone.iterations) is None


@pytest.mark.parametrize("symmetric", [True, False])
def test_drawn_errors_are_those_of_the_evaluation(tmp_path: Path, symmetric: bool) -> None:
    problem = box_problem(3)
    if symmetric:
        half_turn = transform(axis_angle([0, 0, 1], np.pi), [0, 0, 0])
        problem = replace(problem, models={1: replace(problem.models[1], symmetries=np.stack([np.eye(4), half_turn]))})
        turned = tuple(replace(h, T_cam_obj=h.T_cam_obj @ half_turn) for h in problem.instances[0].hypotheses)
        problem = replace(problem, instances=(replace(problem.instances[0], hypotheses=turned),))
    run = recorded_run(tmp_path / "run.rrd", session("sir"), problem)
    T_gt = problem.instances[0].T_cam_obj_gt
    assert T_gt is not None
    names = ("rotation_deg", "translation_mm", "add_s_mm")
    drawn = zip(*(curve(tmp_path / "run.rrd", f"{CURVES}/error/0_box/{name}") for name in names), strict=True)
    for errors, iteration in zip(drawn, run.iterations, strict=True):
        kept = pose_errors(problem.models[1], iteration.accepted_stage.T_cam_obj, T_gt)
        best = pose_errors(problem.models[1], iteration.best.T_cam_obj, T_gt)
        assert errors == pytest.approx([kept.rotation_deg, kept.translation_mm, best.add_s_mm], abs=1e-5)


def curve(path: Path, entity: str) -> list[float]:
    """The numbers of a curve, iteration by iteration."""
    chunks: list[Any] = [c for c in chunks_of(path) if c.entity_path == entity and not c.is_static]
    return [value for c in chunks for (value,) in c.to_record_batch().column("Scalars:scalars").to_pylist()]


def test_the_panel_says_of_an_iteration_what_the_page_says(tmp_path: Path) -> None:
    run = recorded_run(tmp_path / "run.rrd", session("rir", maps=False))
    labels = {0: "0_box", 1: "1_box", 2: "2_box"}
    chunks: list[Any] = [c for c in chunks_of(tmp_path / "run.rrd") if c.entity_path == CHOICE and not c.is_static]
    texts = [text for c in chunks for text in c.to_record_batch().column("TextDocument:text").to_pylist()]
    for (text,), one in zip(texts, run.iterations, strict=True):
        words = sentence(one, run.problem.target(one.instance_id), session().method.refiner, labels)
        assert plain(words) in text, one.index
        assert "Accepted: " in words


def test_a_run_that_is_left_early_is_drawn_as_far_as_it_went(tmp_path: Path) -> None:
    s, problem = session(), box_problem(3)
    recorder, file = Recorder(tmp_path / "run.rrd", s, problem), RunFile(tmp_path / "run.vfrun", s)
    run = new_run(s, problem, (file, recorder))
    for _ in range(4):
        run.step()
    recorder.close(file.path.read_bytes())
    file.path.unlink()
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]
    assert n_drawn(tmp_path / "run.rrd") == 4
    record = read_recording(tmp_path / "run.rrd")
    assert (len(record.iterations), record.is_complete) == (4, False)


def test_unwritable_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    s, problem = session(), box_problem()
    with pytest.raises(InputError, match="/file: "):
        new_run(s, problem, (Recorder(tmp_path / "file" / "run.rrd", s, problem),))


def test_a_recording_is_called_after_what_it_is_of_and_says_what_came_of_it(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session("rir"), box_problem(3))
    with warnings.catch_warnings(action="ignore"):  # That a file has no index.
        (recording,) = RrdReader(tmp_path / "run.rrd").recordings()
    assert recording.recording_id == "boxes/0/1/rir/seed 0"
    found: dict[str, object] = {}
    for chunk in chunks_of(tmp_path / "run.rrd"):
        if chunk.entity_path == PROPERTIES:
            found |= chunk.to_record_batch().to_pylist()[0]
    said = {name.rpartition(":")[2]: value for name, value in found.items()}
    assert said["method"] == ["rir"]
    assert said["status"] == ["ok"]
    assert np.isnan(said["score"]).all()
    assert {"add_s_mm", "cause", "object"} <= said.keys()


def test_all_of_a_recording_can_be_a_table(tmp_path: Path) -> None:
    """Unions, which tensors are made of, are the one kind of column that pandas and others cannot take."""
    recorded_run(tmp_path / "run.rrd", session("rir"), box_problem(3))
    for chunk in chunks_of(tmp_path / "run.rrd"):
        for field in chunk.to_record_batch().schema:
            assert "union" not in str(field.type), (chunk.entity_path, field.name)


def test_hypotheses_are_hidden_when_the_run_is_over(tmp_path: Path) -> None:
    run = recorded_run(tmp_path / "run.rrd", problem=box_problem(3))
    cleared = [
        row["iteration"]
        for c in chunks_of(tmp_path / "run.rrd")
        if c.entity_path == hypotheses("0_box")
        for row in c.to_record_batch().to_pylist()
        if row.get("Clear:is_recursive") is not None
    ]
    assert cleared == [run.length]


def test_hostile_names_stay_in_their_branch(tmp_path: Path) -> None:
    problem = box_problem(2)
    hostile = replace(problem.models[1], name="../<script>alert(1)</script> /a/b mug")
    problem = replace(problem, models={1: hostile}, title="<b>x</b>")
    recorded_run(tmp_path / "run.rrd", problem=problem)
    entity = "/scene/objects/0_script_alert_1_script_a_b_mug/"
    assert any(chunk.entity_path.startswith(entity) for chunk in chunks_of(tmp_path / "run.rrd"))


def test_nothing_is_left_open_when_the_run_never_starts(tmp_path: Path) -> None:
    Recorder(tmp_path / "run.rrd", session(), box_problem()).close()
    assert [*tmp_path.iterdir()] == []
