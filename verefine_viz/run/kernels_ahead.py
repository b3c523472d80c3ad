"""Compiles kernels in other processes before they are needed: a first step's while the frame is drawn and scored.

Otherwise, after installing, the first frame would wait for one kernel after another. Numba compiles on one core only;
its cache on disk is shared, so what another process has compiled is read from there.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.child_process import end_with_parent
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.geometry import transform
from verefine_viz.core.kernels import cache_folder
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Target
from verefine_viz.core.settings import Session
from verefine_viz.methods.known_methods import method_of

DEPTH_M = 0.5


def compile_ahead(session: Session) -> None:
    """Start processes that compile the kernels for a session's refiner and for the display of its answer, unless this
    was done.

    Returns at once. The processes, as many as cores but one, are ended with this one.

    Args:
        session: whose refiner and score it is.
    """
    parts = [part for part in PARTS if not _marker(session, part).exists()]
    spare = len(os.sched_getaffinity(0)) - 1
    # In the order of need, a part to each process in turn.
    for own in (parts[i::spare] for i in range(min(spare, len(parts)))):
        context = multiprocessing.get_context("spawn")
        context.Process(target=_compile, args=(session, own), name="verefine-kernels", daemon=True).start()


def _tiny_target() -> tuple[Target, Float]:
    """A carton in the middle of an image of 80 × 60 pixels, 0.5 m away, and its pose, to call kernels with."""
    from verefine_viz.scenes.demo_models import demo_model

    camera = Camera(np.array([[80.0, 0, 39.5], [0, 80.0, 29.5], [0, 0, 1]]), 80, 60)
    depth = np.full(camera.shape, DEPTH_M, np.float32)
    normals = np.broadcast_to(np.array([0, 0, -1], np.float32), (*camera.shape, 3))
    mask = np.zeros(camera.shape, bool)
    mask[20:40, 28:52] = True
    model = demo_model("pack", 500, 0)
    points = camera.back_project(depth)[mask]
    T_cam_obj = transform(np.eye(3), [0, 0, DEPTH_M + model.diameter_m / 4])
    instance = Instance(0, model.obj_id, mask, points, ())
    rgb = np.full((*camera.shape, 3), 128, np.uint8)
    observation = Observation(camera, depth, normals, rgb, mask, None)
    return Target(observation, instance, model), T_cam_obj


def _refine(session: Session) -> None:
    from verefine_viz.run.toolbox import Toolbox

    target, T_cam_obj = _tiny_target()
    # ICP first, which draws nothing: kernels for drawing are compiled by the process that shows the frame.
    last = _refiner_of(session)
    for name in ("icp", last) if last == "depth_net_icp" else (last,):
        chosen = structs.replace(session, method=structs.replace(session.method, refiner=name))
        Toolbox(chosen).refiner.refine(target, T_cam_obj)


def _refiner_of(session: Session) -> str:
    """Return the name of the refiner that a session's method calls: a tree search brings its own."""
    return "trimmed_icp" if method_of(session.method.name).has_tree else session.method.refiner


def _evaluate(session: Session) -> None:
    from verefine_viz.evaluation.allowed_search import allowed_poses
    from verefine_viz.run.toolbox import Toolbox

    target, T_cam_obj = _tiny_target()
    allowed_poses(Toolbox(session).verifier, target, T_cam_obj)


PARTS: Mapping[str, Callable[[Session], None]] = {"refine": _refine, "evaluate": _evaluate}
"""The parts to compile, in the order in which a first run needs them."""


def _compile(session: Session, parts: list[str]) -> None:
    """Main function of such a process; kernels that fail here are compiled, or refused, where they are needed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent ends it.
    end_with_parent()
    for part in parts:
        with suppress(VerefineError, OSError):
            PARTS[part](session)
            _marker(session, part).touch()


def _marker(session: Session, part: str) -> Path:
    """Return the file that says that a part was compiled for such a session."""
    return cache_folder() / f"{part}-{_refiner_of(session)}.compiled"
