"""First poses of one frame, with the session's estimator: what ``verefine-viz estimate`` asks workers for."""

from __future__ import annotations

import time
from pathlib import Path

from verefine_viz.batch.frame import unforeseen
from verefine_viz.batch.rows import Estimate, FrameResult, ObjectRow, failed_frame
from verefine_viz.batch.summary import left_out_row
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.session.toolbox import Toolbox


def estimate_frame(toolbox: Toolbox, frame: str, out: Path) -> FrameResult:
    """All hypotheses of a frame as estimates, with the estimator's confidence as their score."""
    started = time.perf_counter()
    try:
        result = _pools(toolbox.problem(frame), toolbox.session.hypotheses.source)
    except VerefineError as error:
        result = failed_frame(frame, str(error), toolbox.session)
    except Exception as error:
        result = unforeseen(toolbox, frame, out, error)
    return result.model_copy(update={"seconds": time.perf_counter() - started})


def _pools(problem: Problem, estimator: str) -> FrameResult:
    rows, estimates = [], []
    for target in problem.targets:
        instance = target.instance
        rows.append(
            ObjectRow(
                scene_id=problem.scene_id,
                im_id=problem.im_id,
                instance_id=instance.instance_id,
                obj_id=instance.obj_id,
                name=target.model.name,
                method=estimator,
                status="ok" if instance.hypotheses else "no_answer",
                diameter_mm=target.model.diameter_m * 1e3,
                visib_fract=instance.visib_fract,
                n_hypotheses=len(instance.hypotheses),
                message="" if instance.hypotheses else f"{estimator} found no hypothesis",
            )
        )
        estimates += [
            Estimate(obj_id=instance.obj_id, score=h.confidence, T_cam_obj=tuple(float(x) for x in h.T_cam_obj.ravel()))
            for h in instance.hypotheses
        ]
    rows += [left_out_row(problem, one, estimator) for one in problem.left_out]
    return FrameResult(
        frame=problem.frame,
        failed=False,
        seconds=0.0,
        objects=tuple(rows),
        estimates=tuple(estimates),
        n_unreadable=sum(one.is_unreadable for one in problem.left_out),
    )
