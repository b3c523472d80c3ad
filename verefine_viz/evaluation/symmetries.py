"""An object's symmetries as the official BOP scores take them: 315 steps of a continuous one, matrices as they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import axis_angle, check_reach, transform
from verefine_viz.core.jsonfile import key_of, numbers_of, position_of

STEP = 0.01
"""Largest way of a point between two steps of a continuous symmetry, as a share of the diameter (BOP)."""


def bop_symmetries(info: dict[str, Any], where: str, step: float = STEP) -> Float:
    """All transforms (S, 4, 4) [mm] of the object frame that leave the object looking the same; the identity first.

    Unlike those that refiners use, discrete ones keep the rounded digits of the file, and a continuous one has
    ceil(π / step) steps. Several continuous axes are put one after another, not multiplied; with discrete ones D they
    combine to C·D.

    Args:
        info: the object's entry of models_info.json (millimetres).
        where: what to call the entry in an error.
        step: see :data:`STEP`.

    Raises:
        InputError: an entry is incomplete.
    """
    discrete = [np.eye(4)]
    for k, values in enumerate(_list(info, "symmetries_discrete", where)):
        place = f"{where}: symmetries_discrete[{k}]"
        T = numbers_of({"it": values}, "it", 16, place).reshape(4, 4)
        try:
            check_reach(T[:3, 3] * 1e-3, place)
        except ShapeError as error:
            raise InputError(str(error)) from None
        discrete.append(T)
    continuous = [
        T
        for k, entry in enumerate(_list(info, "symmetries_continuous", where))
        for T in _rotations(entry, f"{where}: symmetries_continuous[{k}]", int(np.ceil(np.pi / step)))
    ]
    if not continuous:
        return np.stack(discrete)
    return np.stack([C @ D for D in discrete for C in continuous])


def _rotations(entry: Any, where: str, n_steps: int) -> list[Float]:
    axis, offset_mm = numbers_of(entry, "axis", 3, where), position_of(entry, "offset", where)
    if not np.linalg.norm(axis) > 0:
        raise InputError(f"{where}: 'axis' is zero, expected a direction")
    turns = (axis_angle(axis, 2 * np.pi * i / n_steps) for i in range(n_steps))
    return [transform(R, offset_mm - R @ offset_mm) for R in turns]


def _list(info: dict[str, Any], key: str, where: str) -> list[Any]:
    value = key_of(info, key, where) if key in info else []
    if not isinstance(value, list):
        raise InputError(f"{where}: {key!r} is a JSON {type(value).__name__}, expected a list")
    return value
