"""``doctor`` and what it knows by heart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from verefine_viz import cli
from verefine_viz.commands import doctor_checks as checks
from verefine_viz.commands.doctor_checks import Check
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import Scores
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import gl_problem
from verefine_viz.rendering.gl_verifier import GlVerifier


def test_this_machine_computes_what_is_expected() -> None:
    for check in (
        checks.renderer_self_check, checks.score_self_check, checks.simulator_self_check, checks.packages,
    ):  # fmt: skip
        row = checks.run(check)
        assert row.ok, row.result
        assert row.needed
    # The fall is the sum of the substeps; semi-implicit Euler: velocity first, then position.
    velocity, fallen, dt = 0.0, 0.0, 1 / 240
    for _ in range(12):
        velocity += 9.81 * dt
        fallen += velocity * dt
    assert pytest.approx(1e3 * fallen, abs=0.01) == checks.FALL_MM


@pytest.mark.parametrize("wrong", [CpuVerifier, GlVerifier])
def test_a_renderer_whose_scores_are_a_little_off_fails(wrong: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    if wrong is GlVerifier and (problem := gl_problem()):
        pytest.skip(problem)
    score = wrong.score

    def off(verifier: Any, target: Target, Ts_cam_obj: np.ndarray) -> Scores:
        found = score(verifier, target, Ts_cam_obj)
        return replace(found, score=found.score * [1, 1.01])

    monkeypatch.setattr(wrong, "score", off)
    row = checks.run(checks.score_self_check)
    assert not row.ok
    assert f"{'CPU' if wrong is CpuVerifier else 'OpenGL'} 1.0000 and 0.7142" in row.result


def rows(monkeypatch: pytest.MonkeyPatch, *made: Check) -> int:
    monkeypatch.setattr(checks, "all_checks", lambda: [lambda row=row: row for row in made])
    return cli.main(["doctor"])


def test_what_is_needed_and_fails_decides(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    good, missing = Check("Bullet", "found"), Check("Chromium", "not found", False, needed=False, advice="get it")
    assert rows(monkeypatch, good, missing) == 0
    capsys.readouterr()
    assert rows(monkeypatch, good, Check("renderer", "[red]off", False, advice="mend it")) == 1
    out = capsys.readouterr().out
    assert all(words in out for words in ("renderer", "mend it", "[red]off"))


def test_a_check_that_raises_is_a_failed_row_and_so_is_a_folder_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def gpu_lottery() -> Check:
        raise OSError("libGL.so.1: cannot open\nshared object file")

    row = checks.run(gpu_lottery)
    assert not row.ok
    assert (row.name, row.result) == ("gpu lottery", "OSError: libGL.so.1: cannot open shared object file")
    monkeypatch.setattr(Path, "cwd", lambda: Path("/proc"))
    row = checks.working_folder()
    assert not row.ok
    assert "/proc" in row.advice
