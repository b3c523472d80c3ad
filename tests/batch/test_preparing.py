"""What is made once and kept on disk may take a minute: a batch says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.run.kernel_compilation import COMPILING
from verefine_viz.run.record import RunRecord
from verefine_viz.run.session_file import resolve

SESSION = resolve(
    {
        "scene": {"demo": "bowl", "model_points": 300},
        "method": {"name": "refine", "iterations": 1},
        "recording": {"keep": "none"},
    }
)


@pytest.mark.usefixtures("processes")
def test_convex_parts_are_named_by_name_when_they_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    told: list[list[str]] = []
    for start in "ab":
        pool = Pool(FrameWork(SESSION, tmp_path / start), 1)
        try:
            heard = list(pool.solve(["0/0"]))
        finally:
            pool.close()
        assert [result.is_complete for result in heard if isinstance(result, RunRecord)] == [True]
        told.append([words for words in heard if isinstance(words, str) and words != COMPILING])
    assert [words for words in told[0] if "(bowl)" in words and "convex parts" in words] != []
    assert told[1] == []
