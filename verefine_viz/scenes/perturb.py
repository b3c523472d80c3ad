"""Ground truth, disturbed: first poses with a known error, as in the paper's ablation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.core.problem import Hypothesis


def perturbed(
    T_cam_obj_gt: Float, n: int, rotation_deg: float, translation_mm: float, seed: int | Sequence[int]
) -> tuple[Hypothesis, ...]:
    """``n`` poses, each turned by exactly ``rotation_deg`` and moved by exactly ``translation_mm``.

    The axis (through the object's origin) and the direction are uniform on the sphere. The first k of n poses are the
    same for every n.

    Args:
        T_cam_obj_gt: (4, 4) ground truth [m].
        n: how many.
        rotation_deg: angle [deg].
        translation_mm: distance [mm].
        seed: non-negative; several numbers (seed, scene, image, instance) make frames independent of each other.

    Source: VeREFINE, Sec. V-A (docs/methods.md 8.1).
    """
    rng = np.random.default_rng(seed)
    poses = []
    for k in range(n):
        axis, direction = random_unit_vector(rng), random_unit_vector(rng)
        R = axis_angle(axis, np.radians(rotation_deg)) @ T_cam_obj_gt[:3, :3]
        t = T_cam_obj_gt[:3, 3] + direction * translation_mm * 1e-3
        poses.append(Hypothesis(transform(R, t), 1.0, f"perturbed {rotation_deg:g}° {translation_mm:g} mm #{k + 1}"))
    return tuple(poses)
