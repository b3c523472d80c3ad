"""An object's symmetries as ``models_info.json`` tells them. Source: notes on the official toolkit's rules."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import as_rigid, axis_angle, check_reach, transform
from verefine_viz.core.jsonfile import key_of, numbers_of, position_of

CONTINUOUS_STEPS = 64
"""Rotations that stand for a continuous symmetry (5.6° apart); the official scores use 315."""


def symmetry_transforms(info: dict[str, Any], where: str, continuous_steps: int = CONTINUOUS_STEPS) -> Float:
    """All transforms (S, 4, 4) [m] of the object frame that leave the object looking the same; the identity first.

    Discrete ones D and the steps C of all continuous axes (one after another, not multiplied) combine to C·D.

    Args:
        info: the object's entry of models_info.json (millimetres).
        where: what to call the entry in an error.
        continuous_steps: rotations per continuous axis.

    Raises:
        InputError: an entry is incomplete or no rigid transform.
    """
    discrete = [np.eye(4)]
    for k, values in enumerate(_list(info, "symmetries_discrete", where)):
        place = f"{where}: symmetries_discrete[{k}]"
        T = numbers_of({"it": values}, "it", 16, place).reshape(4, 4).copy()
        T[:3, 3] *= 1e-3
        try:
            check_reach(T[:3, 3], place)
            discrete.append(as_rigid(T, place))
        except ShapeError as error:
            raise InputError(str(error)) from None
    continuous = [
        T
        for k, entry in enumerate(_list(info, "symmetries_continuous", where))
        for T in _rotations(entry, f"{where}: symmetries_continuous[{k}]", continuous_steps)
    ]
    if not continuous:
        return np.stack(discrete)
    return np.stack([C @ D for D in discrete for C in continuous])


def _rotations(entry: Any, where: str, n_steps: int) -> list[Float]:
    axis = numbers_of(entry, "axis", 3, where)
    offset_m = position_of(entry, "offset", where) * 1e-3
    if not np.linalg.norm(axis) > 0:
        raise InputError(f"{where}: 'axis' is zero, expected a direction")
    turns = (axis_angle(axis, 2 * np.pi * i / n_steps) for i in range(n_steps))
    return [transform(R, offset_m - R @ offset_m) for R in turns]


def _list(info: dict[str, Any], key: str, where: str) -> list[Any]:
    value = key_of(info, key, where) if key in info else []
    if not isinstance(value, list):
        raise InputError(f"{where}: {key!r} is a JSON {type(value).__name__}, expected a list")
    return value
