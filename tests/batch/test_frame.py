"""Solving one frame: which recordings stay, what failures look like, what is noted of data and grasps."""

from __future__ import annotations

import shutil
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from numba import njit

from tests.batch.frames import depth_file, make_frames, write_session
from tests.calibration.sizes import WithoutTruth, scene, written
from tests.made_runs import write_first_format
from tests.scenes.bop_folder import Made
from verefine_viz.batch import solve_frame as causes
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo, Runs
from verefine_viz.batch.solve_frame import FrameTask, end_again, explain_frame, solve_frame
from verefine_viz.batch.totals import Totals
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, RecordingSettings, SceneSettings, Session
from verefine_viz.diagnosis.films import films_of
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.page.gallery import Gallery
from verefine_viz.recording.entities import FILM, branch, moment
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.verify import verify
from verefine_viz.run.answers import STAGES, solving_s, table_lines
from verefine_viz.run.record import DATA_FIRST, RunEnd
from verefine_viz.run.run_file import read_run_file, write_record
from verefine_viz.run.session_file import load_session
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.toolbox import Toolbox


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_frames(tmp_path / "data", 1)


def toolbox(made: Made, keep: str = "none", off_mm: float = 0.0) -> Toolbox:
    """An initial pose per object, so far off, that is never moved: what goes in comes out."""
    session = write_session(
        made.root.parent, made,
        hypotheses={"max_per_object": 1, "rotation_deg": 0.0, "translation_mm": off_mm},
        recording={"keep": keep, "maps": False},
        method={"name": "refine", "refiner": "identity", "iterations": 3},
    )  # fmt: skip
    return Toolbox(load_session(session))


def solved(tools: Toolbox, task: FrameTask = solve_frame) -> RunEnd:
    """How the frame ended; its run file says the same, and there is none where it failed."""
    out = Path(tools.session.scene.dataset).parent
    record, runs = task(tools, "7/0", out), Runs(out / "runs")
    written = runs.entry("7/0") if runs.path("7/0").exists() else None
    assert (written is None) == record.end.failed
    if written is not None:
        assert table_lines(written) == table_lines(record)
        assert written.header.session == record.header.session
    return record.end


@pytest.mark.usefixtures("processes")
def test_a_recording_with_maps_has_the_key_moments_of_every_answer(tmp_path: Path, made: Made) -> None:
    tools = toolbox(made, "all", 60.0)
    tools = Toolbox(structs.replace(tools.session, recording=RecordingSettings(keep="all", maps=True)))
    solved(tools)
    (recording,), problem = (tmp_path / "recordings").glob("*"), tools.problem("7/0")
    films = films_of(read_recording(recording), problem, tools.verifier_of)
    assert len(films) == 3
    drawn = {chunk.entity_path for chunk in chunks_of(recording) if chunk.entity_path.startswith(FILM)}
    names = {instance.instance_id: branch(instance, problem) for instance in problem.instances}
    assert drawn == {moment(names[own], k) for own, film in films.items() for k in range(len(film.moments))}


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(
    ("keep", "off_mm", "n_kept"),
    [("all", 0.0, 1), ("failures", 0.0, 0), ("failures", 60.0, 1), ("none", 60.0, 0)],
)
def test_the_recordings_that_were_asked_for_are_kept(
    tmp_path: Path, made: Made, keep: str, off_mm: float, n_kept: int
) -> None:
    result = solved(toolbox(made, keep, off_mm))
    assert [row.is_correct for row in result.answers] == [off_mm == 0.0] * 3
    assert [row.ar == 1.0 for row in result.answers] == [off_mm == 0.0] * 3
    recordings = list((tmp_path / "recordings").glob("*"))
    assert len(recordings) == n_kept
    for file in recordings:
        assert len(read_recording(file).iterations) == 9  # 3 objects, 3 iterations: the whole history


