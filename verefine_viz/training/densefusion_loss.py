"""The losses of DenseFusion (Wang et al., CVPR 2019, Sec. 3.3-3.4). docs/methods.md 5.4."""

# pyright: reportMissingImports=false
from __future__ import annotations

import torch
from torch import Tensor

CONFIDENCE_WEIGHT = 0.015
"""w: weight of the penalty of a point with low confidence, whose error counts less."""


def rotations(quats_wxyz: Tensor) -> Tensor:
    """The rotations (…, 3, 3) of quaternions (…, 4) of any length."""
    w, x, y, z = (quats_wxyz / quats_wxyz.norm(dim=-1, keepdim=True)).unbind(dim=-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def distances(Rs: Tensor, ts: Tensor, models: Tensor, wanted: Tensor, is_symmetric: Tensor) -> Tensor:
    """ADD, or ADD-S of symmetric objects, of N poses of each of B objects (B, N) [m].

    Args:
        Rs: (B, N, 3, 3).
        ts: (B, N, 3) [m].
        models: (B, M, 3) points of the models [m].
        wanted: (B, M, 3) where they belong [m].
        is_symmetric: (B,) each point then belongs to the nearest of ``wanted``.
    """
    moved = models[:, None] @ Rs.transpose(2, 3) + ts[:, :, None]
    targets = wanted[:, None].expand_as(moved)
    if is_symmetric.any():
        alike = is_symmetric.nonzero()[:, 0]
        nearest = torch.cdist(moved[alike].detach().flatten(1, 2), wanted[alike]).argmin(dim=2)
        own = wanted[alike].gather(1, nearest[..., None].expand(-1, -1, 3))
        targets = targets.index_copy(0, alike, own.view_as(moved[alike]))
    return (moved - targets).norm(dim=3).mean(dim=2)


def pose_loss(
    quats: Tensor,
    offsets: Tensor,
    confidences: Tensor,
    points: Tensor,
    models: Tensor,
    wanted: Tensor,
    is_symmetric: Tensor,
) -> tuple[Tensor, Tensor]:
    """PoseNet's loss over B objects, and the mean distance of their most confident poses [m] (both scalar).

    Args:
        quats: (B, N, 4), offsets: (B, N, 3) [m], confidences: (B, N), as PoseNet answers.
        offsets: see ``quats``.
        confidences: see ``quats``.
        points: (B, N, 3) [m], in the camera's frame.
        models: (B, M, 3) points of the models [m].
        wanted: (B, M, 3) the same at the ground truth, in the camera's frame [m].
        is_symmetric: (B,) whether the object looks alike in other poses.
    """
    apart = distances(rotations(quats), points + offsets, models, wanted, is_symmetric)
    loss = (apart * confidences - CONFIDENCE_WEIGHT * torch.log(confidences)).mean()
    return loss, apart.detach().gather(1, confidences.argmax(dim=1, keepdim=True)).mean()


def refine_loss(quats: Tensor, shifts: Tensor, models: Tensor, wanted: Tensor, is_symmetric: Tensor) -> Tensor:
    """PoseRefineNet's loss over B objects (scalar) [m]: how far the poses are from right after its step.

    Args:
        quats: (B, 4), shifts: (B, 3) [m], as PoseRefineNet answers.
        shifts: see ``quats``.
        models: (B, M, 3) points of the models [m].
        wanted: (B, M, 3) the same at the ground truth, in the frames of the poses before the step [m].
        is_symmetric: as for :func:`pose_loss`.
    """
    return distances(rotations(quats)[:, None], shifts[:, None], models, wanted, is_symmetric).mean()
