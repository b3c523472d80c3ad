"""Answers and records written down without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs

from verefine_viz.batch.runs import Runs
from verefine_viz.core.finding import Finding
from verefine_viz.core.settings import Session
from verefine_viz.run import run_file
from verefine_viz.run.record import FORMAT, Answer, RunEnd, RunHeader, RunRecord


def answer(scene_id: int = 1, im_id: int = 0, **values: Any) -> Answer:
    """An answer in that image; solved unless ``values`` say otherwise."""
    return Answer(**{"frame": f"{scene_id}/{im_id}", "status": "ok", **values})


def because(cause: str, text: str = "") -> tuple[Finding, ...]:
    """The findings of an answer that has this cause."""
    return (Finding(cause, text),)


def finished(frame: str, answers: Sequence[Answer], **end: Any) -> RunRecord:
    """The record of a frame with these answers, without iterations."""
    header = RunHeader(FORMAT, "", frame, "", {}, ())
    return RunRecord(header, (), RunEnd(answers=tuple(answers), **end))


def write_first_format(path: Path, record: RunRecord) -> None:
    """Write a run file of format 1: cause and evidence of each answer are strings; no findings, no recalls."""
    assert record.end is not None
    end = msgspec.msgpack.decode(run_file._ENCODER.encode(record.end))
    for fields, answer in zip(end["answers"], record.end.answers, strict=True):
        for later in ("findings", "doubts", "ar", "ar_vsd", "ar_mssd", "ar_mspd"):
            fields.pop(later, None)
        fields |= {"cause": answer.cause, "evidence": answer.evidence}
    header = structs.replace(record.header, format=1)
    entries = [(b"H", header), *((b"I", run_file.thin(one)) for one in record.iterations), (b"E", end)]
    framed = [run_file.framed(kind + run_file._ENCODER.encode(one)) for kind, one in entries]
    path.write_bytes(run_file.MAGIC + b"".join(framed))


def written(folder: Path, record: RunRecord) -> RunRecord:
    """The record, written into ``runs/`` of a batch folder."""
    Runs(folder / "runs").save(Session(), record)
    return record
