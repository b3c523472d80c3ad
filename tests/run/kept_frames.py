"""Frames to save with ``Frame.keep``, and the folders that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tests.fakes import BOX_M
from verefine_viz.core.problem import Problem
from verefine_viz.library.frame_to_solve import Frame
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox


def box_mesh(path: Path, unit_m: float = 1.0) -> Path:
    trimesh.creation.box(BOX_M / unit_m).export(path)
    return path


def keep(folder: Path, K: Any, depth_m: Any, rgb: Any, objects: list[dict[str, Any]], **more: Any) -> str:
    frame = Frame(K, depth_m, rgb, **more)
    for one in objects:
        frame.add(**one)
    return frame.keep(folder)


def kept(folder: Path, problem: Problem, objects: list[dict[str, Any]], **more: Any) -> str:
    seen = problem.observation
    return keep(folder, seen.camera.K, seen.depth_m, seen.rgb, objects, **more)


def found(problem: Problem, mesh: Path, k: int = 0, with_truth: bool = False) -> dict[str, Any]:
    """What ``Frame.add`` takes about an instance."""
    instance = problem.instances[k]
    poses = {"net": np.array([h.T_cam_obj for h in instance.hypotheses])}
    truth = instance.T_cam_obj_gt if with_truth else None
    return {"name": "box", "mesh": mesh, "mask": instance.mask, "poses": poses, "T_cam_obj_gt": truth}


def reopened(folder: Path, overrides: Mapping[str, Any] | None = None) -> Toolbox:
    return Toolbox(load_session(folder / "session.toml", overrides))


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_same_files(got: dict[str, bytes], expected: dict[str, bytes]) -> None:
    assert got.keys() == expected.keys()
    for name, content in got.items():
        if name.endswith(".csv"):  # Millimetres that are read and written again may differ in their last digit.
            numbers = [
                np.fromstring(c.decode().partition("\n")[2].replace(",", " "), sep=" ")
                for c in (content, expected[name])
            ]
            np.testing.assert_allclose(*numbers, rtol=1e-12)
        else:
            assert content == expected[name], name