def test_recording_is_no_part_of_the_time_of_solving(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(recorder: Recorder, *_: object) -> None:
        sleep(0.1)

    for name in ("on_start", "on_iteration", "on_finish"):
        monkeypatch.setattr(Recorder, name, slow)
    result = solved(toolbox(made, "failures", 60.0))
    n_calls = 1 + 9 + 1  # start, iterations, end
    assert result.stages_ms["record"] > 100 * n_calls
    assert solving_s(result) == pytest.approx(1e-3 * (result.stages_ms["start"] + result.stages_ms["iterate"]))
    assert solving_s(result) < result.seconds - 0.1 * n_calls
    assert sum(result.stages_ms.values()) < 1e3 * result.seconds


def test_kernels_are_compiled_once_and_that_is_no_part_of_what_waits_for_them(
    tmp_path: Path, made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    solids = Toolbox._solvable
    kernel = njit(lambda x: 2 * x)

    def with_a_kernel(*arguments: Any) -> Any:
        kernel(1.0)
        return solids(*arguments)

    tools = toolbox(made)
    solved(tools)
    monkeypatch.setattr(Toolbox, "_solvable", with_a_kernel)
    told: list[str] = []
    first, second = (solve_frame(tools, "7/0", tmp_path, lambda: told.append("compiling")).end for _ in range(2))
    assert told == ["compiling"]
    assert first.stages_ms["compile"] > 10
    assert second.stages_ms.keys() == {"prepare", "read", "record", "start", "iterate", "summarise"}


@pytest.mark.parametrize("what", ["mask", "model"])
def test_an_object_whose_mask_or_model_is_gone_is_a_row_and_a_miss(made: Made, what: str) -> None:
    files = {"mask": made.scene / "mask_visib/000000_000001.png", "model": made.root / "models/obj_000005.ply"}
    files[what].unlink()
    result = solved(toolbox(made, off_mm=60.0), explain_frame)
    assert not result.failed
    assert [row.status for row in result.answers] == ["ok", "ok", "left_out"]
    row = result.answers[-1]
    assert (row.instance_id, row.obj_id, row.has_truth, row.visib_fract) == (1, 5, True, 0.6)
    assert {"mask": "000000_000001.png", "model": "5"}[what] in row.message
    assert row.cause == ""
    assert [row.T_cam_obj is None for row in result.answers] == [False, False, True]


def test_a_frame_that_cannot_be_read_is_a_row(tmp_path: Path, made: Made) -> None:
    depth_file(made, 0).unlink()
    result = solved(toolbox(made, "all"))
    assert result.failed
    (row,) = result.answers
    assert (row.scene_id, row.im_id, row.status) == (7, 0, "failed")
    assert "depth" in row.message
    assert not (tmp_path / "errors").exists()


@pytest.mark.usefixtures("processes")
def test_a_record_names_the_weights_of_its_refiner_whatever_came_of_it(tmp_path: Path, made: Made) -> None:
    session = toolbox(made, keep="all").session
    tools = Toolbox(structs.replace(session, method=structs.replace(session.method, refiner="depth_net")))
    weights = weights_of(tools.session)
    assert [*weights] == ["depth_net weights"]
    record = solve_frame(tools, "7/0", tmp_path)
    assert not record.end.failed
    (recording,) = (tmp_path / "recordings").glob("*")
    for header in (record.header, Runs(tmp_path / "runs").entry("7/0").header, read_recording(recording).header):
        assert header.versions.items() >= weights.items()
    depth_file(made, 0).unlink()
    failed = solve_frame(Toolbox(tools.session), "7/0", tmp_path)
    assert failed.end.failed
    assert failed.header.versions.items() >= weights.items()


def test_causes_are_asked_for_where_the_answer_is_wrong(made: Made) -> None:
    assert {row.cause for row in solved(toolbox(made), explain_frame).answers} == {""}
    far = toolbox(made, off_mm=60.0)
    asked = solved(far, explain_frame)
    for row in asked.answers:
        assert row.cause in set(Cause)
        assert row.evidence
    plain = solved(far)
    assert {row.cause for row in plain.answers} == {""}
    for one, other in zip(asked.answers, plain.answers, strict=True):
        assert one.T_cam_obj.tobytes() == other.T_cam_obj.tobytes()
    assert asked.stages_ms["explain"] > 0
    assert set(asked.stages_ms) <= set(STAGES)


def test_an_error_that_nobody_foresaw_leaves_its_traceback_and_in_a_diagnosis_costs_no_answer(
    tmp_path: Path, made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("division by zero")

    tools, log = toolbox(made, off_mm=60.0), tmp_path / "errors" / "000007_000000.txt"
    monkeypatch.setattr(causes, "diagnose", broken)
    result = solved(tools, explain_frame)
    assert not result.failed
    assert all("errors/000007_000000.txt" in row.evidence for row in result.answers)
    log.unlink()
    shutil.rmtree(tmp_path / "runs")
    monkeypatch.setattr(tools, "problem", broken)
    (row,) = solved(tools).answers
    assert "ZeroDivisionError" in row.message
    assert "Traceback" in log.read_text()


@pytest.mark.usefixtures("long_run")
def test_answers_causes_and_grasps_are_verified(tmp_path: Path, made: Made) -> None:
    tools = toolbox(made, off_mm=60.0)
    tools = Toolbox(structs.replace(tools.session, grasp=structs.replace(tools.session.grasp, answers=True)))
    path = Runs(tmp_path / "runs").path("7/0")
    for task in (solve_frame, explain_frame):
        task(tools, "7/0", tmp_path)
        assert verify(path, None, end_again).difference is None
    record = read_run_file(path)
    assert record.end is not None
    write_first_format(path, record)
    assert verify(path, None, end_again).difference is None
    first, *others = record.end.answers
    assert first.grasp
    assert first.cause
    others_than_made = {"add_s_mm": 1.0, "findings": (), "doubts": ("so",), "grasp": "success", "best_hypothesis": None}
    for name, value in others_than_made.items():
        end = structs.replace(record.end, answers=(structs.replace(first, **{name: value}), *others))
        write_record(path, structs.replace(record, end=end))
        found = verify(path, None, end_again).difference
        assert (found or "").startswith(f"the answers: answers[0].{name}: "), (name, found)


def test_a_pool_without_hypotheses_is_no_failure(tmp_path: Path, made: Made) -> None:
    made.edit("scene_gt.json", lambda gt: gt["0"].pop())
    csv = tmp_path / "r.csv"
    csv.write_text("7,0,5,0.9,1 0 0 0 1 0 0 0 1,0 80 600,-1\n")
    session = write_session(tmp_path, made, hypotheses={"source": "results", "files": [str(csv)]})
    result = solved(Toolbox(load_session(session)))
    assert not result.failed
    assert {row.status for row in result.answers} == {"no_answer", "ok"}
    assert sum(row.T_cam_obj is not None for row in result.answers) == 1


def test_a_row_has_what_the_page_shows_of_the_score_around_the_answer(made: Made) -> None:
    tools = toolbox(made, off_mm=3.0)
    result = solved(tools)
    page = Toolbox(tools.session)
    problem = page.problem("7/0")
    run = page.run(problem)
    best = run.finish().best
    iterations = run.iterations
    for row, target, answer in zip(result.answers, problem.targets, best, strict=True):
        allowed = allowed_poses(page.verifier, target, answer.T_cam_obj, (), iterations)
        assert row.undetermined_mm == allowed.undetermined_mm > 0
        assert row.undetermined_deg == allowed.undetermined_deg > 0
        assert row.n_alike == len(allowed.alike)


def test_a_frame_is_finished_only_once_its_recording_is(
    tmp_path: Path, made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    close = Recorder.close

    def refused(recorder: Recorder, run: bytes | None = None) -> None:
        close(recorder)
        raise InputError("cannot write the recording: No space left on device")

    monkeypatch.setattr(Recorder, "close", refused)
    end = solved(toolbox(made, "all"))
    assert end.failed
    assert Runs(tmp_path / "runs").path("7/0").exists()
    assert Runs(tmp_path / "runs").entry("7/0") is None


# What is noted


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("pose", [transform(np.eye(3), [0.0, 0.0, 0.4]), np.diag([1.0, 1.0, 2.0, 1.0])])
def test_a_file_that_holds_no_grasps_of_an_object_is_noted_and_the_answer_stays(
    tmp_path: Path, made: Made, pose: Float
) -> None:
    np.save(tmp_path / "obj_000005.npy", pose[None])
    session = toolbox(made).session
    grasp = structs.replace(session.grasp, answers=True, folder=str(tmp_path))
    result = solved(Toolbox(structs.replace(session, grasp=grasp)))
    assert {row.status for row in result.answers} == {"ok"}
    assert {row.grasp for row in result.answers if row.obj_id == 5} == {""}
    assert any(note.startswith("no grasp of ") for note in result.notes)
    assert not any("\n" in note for note in result.notes)


def clutter(folder: Path, method: MethodSettings, hypotheses: HypothesesSettings, **wrong: float) -> Session:
    """A session on a built-in scene that was written with a wrong camera or depth."""
    dataset = written(folder / "clutter", [scene()], **wrong)
    settings = SceneSettings(source="bop", dataset=str(dataset))
    return Session(scene=settings, hypotheses=hypotheses, method=method, recording=RecordingSettings(keep="none"))


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(
    ("focal", "translation_mm", "noted"), [(1.0, 60.0, False), (0.75, 60.0, True), (0.75, 0.0, False)]
)
def test_a_wrong_focal_length_is_noted_where_answers_are_wrong(
    tmp_path: Path, focal: float, translation_mm: float, noted: bool
) -> None:
    unmoved = MethodSettings(name="refine", refiner="identity", iterations=1)
    disturbed = HypothesesSettings(max_per_object=1, rotation_deg=0.0, translation_mm=translation_mm)
    result = explain_frame(Toolbox(clutter(tmp_path, unmoved, disturbed, focal=focal)), "0/0", tmp_path).end
    assert any(row.cause for row in result.answers) == (translation_mm > 0)
    assert any("fx and fy of cam_K look too small" in doubt for doubt in result.doubts) == noted


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("depth", "in_doubt"), [(1.0, 0), (0.8, 1)])
def test_without_ground_truth_every_answer_of_the_frame_says_so(tmp_path: Path, depth: float, in_doubt: int) -> None:
    disturbed = HypothesesSettings(max_per_object=2, rotation_deg=15, translation_mm=15)
    session = clutter(tmp_path, MethodSettings(name="rir", iterations=2), disturbed, depth=depth)
    result = explain_frame(WithoutTruth(session), "0/0", tmp_path).end
    assert len(result.doubts) == in_doubt
    assert all(row.evidence.startswith(DATA_FIRST) == bool(in_doubt) for row in result.answers)
    totals = Totals()
    # A batch that goes on later still knows.
    (record,) = totals.passing(Runs(tmp_path / "runs").records(["0/0"]))
    assert record.end.doubts == result.doubts
    said = totals.as_json(1)["data_in_doubt"]
    assert said.startswith(f"{DATA_FIRST} in frame 0/0, ") == bool(in_doubt)
    index = BatchIndex(tmp_path, session, BatchInfo(), record.end.answers)
    assert Gallery([index]).doubt.startswith(DATA_FIRST) == bool(in_doubt)
