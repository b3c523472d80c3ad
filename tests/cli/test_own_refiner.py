"""What was made with a refiner of a user's own program, in a program that does not have it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.made_runs import answer, finished
from tests.received import received
from verefine_viz import cli
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.summary import run_end
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.refiner_steps import RefinerStep, TrainedRange
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.page import app as page_app
from verefine_viz.page.protocol import CropsWanted, RunVerb, Step
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.crops import crops
from verefine_viz.page.views.verdict import verdict_message
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording import entities, rerun_viewer
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.refiners.registry import REFINERS, Identity
from verefine_viz.run.run_file import SUFFIX, RunFile
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")
MADE_BY = {"name": "refine", "refiner": "own", "iterations": 2}
SETTINGS = {
    "method": MADE_BY,
    "physics": {"enabled": False},
    "hypotheses": {"max_per_object": 1},
    "recording": {"maps": False},
}


class Own:
    """Moves away from the camera, millimetre by millimetre; says what it saw, and counts how often it is asked."""

    trained_range = TrainedRange(rotation_deg=5, shift_radii=0.1)

    def __init__(self) -> None:
        self.n_asked = 0

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T_refined = T_cam_obj.copy()
        T_refined[2, 3] += 1e-3
        return T_refined

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        self.n_asked += 1
        return [RefinerStep({"depth": target.observation.depth_m}, shift_m=np.array([0, 0, 1e-3]))]


class Jump:
    """Right where it is within its range, else it stays."""

    trained_range = TrainedRange(rotation_deg=20, shift_radii=2.0)

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T_gt = target.instance.T_cam_obj_gt
        return T_gt if angle_between(T_cam_obj[:3, :3], T_gt[:3, :3]) < np.deg2rad(20) else T_cam_obj


def make_recording(path: Path, session: Session) -> None:
    toolbox = Toolbox(session)
    problem = toolbox.problem(toolbox.frames[0])
    recorder = Recorder(path, session, problem, toolbox.verifier_of, refiner_of=toolbox.refiner_of)
    file = RunFile(path.with_suffix(SUFFIX), session)
    run = toolbox.run(problem, [file, recorder])
    run.finish()
    file.finish(run_end(run, session))
    recorder.close(file.path.read_bytes())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with the refiner "own", which is not there any more."""
    path = tmp_path_factory.mktemp("own") / "run.rrd"
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(REFINERS, "own", lambda session: Own())
        make_recording(path, resolve(SETTINGS))
    return path


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the page would be opened with."""
    asked: dict[str, Any] = {}
    monkeypatch.setattr(page_app, "serve", lambda session, **given: asked.update(given, session=session))
    return asked


def refused(words: list[object], capsys: pytest.CaptureFixture[str]) -> None:
    """Asserts that one line advises to give these words to the program that has the refiner."""
    assert cli.main([*map(str, words)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'own'" in line
    assert line.endswith(f"python PROGRAM.py {' '.join(map(str, words))}")


def test_a_recording_is_verified_by_the_program_that_has_the_refiner(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["replay", str(recording), "--verify"]
    refused([*words], capsys)
    monkeypatch.setitem(REFINERS, "own", lambda session: Own())
    assert cli.main(words) == 0
    assert "2 iterations" in capsys.readouterr().out
    monkeypatch.setitem(REFINERS, "own", lambda session: Identity())
    assert cli.main(words) == 1


def test_one_that_came_into_use_on_the_way_is_missed_too_and_a_search_has_one_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change = {"after_iteration": 1, "settings": {"method": {"refiner": "own"}}}
    with monkeypatch.context() as patched:
        patched.setitem(REFINERS, "own", lambda session: Own())
        session = resolve(SETTINGS | {"method": MADE_BY | {"refiner": "identity"}, "changes": [change]})
        make_recording(tmp_path / "run.rrd", session)
    refused(["replay", tmp_path / "run.rrd", "--verify"], capsys)
    session = resolve(SETTINGS | {"method": MADE_BY | {"name": "physim_mcts"}, "mcts": {"expansions": 2}})
    make_recording(tmp_path / "search.rrd", session)
    assert cli.main(["replay", str(tmp_path / "search.rrd"), "--verify"]) == 0


@pytest.mark.parametrize("display", [False, True])
def test_the_rerun_viewer_opens_it_and_one_line_says_where(
    display: bool, recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[list[str]] = []
    viewer = SimpleNamespace(wait=lambda: 0, terminate=lambda: None)
    monkeypatch.setattr(rerun_viewer, "has_display", lambda: display)
    monkeypatch.setattr(rerun_viewer, "start_viewer", lambda arguments, env: opened.append(arguments) or viewer)
    assert cli.main(["replay", str(recording)]) == 0
    ((file, *options),) = opened
    assert file == str(recording)
    line = capsys.readouterr().out
    if display:
        assert options == []
    else:
        ports = dict(zip(options[1::2], options[2::2], strict=True))
        page, data = ports["--web-viewer-port"], ports["--port"]
        assert f"http://127.0.0.1:{page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy" in line


def test_the_page_opens_a_recording(recording: Path, served: dict[str, Any]) -> None:
    assert cli.main(["view", str(recording)]) == 0
    page_app.check(served["session"])
    assert served["recording"] == recording
    branch = Workspace(served["session"], None, Toolbox, recording=recording).work.first
    assert branch.run.length == 2
    assert branch.settings.method.refiner == "own"


def test_a_batch_is_opened_through_the_program_that_has_it(
    tmp_path: Path, served: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    run = RunFolder(tmp_path / "runs", resolve(SETTINGS))
    run.runs.save(run.session, finished("0/0", [answer(0, 0, instance_id=0, obj_id=1)]))
    run.write_json("run.json", {"status": "finished"})
    run.close()
    refused(["view", tmp_path / "runs"], capsys)
    assert served == {}
    # Another refiner may take its place.
    assert cli.main(["view", str(tmp_path / "runs"), "--method.refiner", "icp"]) == 0


def test_recordings_have_what_it_saw_and_where_it_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REFINERS, "own", lambda session: Own())
    make_recording(tmp_path / "run.rrd", resolve(SETTINGS | {"recording": {"maps": True}}))
    chunks: list[Any] = [c for c in chunks_of(tmp_path / "run.rrd") if c.entity_path == entities.REFINER_WORDS]
    words = [row[0] for c in chunks for row in c.to_record_batch().column("TextDocument:text").to_pylist()]
    assert len(words) == 2
    for text in words:
        assert all(number in text for number in ("30°", "5°", "1.0 mm"))


def test_the_page_asks_it_only_where_its_crops_are_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    own = Own()
    monkeypatch.setitem(REFINERS, "own", lambda session: own)
    debugger = Debugger(Workspace(resolve(SETTINGS), None, Toolbox)).carry_out([Step()])
    assert own.n_asked == 0
    answer = received(crops(debugger.space, CropsWanted(1), debugger.blobs))
    assert own.n_asked == 1
    assert len(answer["steps"]) == 1
    assert "out of range" in str(answer)


@pytest.mark.parametrize("start_deg", [15, 30])
def test_the_diagnosis_knows_its_range(start_deg: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REFINERS, "own", lambda session: Jump())
    start = {"max_per_object": 2, "rotation_deg": start_deg, "translation_mm": 60}
    toolbox = Toolbox(resolve(SETTINGS | {"hypotheses": start}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    found = diagnose(run, toolbox)
    if start_deg < 20:
        assert found == ()
        return
    (diagnosis,) = found
    assert (diagnosis.main.cause, diagnosis.main.is_confirmed) == (Cause.OUT_OF_RANGE, True)
    assert diagnosis.main.numbers["nearest_rotation_deg"] == pytest.approx(30)
    assert diagnosis.main.numbers["hypotheses"] == 1, "refine works on the first alone"
    assert diagnosis.main.numbers["error_repaired"] < 0.01


def test_the_page_names_its_range_without_a_re_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(REFINERS, "own", lambda session: Jump())
    start = {"max_per_object": 1, "rotation_deg": 120, "translation_mm": 20}
    debugger = Debugger(Workspace(resolve(SETTINGS | {"hypotheses": start}), None, Toolbox)).carry_out([RunVerb()])
    (shown,) = received(verdict_message(debugger.space.work.first))["objects"]
    assert "120°" in shown["words"]
    assert [one for one in shown["findings"] if one["cause"] == Cause.OUT_OF_RANGE]
