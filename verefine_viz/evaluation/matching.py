"""Which estimate belongs to which instance: greedy, best score first, as the BOP toolkit matches them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float


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


@njit(cache=True, nogil=True)
def _match_all(errors, thresholds, valid, matched):
    limit = np.empty(1)
    for c in range(thresholds.shape[0]):
        for t in range(thresholds.shape[1]):
            limit[0] = thresholds[c, t]
            _match(errors[c], limit, valid, matched[c, t])


@njit(cache=True, nogil=True)
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
