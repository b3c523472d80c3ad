"""Single parts of the engine, called on an object of a frame: score, refiner, simulation, estimators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from verefine_viz.core.arguments import checked_count, checked_path, checked_text, described
from verefine_viz.core.arrays import Float, frozen
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import as_rigid, check_reach
from verefine_viz.core.problem import Hypothesis, Placed, Target
from verefine_viz.core.scores import ScoreMaps, Scores
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.evaluation.results_scores import Evaluation, evaluate_files
from verefine_viz.library.frame_to_solve import AnyFrame, check_frame, target_of
from verefine_viz.library.plugins import named_estimator, with_parts

if TYPE_CHECKING:
    from typing import Unpack

    from verefine_viz.library.plugins import AnyEstimator, AnyRefiner, AnySimulator, AnyVerifier
    from verefine_viz.library.sections import Sections
    from verefine_viz.run.toolbox import Toolbox

MOST_STEPS = MOST_HYPOTHESES = 10_000
"""The most steps of a simulation, and poses of an estimator; the same bounds as in the settings."""


def score(
    frame: AnyFrame, name: str | int, poses: ArrayLike, verifier: AnyVerifier = "", **sections: Unpack[Sections]
) -> Scores:
    """Score poses of an object (Eq. 1, paper Sec. III-B).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        poses: T_cam_obj [m], (4, 4) or (N, 4, 4); a rounded rotation is replaced by the nearest exact one.
        verifier: your own in place of Eq. 1, by name or as an object.
        sections: settings: ``score={"tau_m": 0.01}``.

    Returns:
        Columns of N scores in [0, 1], their depth and normal fit, and counts of pixels.

    Raises:
        InputError: the frame has no such object, or a pose is invalid.
        SettingsError: a setting is unknown or out of range.
    """
    tools, target = _object(frame, name, with_parts(sections, verifier=verifier))
    return tools.verifier.score(target, checked_poses(poses))


def score_maps(frame: AnyFrame, name: str | int, pose: ArrayLike, **sections: Unpack[Sections]) -> ScoreMaps | None:
    """Score one pose pixel by pixel (Eq. 1, paper Sec. III-B).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        pose: (4, 4) T_cam_obj [m].
        sections: settings: ``score={"tau_m": 0.01}``.

    Returns:
        Images of (H, W): depth as rendered [m], differences, the fit of depth and normals, what each pixel counts as.
        None for a verifier without maps.

    Raises:
        InputError: the frame has no such object, or the pose is invalid.
        SettingsError: a setting is unknown or out of range.
    """
    poses = checked_poses(pose)
    if len(poses) > 1:
        raise ShapeError(f"pose is of {len(poses)} poses, expected one, (4, 4); call score_maps for each")
    tools, target = _object(frame, name, sections)
    return tools.verifier.maps(target, poses[0])


def refine(
    frame: AnyFrame, name: str | int, poses: ArrayLike, refiner: AnyRefiner = "", **sections: Unpack[Sections]
) -> Float:
    """Refine poses of an object once.

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        poses: T_cam_obj [m], (4, 4) or (N, 4, 4).
        refiner: icp, depth_net, …, or your own, by name or as an object; "" = the default.
        sections: settings: ``icp={"max_iterations": 50}``.

    Returns:
        The refined poses [m], of the shape of ``poses``.

    Raises:
        InputError: the frame has no such object, or a pose is invalid.
        SettingsError: there is no such refiner or setting.
    """
    given = checked_poses(poses)
    tools, target = _object(frame, name, with_parts(sections, refiner=refiner))
    refined = np.stack([tools.refiner.refine(target, T) for T in given])
    return refined.reshape(np.shape(poses))


def settle(
    frame: AnyFrame,
    name: str | int,
    poses: ArrayLike,
    steps: int = 60,
    simulator: AnySimulator = "",
    **sections: Unpack[Sections],
) -> Float:
    """Let an object move under gravity on the support plane (paper Sec. III-A).

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        poses: T_cam_obj [m], (4, 4) or (N, 4, 4); each is simulated on its own.
        steps: number of steps of 1/60 s, at most 10 000.
        simulator: your own in place of Bullet, by name or as an object.
        sections: settings: ``physics={"collider": "hull"}``.

    Returns:
        The poses (steps + 1, 4, 4) [m] of one, the given one first, or (N, steps + 1, 4, 4) of N. An object that leaves
        the reach of the camera stays where it was last.

    Raises:
        InputError: there is no such object, no support plane, or a pose is invalid.
    """
    given, steps = checked_poses(poses), checked_count(steps, "steps", 1, MOST_STEPS)
    tools, target = _object(frame, name, with_parts(sections, simulator=simulator))
    support = target.observation.support
    if support is None or tools.simulator is None:
        raise InputError("nothing is simulated: no support plane is seen and no gravity is given, or physics is off")
    paths = np.empty((len(given), steps + 1, 4, 4))
    for k, T in enumerate(given):
        moved = tools.simulator.settle(Placed(target.instance.instance_id, target.model, T), (), support, steps)
        paths[k, : len(moved.Ts_cam_obj)] = moved.Ts_cam_obj
        paths[k, len(moved.Ts_cam_obj) :] = moved.Ts_cam_obj[-1]
    return paths.reshape(*np.shape(poses)[:-2], steps + 1, 4, 4)


def estimate(
    frame: AnyFrame, name: str | int, estimator: AnyEstimator = "ppf", n: int = 5, **sections: Unpack[Sections]
) -> tuple[Hypothesis, ...]:
    """Find initial poses of an object from its segment.

    Args:
        frame: the frame.
        name: the object's name, or its instance_id.
        estimator: ppf (point pair features), pcs (congruent point sets), densefusion, or your own, by name or as an
            object.
        n: most poses to return, up to 10 000.
        sections: settings: ``ppf={"step_m": 0.005}``.

    Returns:
        Hypotheses with ``T_cam_obj`` (4, 4) [m] and ``confidence``, the best first.

    Raises:
        InputError: there is no such object, or the estimator lacks what it needs.
    """
    n = checked_count(n, "n", 1, MOST_HYPOTHESES)
    estimator, parts = named_estimator(estimator)
    tools, target = _object(frame, name, sections)
    return make_estimator(estimator, tools.session, parts).hypotheses(target, n)


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
    expected = "the path of a results file (CSV), or a list of them"
    several = results if isinstance(results, list | tuple) and results else [results]
    paths = [checked_path(path, "results", expected) for path in several]
    folder = checked_path(dataset, "dataset", "the folder of a data set")
    return evaluate_files(paths, folder, checked_text(split, "split", 'the name of a folder, or ""'))


def _object(frame: AnyFrame, name: str | int, sections: Mapping[str, Any]) -> tuple[Toolbox, Target]:
    check_frame(frame)
    tools, own = frame.tools(sections)
    return tools, target_of(tools.source.problem(own), name)


def checked_poses(given: ArrayLike) -> Float:
    """One or several poses as (N, 4, 4); InputError where one is invalid, or too far away to be in metres."""
    expected = "expected T_cam_obj in metres, (4, 4) or (N, 4, 4) with N ≥ 1"
    try:
        array = np.asarray(given)
        array = frozen(array, "poses", array.shape)
    except (ShapeError, TypeError, ValueError):
        raise ShapeError(f"poses is {described(given)}, {expected}") from None
    if array.shape[-2:] != (4, 4) or array.ndim not in (2, 3) or not array.size:
        raise ShapeError(f"poses are of shape {array.shape}, {expected}")
    try:
        poses = np.stack([as_rigid(T, f"pose {k}") for k, T in enumerate(array.reshape(-1, 4, 4))])
        for k, T in enumerate(poses):
            check_reach(T[:3, 3], f"pose {k}")
    except ShapeError as error:
        raise InputError(str(error)) from None
    return poses
