"""Matches estimates to instances, and measures the errors of the estimate of each instance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.evaluation.bop_model import EvalModel
from verefine_viz.evaluation.ground_truth import GtInstance
from verefine_viz.evaluation.pair_errors import PairErrors
from verefine_viz.evaluation.pose_table import Image, PoseTable
from verefine_viz.evaluation.vertex_errors import add_mm, adi_mm, symmetric_errors

# Which estimate belongs to which instance: greedy, best score first, as the BOP toolkit matches them.


def match_poses(errors: Float, limits: Float, valid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index of the instance (E,) that each estimate is matched to; -1 = none.

    Each estimate takes the valid instance, not yet taken, whose error is smallest and below the limit; among equals
    the first.

    Args:
        errors: (E, G, K) K numbers of each pair, estimates by descending score; all K must be smaller.
        limits: (K,).
        valid: (G,) the instances that may be matched.
    """
    matched = np.full(errors.shape[0], -1, np.int64)
    _match(np.ascontiguousarray(errors, dtype=np.float64), np.asarray(limits, dtype=np.float64), valid, matched)
    return matched


def match_thresholds(errors: Float, thresholds: Float, valid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """:func:`match_poses` for many kinds of error and thresholds: (C, T, E) instances, -1 = none.

    Args:
        errors: (C, E, G) C kinds of error of each pair, estimates by descending score.
        thresholds: (C, T).
        valid: (G,).
    """
    matched = np.full((*thresholds.shape, errors.shape[1]), -1, np.int64)
    _match_all(np.ascontiguousarray(errors[..., None], dtype=np.float64), thresholds, valid, matched)
    return matched


@kernel(nogil=True)
def _match_all(errors, thresholds, valid, matched):
    limit = np.empty(1)
    for c in range(thresholds.shape[0]):
        for t in range(thresholds.shape[1]):
            limit[0] = thresholds[c, t]
            _match(errors[c], limit, valid, matched[c, t])


@kernel(nogil=True)
def _match(errors, limits, valid, matched):
    n_kinds = len(limits)
    taken = np.zeros(len(valid), np.bool_)
    for e in range(errors.shape[0]):
        best = -1
        for g in range(len(valid)):
            if not valid[g] or taken[g]:
                continue
            smaller = True
            for k in range(n_kinds):
                least = limits[k] if best < 0 else errors[e, best, k]
                if not errors[e, g, k] < least:
                    smaller = False
                    break
            if smaller:
                best = g
        if best >= 0:
            taken[best] = True
            matched[e] = best


@dataclass(frozen=True)
class AskedInstance:
    """One instance asked for. Without an estimate, or with one that is no pose, its errors are infinite."""

    scene_id: int
    im_id: int
    obj_id: int
    gt_id: int
    visib_fract: float
    row: int | None
    """Row of the results file, from 0; None = no estimate. Where an object is there several times, estimates take the
    nearest free instance, best score first."""
    score: float
    vsd: float
    """Mean over the tolerances τ, in [0, 1]; 1 without an estimate."""
    mssd: float
    """Share of the diameter."""
    mspd_px: float
    """[px of an image 640 wide]."""
    add_s_mm: float
    """ADD, or ADD-S (ADI) for symmetric objects [mm]."""
    diameter_mm: float
    rotation_deg: float
    """To the nearest of the poses that look the same [deg]."""
    translation_mm: float
    """To the same pose [mm]."""

    @property
    def is_correct(self) -> bool:
        """ADD(-S) below 10 % of the diameter."""
        return self.add_s_mm < CORRECT * self.diameter_mm


def answers(
    model: EvalModel | None,
    table: PoseTable,
    image: Image,
    rows: Sequence[int],
    instances: Sequence[GtInstance],
    valid: NDArray[np.bool_],
    errors: PairErrors | None,
    adi: Callable[..., float] = adi_mm,
) -> tuple[AskedInstance, ...]:
    """An answer for each valid instance of one object in one image.

    Args:
        model: of the object; None together with ``errors`` where there is no estimate.
        table: the estimates.
        image: (scene_id, im_id).
        rows: those of the object, by descending score.
        instances: G of the object.
        valid: (G,) which of them are asked for.
        errors: of all pairs.
        adi: measures ADI.
    """
    chosen: dict[int, int] = {}
    if errors is not None:
        apart_mm = np.array([[float(np.linalg.norm(table.t_mm[row] - gt.t_mm)) for gt in instances] for row in rows])
        matched = match_poses(apart_mm[..., None], np.array([np.inf]), valid)
        chosen = {int(g): e for e, g in enumerate(matched) if g >= 0}
    return tuple(
        _answer(model, table, image, rows, gt, errors, g, chosen.get(g), adi)
        for g, gt in enumerate(instances)
        if valid[g]
    )


def _answer(
    model: EvalModel | None,
    table: PoseTable,
    image: Image,
    rows: Sequence[int],
    gt: GtInstance,
    errors: PairErrors | None,
    g: int,
    e: int | None,
    adi: Callable[..., float],
) -> AskedInstance:
    known = *image, gt.obj_id, gt.gt_id, gt.visib_fract
    if model is None or errors is None or e is None:
        diameter_mm = np.nan if model is None else model.diameter_mm
        return AskedInstance(*known, None, -np.inf, 1.0, np.inf, np.inf, np.inf, diameter_mm, np.inf, np.inf)
    row = rows[e]
    pair = table.R[row], table.t_mm[row], gt.R, gt.t_mm
    is_pose = np.isfinite(pair[0]).all() and np.isfinite(pair[1]).all()
    add_s_mm = (adi if model.is_symmetric else add_mm)(model, *pair) if is_pose else np.inf
    turn_deg, shift_mm = symmetric_errors(model, *pair) if is_pose else (np.inf, np.inf)
    return AskedInstance(
        *known,
        row,
        float(table.scores[row]),
        float(errors.vsd[:, e, g].mean()),
        float(errors.mssd_mm[e, g] / model.diameter_mm),
        float(errors.mspd_px[e, g]),
        add_s_mm,
        model.diameter_mm,
        turn_deg,
        shift_mm,
    )


def mean_errors(given: Sequence[AskedInstance]) -> tuple[float, float]:
    """Mean errors of rotation r̄ [deg] and translation t̄ [mm] over the instances that got a pose (paper, Table II);
    NaN where none did.
    """
    with_pose = [a for a in given if np.isfinite(a.rotation_deg)]
    if not with_pose:
        return np.nan, np.nan
    turn_deg, shift_mm = (np.mean([[a.rotation_deg, a.translation_mm] for a in with_pose], axis=0)).tolist()
    return turn_deg, shift_mm


def correct_share(given: Sequence[AskedInstance]) -> float:
    """Share of the instances asked for with ADD(-S) below 10 % of the diameter; NaN where none was asked for."""
    return float(np.mean([a.is_correct for a in given])) if given else np.nan
