"""What the training of DenseFusion lowers (Wang et al., CVPR 2019, Sec. 3.3-3.4). docs/methods.md 5.4."""

# pyright: reportMissingImports=false
from __future__ import annotations

import torch
from torch import Tensor

CONFIDENCE_WEIGHT = 0.015
"""w: a point that is not confident counts less, and pays this for it."""


def rotations(quats_wxyz: Tensor) -> Tensor:
    """The rotations (N, 3, 3) of quaternions (N, 4) of any length."""
    w, x, y, z = (quats_wxyz / quats_wxyz.norm(dim=1, keepdim=True)).unbind(dim=1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)


def distances(Rs: Tensor, ts: Tensor, model: Tensor, wanted: Tensor, is_symmetric: bool) -> Tensor:
    """ADD, or ADD-S of a symmetric object, of N poses (N,) [m].

    Args:
        Rs: (N, 3, 3).
        ts: (N, 3) [m].
        model: (M, 3) points of the model [m].
        wanted: (M, 3) where they belong [m].
        is_symmetric: each point then belongs to the nearest of ``wanted``.
    """
    moved = model @ Rs.transpose(1, 2) + ts[:, None]
    if is_symmetric:
        nearest = torch.cdist(moved.detach().reshape(-1, 3), wanted).argmin(dim=1)
        wanted = wanted[nearest].reshape(moved.shape)
    return (moved - wanted).norm(dim=2).mean(dim=1)


def pose_loss(
    quats: Tensor,
    offsets: Tensor,
    confidences: Tensor,
    points: Tensor,
    model: Tensor,
    wanted: Tensor,
    is_symmetric: bool,
) -> tuple[Tensor, Tensor]:
    """PoseNet's loss, and the distance of its most confident pose [m] (both scalar).

    Args:
        quats: (N, 4), offsets: (N, 3) [m], confidences: (N,), as PoseNet answers.
        offsets: see ``quats``.
        confidences: see ``quats``.
        points: (N, 3) [m], in the camera's frame.
        model: (M, 3) points of the model [m].
        wanted: (M, 3) the same at the ground truth, in the camera's frame [m].
        is_symmetric: whether the object looks alike in other poses.
    """
    apart = distances(rotations(quats), points + offsets, model, wanted, is_symmetric)
    loss = (apart * confidences - CONFIDENCE_WEIGHT * torch.log(confidences)).mean()
    return loss, apart[confidences.argmax()].detach()


def refine_loss(quat: Tensor, shift: Tensor, model: Tensor, wanted: Tensor, is_symmetric: bool) -> Tensor:
    """PoseRefineNet's loss (scalar) [m]: how far the pose is from right after its step.

    Args:
        quat: (4,), shift: (3,) [m], as PoseRefineNet answers.
        shift: see ``quat``.
        model: (M, 3) points of the model [m].
        wanted: (M, 3) the same at the ground truth, in the frame of the pose before the step [m].
        is_symmetric: as for :func:`pose_loss`.
    """
    return distances(rotations(quat[None]), shift[None], model, wanted, is_symmetric)[0]
