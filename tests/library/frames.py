"""The frame of boxes on a table, of arrays, as tests of the library solve it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import verefine_viz as vv
from tests.fakes import BOX_M, box_problem


def box_file(folder: Path) -> Path:
    """The mesh of a box in millimetres."""
    path = folder / "box.ply"
    trimesh.creation.box(BOX_M * 1000).export(path)
    return path


def boxes(mesh: Any, n: int = 2, **more: Any) -> vv.Frame:
    """The frame of ``n`` boxes; ``mesh`` is in millimetres."""
    problem = box_problem(n_instances=n)
    seen = problem.observation
    frame = vv.Frame(seen.camera.K, seen.depth_m, seen.rgb)
    for k, instance in enumerate(problem.instances):
        poses = np.array([h.T_cam_obj for h in instance.hypotheses])
        given = {"unit_m": 0.001, "T_cam_obj_gt": instance.T_cam_obj_gt} | more
        frame.add(f"box {k}", mesh, instance.mask, poses, **given)
    return frame
