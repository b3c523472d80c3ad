"""Studies: the same for any number of workers, go on where they stopped, refuse what is not theirs."""

from __future__ import annotations

import csv
import errno
import itertools
import json
import random
import signal
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from multiprocessing import active_children
from multiprocessing.process import BaseProcess
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest
from msgspec import structs

from tests.batch.frames import PoolHere, command
from tests.batch.killed_batches import killed_until_done
from verefine_viz import cli
from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.studies import run_study as run_study_module
from verefine_viz.studies import unit_work
from verefine_viz.studies.run_study import run_study, saved_outcome
from verefine_viz.studies.solve_unit import Solver, UnitAnswer
from verefine_viz.studies.study_command import run_one
from verefine_viz.studies.study_folder import STUDY_FILE, StudyFolder
from verefine_viz.studies.study_plan import Panel, Unit
from verefine_viz.studies.study_request import STUDIES, StudyRequest

SMALL = {"scene": {"demo": "duck", "model_points": 200, "cloud_points": 200}, "preset": "published"}
ROBUSTNESS = StudyRequest("robustness", quick=True)


def _sessions() -> dict[str, Session]:
    return {"duck": load_session(None, SMALL)}


def _run(path: Path, workers: int = 1, announce: Callable[[str], None] = lambda text: None) -> tuple[UnitAnswer, ...]:
    """The answers of a study; where one worker is asked for, by this process."""
    with pytest.MonkeyPatch.context() as patched:
        if workers == 1:
            patched.setattr(run_study_module, "Pool", PoolHere)
        outcome = run_study(ROBUSTNESS, _sessions(), 1, workers, path, lambda done, total: None, announce)
    assert outcome.failures == ()
    return outcome.answers


def _facts(answers: Iterable[UnitAnswer]) -> list[object]:
    """All but times."""
    return [msgspec.to_builtins(structs.replace(o, ms=0.0), enc_hook=np.ndarray.tolist) for o in answers]


def _entries(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("*seed*.json")}


@pytest.fixture(scope="module")
def alone(processes: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[UnitAnswer, ...]]:
    """The folder and the answers of a study by one worker."""
    path = tmp_path_factory.mktemp("study") / "alone"
    return path, _run(path)


def test_any_number_of_workers_gives_the_same_and_a_damaged_folder_goes_on(
    alone: tuple[Path, tuple[UnitAnswer, ...]], tmp_path: Path
) -> None:
    path, outcomes = alone
    assert _facts(_run(tmp_path / "b", workers=2)) == _facts(outcomes)
    entries = _entries(path)
    assert entries.keys() == _entries(tmp_path / "b").keys()
    missing, damaged, *others = sorted(entries)
    (path / missing).unlink()
    (path / damaged).write_bytes(entries[damaged][:100])
    announced: list[str] = []
    assert _facts(_run(path, announce=announced.append)) == _facts(outcomes)
    assert len(announced) == 1
    again = _entries(path)
    assert again.keys() == entries.keys()
    assert {name: again[name] for name in others} == {name: entries[name] for name in others}


def test_every_curve_of_the_robustness_study_has_as_many_calls(alone: tuple[Path, tuple[UnitAnswer, ...]]) -> None:
    assert {o.curve for o in alone[1]} >= {"ICP", "SIR", "RIR, 5 hypotheses"}
    assert {o.refiner_calls for o in alone[1]} == {50.0}


def test_ctrl_c_ends_workers_in_the_middle_of_a_unit_and_keeps_what_is_done(
    alone: tuple[Path, tuple[UnitAnswer, ...]], tmp_path: Path
) -> None:
    workers: list[BaseProcess] = []

    def interrupted(done: int, total: int) -> None:
        if done:
            workers.extend(active_children())
            raise KeyboardInterrupt

    path = tmp_path / "x"
    before = set(threading.enumerate())
    with pytest.raises(KeyboardInterrupt):
        run_study(ROBUSTNESS, _sessions(), 1, 2, path, interrupted)
    assert set(threading.enumerate()) <= before
    assert {worker.exitcode for worker in workers} == {-signal.SIGKILL}
    assert len(workers) == 2
    done = _entries(path)
    assert done
    assert _facts(_run(path)) == _facts(alone[1])
    assert {name: _entries(path)[name] for name in done} == done


@pytest.mark.usefixtures("processes")
def test_kills_at_random_moments_change_nothing(alone: tuple[Path, tuple[UnitAnswer, ...]], tmp_path: Path) -> None:
    session = tmp_path / "duck.toml"
    save_session(_sessions()["duck"], session)
    out = tmp_path / "out"
    journal = out / "robustness.journal"
    words = ("study", "robustness", "--session", session, "--out", out, "--quick", "--seeds", 1, "--workers", 2)
    killed_until_done(command(*words), lambda: len(_entries(journal)), 2, random.Random(0))
    assert len(_entries(journal)) == 8
    assert _facts(saved_outcome(ROBUSTNESS, _sessions(), 1, journal).answers) == _facts(alone[1])
    assert not list(out.rglob("*.part"))


