"""Answers and records written down without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from verefine_viz.batch.runs import Runs
from verefine_viz.core.settings import Session
from verefine_viz.run.record import FORMAT, Answer, RunEnd, RunHeader, RunRecord


def answer(scene_id: int = 1, im_id: int = 0, **values: Any) -> Answer:
    """An answer in that image; solved unless ``values`` say otherwise."""
    return Answer(**{"frame": f"{scene_id}/{im_id}", "status": "ok", **values})


def finished(frame: str, answers: Sequence[Answer], **end: Any) -> RunRecord:
    """The record of a frame with these answers, without iterations."""
    header = RunHeader(FORMAT, "", frame, "", {}, ())
    return RunRecord(header, (), RunEnd(answers=tuple(answers), **end))


def written(folder: Path, record: RunRecord) -> RunRecord:
    """The record, written into ``runs/`` of a batch folder."""
    Runs(folder / "runs").save(Session(), record)
    return record
