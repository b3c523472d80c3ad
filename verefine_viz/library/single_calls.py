"""Single parts of the engine, called on an object of a frame: score, refiner, simulation, estimators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import as_rigid, check_reach
from verefine_viz.core.problem import Hypothesis, Placed, Target
from verefine_viz.core.scores import ScoreMaps, Scores
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.evaluation.results_scores import Evaluation, evaluate_files
from verefine_viz.library.frame_to_solve import AnyFrame, check_frame, target_of
from verefine_viz.run.toolbox import Toolbox


def score(frame: AnyFrame, name: str | int, poses: ArrayLike, **sections: Mapping[str, Any]) -> Scores:
    """Score poses of an object (Eq. 1, paper Sec. III-B).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        poses: T_cam_obj [m], (4, 4) or (N, 4, 4); of a rounded rotation the nearest exact one is taken.
        sections: settings: ``score={"tau_m": 0.01}``.

    Returns:
        Columns of N scores in [0, 1], their depth and normal fit, and counts of pixels.

    Raises:
        InputError: the frame has no such object, or a pose is none.
        SettingsError: a setting is unknown or out of range.
    """
    tools, target = _object(frame, name, sections)
    return tools.verifier.score(target, _poses(poses))


def score_maps(frame: AnyFrame, name: str | int, pose: ArrayLike, **sections: Mapping[str, Any]) -> ScoreMaps | None:
    """Score one pose pixel by pixel (Eq. 1, paper Sec. III-B).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        pose: (4, 4) T_cam_obj [m].
        sections: settings: ``score={"tau_m": 0.01}``.

    Returns:
        Images of (H, W): depth as rendered [m], differences, the fit of depth and normals, what each pixel counts as.
        None of a verifier without maps.

    Raises:
        InputError: the frame has no such object, or the pose is none.
        SettingsError: a setting is unknown or out of range.
    """
    tools, target = _object(frame, name, sections)
    return tools.verifier.maps(target, _poses(pose)[0])


def refine(
    frame: AnyFrame, name: str | int, poses: ArrayLike, refiner: str = "", **sections: Mapping[str, Any]
) -> Float:
    """Refine poses of an object once.

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        poses: T_cam_obj [m], (4, 4) or (N, 4, 4).
        refiner: icp, depth_net, …, or one of your own; empty = the default.
        sections: settings: ``icp={"max_iterations": 50}``.

    Returns:
        The refined poses [m], of the shape of ``poses``.

    Raises:
        InputError: the frame has no such object, or a pose is none.
        SettingsError: there is no such refiner or setting.
    """
    method = {**({"refiner": refiner} if refiner else {}), **sections.get("method", {})}
    tools, target = _object(frame, name, {**sections, "method": method})
    given = _poses(poses)
    refined = np.stack([tools.refiner.refine(target, T) for T in given])
    return refined.reshape(np.shape(poses))


def settle(frame: AnyFrame, name: str | int, pose: ArrayLike, steps: int = 60, **sections: Mapping[str, Any]) -> Float:
    """Let an object move under gravity on the support plane (paper Sec. III-A).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        pose: (4, 4) T_cam_obj [m].
        steps: number of steps of 1/60 s.
        sections: settings: ``physics={"collider": "hull"}``.

    Returns:
        The poses (steps + 1, 4, 4) [m], the given one first.

    Raises:
        InputError: there is no such object, no support plane, or the pose is none.
    """
    tools, target = _object(frame, name, sections)
    support = target.observation.support
    if support is None or tools.simulator is None:
        raise InputError("nothing is simulated: no support plane is seen and no gravity is given, or physics is off")
    placed = Placed(target.instance.instance_id, target.model, _poses(pose)[0])
    return np.asarray(tools.simulator.settle(placed, (), support, steps).Ts_cam_obj)


def estimate(
    frame: AnyFrame, name: str | int, estimator: str = "ppf", n: int = 5, **sections: Mapping[str, Any]
) -> tuple[Hypothesis, ...]:
    """Find initial poses of an object from its segment.

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        estimator: ppf (point pair features), pcs (congruent point sets), densefusion, or one of your own.
        n: how many at most.
        sections: settings: ``ppf={"step_m": 0.005}``.

    Returns:
        Hypotheses with ``T_cam_obj`` (4, 4) [m] and ``confidence``, the best first.

    Raises:
        InputError: there is no such object, or the estimator lacks what it needs.
    """
    tools, target = _object(frame, name, sections)
    return make_estimator(estimator, tools.session).hypotheses(target, n)


def evaluate(results: Path | str | Sequence[Path | str], dataset: Path | str, split: str = "") -> Evaluation:
    """Score results files as the BOP benchmark does (VSD, MSSD, MSPD and their average recall), and by ADD(-S).

    Args:
        results: one or several CSV files in BOP's format.
        dataset: the folder of the data set, with ground truth.
        split: the folder of its images, as "test"; empty = the one with targets.

    Returns:
        For each file its scores: ``scores[0].recalls.ar`` is BOP's average recall, ``scores[0].answers`` has the errors
        of each object [mm, px, degrees].

    Raises:
        InputError: a file is missing or damaged, or the data set has no ground truth.
    """
    paths = [results] if isinstance(results, str | Path) else results
    return evaluate_files([Path(path) for path in paths], Path(dataset), split)


def _object(frame: AnyFrame, name: str | int, sections: Mapping[str, Any]) -> tuple[Toolbox, Target]:
    check_frame(frame)
    tools, own = frame.tools(sections)
    return tools, target_of(tools.source.problem(own), name)


def _poses(given: ArrayLike) -> Float:
    """Poses (N, 4, 4) of one or several; InputError where one is none, or too far away to be in metres."""
    array = np.asarray(given, dtype=np.float64)
    if array.shape[-2:] != (4, 4) or array.ndim not in (2, 3) or not array.size:
        raise InputError(f"poses are of shape {array.shape}, expected (4, 4) or (N, 4, 4) with N ≥ 1")
    try:
        poses = np.stack([as_rigid(T, f"pose {k}") for k, T in enumerate(array.reshape(-1, 4, 4))])
        for k, T in enumerate(poses):
            check_reach(T[:3, 3], f"pose {k}")
    except ShapeError as error:
        raise InputError(str(error)) from None
    return poses
