"""An object in a coarser image of its frame: every n-th pixel. Its scores cost less, and hardly differ."""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.camera import Camera
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Target

ENOUGH_PX = 2500
"""Pixels of a mask that are enough to score an object."""

_coarse: WeakKeyDictionary[Observation, dict[int, Observation]] = WeakKeyDictionary()
"""The coarser images of a frame, which its objects share."""


def coarse_target(target: Target) -> tuple[Target, int]:
    """The object with some ``ENOUGH_PX`` pixels in its mask, and n; itself and 1 where it has no more."""
    n = max(1, int(np.sqrt(np.count_nonzero(target.instance.mask) / ENOUGH_PX)))
    if n == 1:
        return target, 1
    known = _coarse.setdefault(target.observation, {})
    if n not in known:
        known[n] = _every(n, target.observation)
    instance = replace(target.instance, mask=np.ascontiguousarray(target.instance.mask[n // 2 :: n, n // 2 :: n]))
    return replace(target, observation=known[n], instance=instance), n


def _every(n: int, observation: Observation) -> Observation:
    camera, at = observation.camera, np.s_[n // 2 :: n, n // 2 :: n]
    depth_m = np.ascontiguousarray(observation.depth_m[at])
    K = camera.K.copy()
    K[:2, 2] -= n // 2
    K[:2] /= n
    return replace(
        observation,
        camera=Camera(K, depth_m.shape[1], depth_m.shape[0]),
        depth_m=depth_m,
        normals_cam=np.ascontiguousarray(observation.normals_cam[at]),
        rgb=None if observation.rgb is None else np.ascontiguousarray(observation.rgb[at]),
        object_mask=np.ascontiguousarray(observation.object_mask[at]),
    )
