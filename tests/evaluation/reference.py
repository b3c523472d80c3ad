"""BOP's scores written down a second time, plainly and slowly: whole images, every symmetry, every vertex, loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.bop_model import EvalModel
from verefine_viz.evaluation.ground_truth import GtImage, GtInstance, GtSource, Targets
from verefine_viz.evaluation.pose_table import PoseTable
from verefine_viz.evaluation.vsd import DepthPatch, model_depth

STEPS = np.arange(0.05, 0.51, 0.05)


def average_recalls(table: PoseTable, source: GtSource, targets: Targets) -> tuple[float, float, float]:
    """AR_VSD, AR_MSSD, AR_MSPD."""
    recalls = [[], [], []]
    groups = [(image, obj_id, n) for image, counts in targets.counts.items() for obj_id, n in counts.items()]
    prepared = [_group(table, source, *group) for group in groups]
    n_targets = sum(n_valid for _, n_valid, *_ in prepared)
    for tau in range(10):
        for threshold in STEPS:
            recalls[0].append(sum(_found(p, 0, tau, threshold) for p in prepared) / n_targets)
    for threshold in STEPS:
        recalls[1].append(sum(_found(p, 1, None, threshold) for p in prepared) / n_targets)
    for threshold in range(5, 51, 5):
        recalls[2].append(sum(_found(p, 2, None, threshold) for p in prepared) / n_targets)
    a, b, c = (float(np.mean(r)) for r in recalls)
    return a, b, c


def _group(table: PoseTable, source: GtSource, image: tuple[int, int], obj_id: int, n: int):
    picture = source.image(*image, with_depth=True)
    ranked = sorted(picture.instances, key=lambda t: t.visib_fract, reverse=True)
    valid = {t.gt_id for t in [t for t in ranked if t.obj_id == obj_id][:n]}
    truths = [t for t in picture.instances if t.obj_id == obj_id]
    rows = [k for k, ids in enumerate(table.ids) if ids == (*image, obj_id)]
    rows = sorted(rows, key=lambda k: table.scores[k], reverse=True)[:n]
    model = source.model(obj_id)
    errors = [[_errors(model, table.R[k], table.t_mm[k], truth, picture) for truth in truths] for k in rows]
    return errors, len(valid), [t.gt_id in valid for t in truths], truths


def _found(prepared, kind: int, tau: int | None, threshold: float) -> int:
    errors, _, valid, truths = prepared
    taken: set[int] = set()
    for row in errors:
        best, best_error = None, threshold
        for g in range(len(truths)):
            error = row[g][kind] if tau is None else row[g][kind][tau]
            if valid[g] and g not in taken and error < best_error:
                best, best_error = g, error
        if best is not None:
            taken.add(best)
    return len(taken)


def _errors(
    model: EvalModel, R: Float, t_mm: Float, truth: GtInstance, image: GtImage
) -> tuple[list[float], float, float]:
    return (
        vsd(model, R, t_mm, truth, image),
        mssd(model, R, t_mm, truth) / model.diameter_mm
        if np.linalg.norm(t_mm - truth.t_mm) < model.diameter_mm
        else np.inf,
        mspd(model, R, t_mm, truth, image.K) * 640 / image.width,
    )


def vsd(model: EvalModel, R: Float, t_mm: Float, truth: GtInstance, image: GtImage) -> list[float]:
    shape, K, d = image.depth_mm.shape, image.K, model.diameter_mm
    if t_mm[2] == 0:
        return [1.0] * 10
    apart = np.hypot(*(t_mm[:2] / t_mm[2] - truth.t_mm[:2] / truth.t_mm[2]))
    if not apart < 0.5 * d * (1 / t_mm[2] + 1 / truth.t_mm[2]):
        return [1.0] * 10
    u, v = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    length = np.sqrt(((u - K[0, 2]) / K[0, 0]) ** 2 + ((v - K[1, 2]) / K[1, 1]) ** 2 + 1)
    measured = image.depth_mm * length
    ours = whole(model_depth(model, R, t_mm, K, shape), shape) * length
    theirs = whole(model_depth(model, truth.R, truth.t_mm, K, shape), shape) * length
    seen_gt = (theirs > 0) & ((theirs - measured <= 15) | (measured == 0))
    seen_est = (ours > 0) & ((ours - measured <= 15) | (measured == 0) | seen_gt)
    union, common = (seen_gt | seen_est).sum(), seen_gt & seen_est
    if union == 0:
        return [1.0] * 10
    far = np.abs(ours - theirs)[common] / d
    return [float(((far >= tau).sum() + union - common.sum()) / union) for tau in STEPS]


def whole(patch: DepthPatch, shape: tuple[int, int]) -> Float:
    out = np.zeros(shape)
    rows, columns = patch.depth_mm.shape
    out[patch.y0 : patch.y0 + rows, patch.x0 : patch.x0 + columns] = patch.depth_mm
    return out


def mssd(model: EvalModel, R: Float, t_mm: Float, truth: GtInstance) -> float:
    x = model.vertices_mm
    shifts = (x @ R.T + t_mm - ((x @ S[:3, :3].T + S[:3, 3]) @ truth.R.T + truth.t_mm) for S in model.symmetries_mm)
    return min(float(np.linalg.norm(shift, axis=1).max()) for shift in shifts)


def mspd(model: EvalModel, R: Float, t_mm: Float, truth: GtInstance, K: Float) -> float:
    def seen(points: Float) -> Float:
        p = points @ K.T
        return p[:, :2] / p[:, 2:]

    x = model.vertices_mm
    ours = seen(x @ R.T + t_mm)
    theirs = (seen((x @ S[:3, :3].T + S[:3, 3]) @ truth.R.T + truth.t_mm) for S in model.symmetries_mm)
    return min(float(np.linalg.norm(ours - other, axis=1).max()) for other in theirs)


def average_precision(scores: Sequence[float], outcomes: Sequence[int], n_targets: int) -> float:
    """101-point interpolation, estimate by estimate; outcome 1 = right, 0 = wrong, 2 = ignored."""
    order = sorted(range(len(scores)), key=lambda k: scores[k], reverse=True)
    curve, right, wrong = [], 0, 0
    for k in order:
        if outcomes[k] == 2:
            continue
        right, wrong = right + (outcomes[k] == 1), wrong + (outcomes[k] == 0)
        curve.append((right / n_targets, right / (right + wrong)))
    at = [max((p for r, p in curve if r >= level), default=0.0) for level in np.linspace(0, 1, 101)]
    return float(np.mean(at))
