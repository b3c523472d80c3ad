"""Batch folders written out without running anything."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.changing import replace
from tests.made_runs import finished, written
from verefine_viz.core.arrays import Float
from verefine_viz.run.answers import HEADER, table_lines
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve, save_session


def row(im_id: int, instance_id: int = 0, scene_id: int = 1, **values: Any) -> Answer:
    """An object that was solved, right unless ``values`` say otherwise."""
    known = {"obj_id": 1 + instance_id, "name": f"object {1 + instance_id}", "method": "rir", "diameter_mm": 100.0}
    known |= {"has_truth": True, "add_s_mm": 2.0, "rotation_deg": 1.0, "translation_mm": 1.0, "score": 0.9}
    known |= {"n_iterations": 25, "ms_refine": 10.0, "ms_simulate": 5.0, "ms_score": 15.0, "ms_total": 40.0}
    return Answer(**{"frame": f"{scene_id}/{im_id}", "instance_id": instance_id, "status": "ok", **known, **values})


def write_run(
    folder: Path, rows: Sequence[Answer], session: Mapping[str, Any] | None = None, T_cam_obj: Float | None = None
) -> Path:
    """A finished batch of these rows, whose iterations are left out; every object that was solved stands at
    ``T_cam_obj``, or at the identity.
    """
    pose = np.eye(4) if T_cam_obj is None else T_cam_obj
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / "runs", ignore_errors=True)
    save_session(resolve(session or {"title": "A made-up run"}), folder / "session.toml")
    placed = [replace(r, T_cam_obj=pose if r.status == "ok" else None, n_iterations=0) for r in rows]
    results = [
        written(folder, finished(frame, [r for r in placed if r.frame == frame], seconds=1.0))
        for frame in dict.fromkeys(r.frame for r in rows)
    ]
    (folder / "frames.csv").write_text(HEADER + "".join(map(table_lines, results)))
    totals = {"frames": len(results), "mean_stages_ms_per_frame": {"read": 30.0, "start": 10.0, "iterate": 200.0}}
    facts = {"version": "0.1.0", "status": "finished", "seconds": 12.0, "begun": "2026-01-02T03:04:05+00:00"}
    (folder / "run.json").write_text(json.dumps({**facts, "totals": totals}), encoding="utf-8")
    return folder