class FailingSolver(Solver):
    """Cannot solve units of one panel, and one of the other."""

    def solve(self, unit: Unit) -> tuple[UnitAnswer, ...]:
        if unit.panel == "material":
            raise InputError("no plane")
        if unit.x == 0.6:
            raise RuntimeError("unforeseen")
        return super().solve(unit)


def test_units_that_fail_are_named_and_the_others_go_on(
    alone: tuple[Path, tuple[UnitAnswer, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    session, out = tmp_path / "duck.toml", tmp_path / "out"
    save_session(_sessions()["duck"], session)
    words = ("study", "robustness", "--session", session, "--out", out, "--quick", "--seeds", 1, "--workers", 1)
    monkeypatch.setattr(run_study_module, "Pool", PoolHere)
    with monkeypatch.context() as patched:
        patched.setattr(unit_work, "Solver", FailingSolver)
        assert cli.main([*map(str, words)]) == 1
    lines = capsys.readouterr().err.splitlines()
    log = "duck 000000_000000, occlusion, 0.6, seed 0.txt"
    assert "5 of 8" in lines[-1]
    for line, x in zip(lines[-6:-2], ("0", "0.3", "0.6", "0.9"), strict=True):
        assert line.startswith(f"duck 000000_000000, material, {x}, seed 0: ")
    assert log in lines[-2]
    assert "unforeseen" in (out / "robustness.journal" / "errors" / log).read_text()
    assert "without 5 of 8 runs, which failed" in (out / "robustness.svg").read_text()
    done = _entries(out / "robustness.journal")
    assert len(done) == 3
    assert cli.main([*map(str, words)]) == 0
    again = _entries(out / "robustness.journal")
    assert len(again) == 8
    assert {name: again[name] for name in done} == done
    rows = list(csv.DictReader((out / "robustness_objects.csv").read_text().splitlines()))
    assert [(r["panel"], float(r["x"]), r["curve"], float(r["ar_vsd"])) for r in rows] == [
        (o.panel, o.x, o.curve, o.answer.ar_vsd) for o in alone[1]
    ]


def test_a_study_whose_first_unit_fails_ends_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(self: Solver, unit: Unit) -> tuple[UnitAnswer, ...]:
        raise InputError(f"nothing at {unit.x:g}")

    monkeypatch.setattr(Solver, "solve", refuse)
    monkeypatch.setattr(run_study_module, "Pool", PoolHere)
    words = f"study robustness --out {tmp_path / 'out'} --quick --seeds 1 --workers 1 --scene.demo duck"
    assert cli.main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "nothing at 0" in line


def test_a_folder_of_another_study_or_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    theirs, path = tmp_path / "theirs.txt", tmp_path / "x"
    theirs.write_text("years of work in one line")
    for folder in (tmp_path, theirs):
        with pytest.raises(InputError, match=r"theirs\.txt"):
            StudyFolder(folder, {"study": 1})
    assert [*tmp_path.iterdir()] == [theirs]
    path.mkdir()
    for content, said in (("not json\n", r"study\.json"), (json.dumps({"study": {"name": "ablation"}}), "settings")):
        (path / STUDY_FILE).write_text(content)
        with pytest.raises(InputError, match=said):
            _run(path)


def test_a_folder_is_written_by_one_study_at_a_time_and_one_that_was_killed_at_its_start_goes_on(
    tmp_path: Path,
) -> None:
    (tmp_path / ".lock").touch()
    (tmp_path / f"{STUDY_FILE}.999999999-1.part").write_text('{"wan')
    first = StudyFolder(tmp_path, {"study": 1})
    with pytest.raises(UnavailableError, match=tmp_path.name):
        StudyFolder(tmp_path, {"study": 1})
    first.close()
    StudyFolder(tmp_path, {"study": 1}).close()
    assert json.loads((tmp_path / STUDY_FILE).read_text()) == {"study": 1}
    assert not list(tmp_path.glob("*.part"))


def test_a_folder_that_the_disk_refuses_is_closed_and_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, pytest.raises(InputError, match=r"study\.json"):
        patched.setattr(Path, "write_text", full)
        StudyFolder(tmp_path, {})
    assert [file.name for file in tmp_path.iterdir()] == [".lock"]
    assert str(tmp_path / ".lock") not in [file.path for file in psutil.Process().open_files()]


@pytest.mark.usefixtures("processes")
def test_tables_of_a_session_with_equal_calls_and_a_refiner_without_weights(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "duck.toml"
    scene = 'demo = "duck"\nmodel_points = 200\ncloud_points = 200\n'
    session.write_text(f"[scene]\n{scene}[densefusion]\nclasses = [99]\n[mcts]\nexpansions = 2\n")
    assert run_one("tables", session, tmp_path / "out", {}, quick=True, seeds=1) == 0
    out = tmp_path / "out"
    for suffix, head in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")):
        assert (out / f"tables{suffix}").read_bytes().startswith(head)
    assert "quick run" in (out / "tables.svg").read_text()
    rows = {(r["panel"], r["curve"]): r for r in csv.DictReader((out / "tables.csv").read_text().splitlines())}
    assert [curve for panel, curve in rows if panel == "ICP"][:3] == ["ICP, 50", "PIR, 50", "SIR, 50"]
    assert all(0 <= float(r["ar"]) <= 1 for r in rows.values())
    calls = {key: float(r["refiner_calls_per_object"]) for key, r in rows.items()}
    assert calls["ICP", "ICP, 50"] == calls["ICP", "SIR, 50"] == 50
    assert calls["ICP", "RIR, 150"] == calls["ICP", "ICP, 150"] == 150
    assert calls["TrICP", "VF_d, 50"] == 50
    # The tree of one object has no more than its 25 hypotheses and one that is refined before.
    assert calls["TrICP", "PHYSIM-MCTS"] == calls["TrICP", "PHYSIM-MCTS, 50"] == 27
    assert not any(panel == "DF-R" for panel, _ in rows)
    assert "| DF-R, 2 | – | – | – | – | – | – |" in (out / "tables.md").read_text()
    assert r"\bottomrule" in (out / "tables.tex").read_text()
    assert "PHYSIM-MCTS, 50" in capsys.readouterr().out
    assert not list(out.glob("*.part"))


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        ("ablation", "method.iterations", "2"),
        ("ablation", "hypotheses.source", "ppf"),
        ("ablation", "physics.support", "observed"),
        ("robustness", "icp.max-iterations", "3"),
        ("tables", "physics.steps", "7"),
        ("tables", "mcts.seconds", "1"),
        ("grasping", "hypotheses.rotation-deg", "10"),
    ],
)
def test_an_option_that_a_study_sets_itself_is_refused_by_name(
    name: str, option: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", name, "--out", str(tmp_path / "out"), "--method.refiner", "icp", f"--{option}", value]
    assert cli.main(words) == 2
    assert option.replace("-", "_") in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


class StoppedSolver(Solver):
    """Answers at once; Ctrl-C is typed while it is at the fourth unit."""

    def __init__(self, sessions: Mapping[str, Session], panels: Sequence[Panel], progress: ProgressToken) -> None:
        self._curves = {panel.name: panel.curves for panel in panels}
        self._n = 0

    def solve(self, unit: Unit) -> tuple[UnitAnswer, ...]:
        self._n += 1
        if self._n == 4:
            raise KeyboardInterrupt
        return tuple(
            UnitAnswer(
                panel=unit.panel, x=unit.x, scene=unit.scene, curve=curve.label, ms=1.0, refiner_calls=1.0,
                grasp="success" if study_is_grasped(unit) else "",
                answer=Answer(
                    frame=unit.frame, seed=unit.seed, instance_id=0, obj_id=1, name="duck", status="ok", ar=1.0,
                    ar_vsd=1.0, ar_mssd=1.0, ar_mspd=1.0, add_s_mm=1.0, diameter_mm=100.0,
                ),
            )
            for curve in self._curves[unit.panel]
        )  # fmt: skip


def study_is_grasped(unit: Unit) -> bool:
    return any(unit.panel == panel.name for panel in StudyRequest("grasping").study().panels)


@pytest.mark.parametrize("name", STUDIES)
def test_a_stopped_study_writes_what_it_has(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(unit_work, "Solver", StoppedSolver)
    monkeypatch.setattr(run_study_module, "Pool", PoolHere)
    session = tmp_path / "duck.toml"
    session.write_text('[scene]\ndemo = "duck"\n[method]\nrefiner = "icp"\n')
    out = tmp_path / "out"
    words = f"study {name} --session {session} --out {out} --seeds 40 --workers 1"
    assert cli.main(words.split()) == 128 + signal.SIGINT
    objects = list(csv.DictReader((out / f"{name}_objects.csv").read_text().splitlines()))
    assert len({(r["panel"], r["x"], r["seed"], r["scene"]) for r in objects}) == 3
    rows = list(csv.DictReader((out / f"{name}.csv").read_text().splitlines()))
    assert {(r["panel"], float(r["x"])) for r in rows} == {(r["panel"], float(r["x"])) for r in objects}
    assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    n_all, said = 40 * n_points(name), capsys.readouterr()
    line, last = said.err.splitlines()
    assert (f"3 of {n_all}" in line, last) == (True, "stopped")
    assert f"stopped after 3 of {n_all} runs" in (out / f"{name}.svg").read_text()
    assert f"{name}.csv" in said.out


def n_points(name: str) -> int:
    """Runs of a study for each scene and seed."""
    scenes = 2 if name == "grasping" else 1
    return scenes * sum(len(panel.xs) for panel in StudyRequest(name).study().panels)


def test_claims_are_about_curves_of_their_panel() -> None:
    for name, quick in itertools.product(STUDIES, (False, True)):
        panels = StudyRequest(name, quick).study().panels
        curves = {panel.name: {curve.label for curve in panel.curves} for panel in panels}
        for panel in panels:
            assert len(curves[panel.name]) == len(panel.curves), panel.name
            for claim in panel.claims:
                assert {claim.better, claim.worse} <= curves[panel.name] & curves[claim.than or panel.name], panel.name
            assert panel.xs == tuple(sorted(panel.xs)), panel.name
