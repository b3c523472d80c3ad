"""``view DIR``: the answers of one batch run or of several, and the settings that win over theirs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.made_runs import answer, finished
from verefine_viz.batch.folder import RunFolder
from verefine_viz.cli import main
from verefine_viz.page import app as page_app
from verefine_viz.page.gallery import Gallery
from verefine_viz.run.session_file import resolve


def batch_run(folder: Path, method: str, errors_mm: tuple[float, ...], status: str = "finished") -> None:
    """A run over frames 0/0, 0/1, … with one object each."""
    folder.mkdir()
    run = RunFolder(folder, resolve({"method": {"name": method}, "scene": {"demo": "clutter"}}))
    for k, error_mm in enumerate(errors_mm):
        row = answer(0, k, instance_id=0, obj_id=1, add_s_mm=error_mm, diameter_mm=100.0)
        run.runs.save(run.session, finished(f"0/{k}", [row]))
    run.write_json("run.json", {"status": status})
    run.close()


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the page would be opened with."""
    asked: dict[str, Any] = {}
    monkeypatch.setattr(page_app, "serve", lambda session, **given: asked.update(given, session=session))
    return asked


def test_of_one_run_the_worst_frame_comes_first(tmp_path: Path, served: dict[str, Any]) -> None:
    batch_run(tmp_path / "rir", "rir", (5.0, 40.0, 1.0))
    assert main(["view", str(tmp_path / "rir")]) == 0
    assert served["session"].scene.frames == ("0/1", "0/0", "0/2")
    assert served["session_path"] is None
    assert isinstance(served["gallery"], Gallery)
    assert served["gallery"].worst.row.im_id == 1


def test_of_several_runs_the_session_of_the_worst_is_opened_with_the_settings_given(
    tmp_path: Path, served: dict[str, Any]
) -> None:
    batch_run(tmp_path / "rir", "rir", (5.0, 40.0))
    batch_run(tmp_path / "sir", "sir", (70.0, 2.0), "running")
    assert main(["view", str(tmp_path), "--method.exploration", "0.2"]) == 0
    assert served["session"].method.name == "sir"
    assert served["session"].method.exploration == 0.2
    assert served["session"].scene.frames == ("0/0", "0/1")
    assert served["gallery"].session("rir").method.exploration == 0.2


def test_runs_that_are_left_out_are_reported(
    tmp_path: Path, served: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    batch_run(tmp_path / "rir", "rir", (5.0, 40.0))
    (tmp_path / "old").mkdir()
    batch_run(tmp_path / "old" / "sir", "sir", (5.0, 40.0))
    assert main(["view", str(tmp_path)]) == 0
    assert len(served["gallery"].runs) == 1
    assert str(tmp_path / "old") in capsys.readouterr().err
