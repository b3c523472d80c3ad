"""A worker that has an answer for every frame; stands in for the real one, which takes seconds to start."""

from __future__ import annotations

from multiprocessing import connection
from pathlib import Path

import numpy as np

from tests.made_runs import answer, finished
from verefine_viz.batch.runs import Runs
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run

AXIS = np.array([0.36, 0.48, 0.8])


def answered(session: Session, frame: str, out: Path) -> RunRecord:
    """Some 8.5 kB in the run file, 1.6 kB in frames.csv, 3 kB in results.csv; the same for the same frame."""
    im_id = int(frame.partition("/")[2])
    pose = transform(axis_angle(AXIS, 0.1 + im_id), np.array([0.1, 0.2, 0.7]) / 3)
    rows = [
        answer(7, im_id, instance_id=k, obj_id=5, score=1 / (im_id + k + 1), T_cam_obj=pose, message="long " * 10)
        for k in range(12)
    ]
    record = finished(frame, rows, seconds=0.1)
    try:
        Runs(out / "runs").save(session, record)
    except VerefineError as error:
        return failed_run(session, {}, frame, str(error))
    return record


def work(channel: connection.Connection) -> None:
    """Answers until the channel closes."""
    of = None
    while True:
        try:
            given, frame = channel.recv()
            of = given or of
            if frame is not None:
                channel.send(answered(of.session, frame, of.out))
        except EOFError:
            return
