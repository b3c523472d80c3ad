"""The highest score that small motions of an object reach from a pose.

A refiner leaves an object up to a millimetre from there, and that costs a score more than noise of the sensor does: to
know whether the observation can tell two poses apart, the highest scores near both are compared.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PoseScore

ROUNDS, TRIES = 80, 12
"""Batches of motions, and how many are tried in each."""
FIRST_MM, LAST_MM = 1.5, 0.01
"""How far the first motions go along each axis [mm], and with which it ends."""
DEG_PER_MM = 0.6
"""Turns go as far as this [deg] for each millimetre of shift: about the same at the surface of a mug."""
LONGER, SHORTER = 1.2, 0.8
"""Motions after a batch that went up, and after one that did not."""


def highest_near(
    verifier: Verifier, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = ()
) -> tuple[Float, PoseScore]:
    """The pose (4, 4) that random small motions go up to from a pose, and its score, which is no lower.

    A (1 + 12) evolution strategy with Rechenberg's rule of the step (1973); the motions are the same in each call.
    """
    rng, middle = np.random.default_rng(0), np.append(target.model.points.mean(axis=0), 1.0)
    best, score = np.array(T_cam_obj), verifier.score(target, T_cam_obj[None], placed)[0]
    step_mm = FIRST_MM
    for _ in range(ROUNDS):
        motions = step_mm * rng.standard_normal((TRIES, 6))
        tried = np.array([_moved(best, best[:3] @ middle, motion) for motion in motions])
        scores = verifier.score(target, tried, placed)
        k = int(np.argmax(scores.score))
        is_up = scores.score[k] > score.score
        if is_up:
            best, score = tried[k], scores[k]
        step_mm *= LONGER if is_up else SHORTER
        if step_mm < LAST_MM:
            break
    return best, score


def _moved(T_cam_obj: Float, pivot_cam: Float, motion: Float) -> Float:
    """The pose shifted by the last three numbers of ``motion`` [mm] and turned about a point by the first three."""
    angle = float(np.linalg.norm(motion[:3]))
    R = axis_angle(motion[:3] / angle, np.deg2rad(DEG_PER_MM * angle))
    return transform(R @ T_cam_obj[:3, :3], R @ (T_cam_obj[:3, 3] - pivot_cam) + pivot_cam + 1e-3 * motion[3:])
