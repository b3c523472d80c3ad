"""The network of ``depth_net`` and its loss. docs/methods.md 4.4."""

# pyright: reportMissingImports=false
from __future__ import annotations

import torch
from torch import Tensor, nn

from verefine_viz.learned.depth_crops import ANSWERS, CHANNELS, SIDE_PX

WIDTHS = (16, 32, 80)
"""Channels at half, a quarter and an eighth of the crop's size."""
HIDDEN = 128
"""Width of the layer before the answer."""
SMALLEST = 0.3
"""Added to the error at the start, which divides the remaining error [radii]: near poses count more, but not without
limit."""
FLOOR = 0.003
"""Added to the remaining error before its logarithm [radii]: smaller errors are not distinguished."""
CERTAINTY_WEIGHT = 0.05
"""Weight of the predicted error's own loss."""


class _ResidualBlock(nn.Module):
    """Two convolutions of 3 × 3 beside a shortcut."""

    def __init__(self, n_in: int, n_out: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False)
        self.first_norm = nn.BatchNorm2d(n_out)
        self.second = nn.Conv2d(n_out, n_out, 3, 1, 1, bias=False)
        self.second_norm = nn.BatchNorm2d(n_out)
        self.shortcut: nn.Module = nn.Identity()
        if stride > 1:
            self.shortcut = nn.Sequential(nn.Conv2d(n_in, n_out, 1, stride, bias=False), nn.BatchNorm2d(n_out))
        nn.init.zeros_(self.second_norm.weight)  # At first a block passes only its shortcut, which trains faster.

    def forward(self, x: Tensor) -> Tensor:
        y = torch.relu(self.first_norm(self.first(x)))
        return torch.relu(self.second_norm(self.second(y)) + self.shortcut(x))


class DepthNetModel(nn.Module):
    """Crops (B, C, S, S) → answers (B, 7): a residual CNN whose last map keeps positions."""

    def __init__(self) -> None:
        super().__init__()
        a, b, c = WIDTHS
        self.stem = nn.Sequential(
            nn.Conv2d(len(CHANNELS), a, 5, 2, 2, bias=False), nn.BatchNorm2d(a), nn.ReLU(), _ResidualBlock(a, a, 1)
        )
        self.trunk = nn.Sequential(
            _ResidualBlock(a, b, 2), _ResidualBlock(b, b, 1), _ResidualBlock(b, c, 2), _ResidualBlock(c, c, 1)
        )
        side = SIDE_PX // 8
        # Without this norm the head dies at the learning rate that the trunk needs, and learns shifts but no turns.
        hidden = nn.Linear(c * side * side, HIDDEN, bias=False), nn.BatchNorm1d(HIDDEN), nn.ReLU()
        answer = nn.Linear(HIDDEN, ANSWERS)
        nn.init.zeros_(answer.weight)  # The first answer is a zero step.
        nn.init.zeros_(answer.bias)
        self.head = nn.Sequential(nn.Flatten(), *hidden, answer)

    def forward(self, crops: Tensor) -> Tensor:
        return self.head(self.trunk(self.stem(crops)))


def rotations(vectors: Tensor) -> Tensor:
    """The rotations (B, 3, 3) of rotation vectors (B, 3) [rad]."""
    squared = (vectors * vectors).sum(dim=1)[:, None, None]
    angle = torch.sqrt(squared + 1e-12)
    x, y, z = vectors.unbind(dim=1)
    zero = torch.zeros_like(x)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)
    return torch.eye(3) + torch.sin(angle) / angle * K + (1 - torch.cos(angle)) / angle**2 * (K @ K)


def errors_left(answers: Tensor, points: Tensor, wanted: Tensor) -> Tensor:
    """Mean distance (B,) of points (B, P, 3) moved by the answers, from their true places [radii]."""
    moved = points @ rotations(answers[:, :3]).transpose(1, 2) + answers[:, None, 3:6]
    return torch.sqrt(((moved - wanted) ** 2).sum(dim=2) + 1e-10).mean(dim=1)


def loss_of(answers: Tensor, points: Tensor, wanted: Tensor) -> tuple[Tensor, Tensor]:
    """The loss, and the mean remaining error (both scalar).

    The loss is the remaining error as a share of the error before, plus the deviation of its predicted logarithm.
    """
    left = errors_left(answers, points, wanted)
    before = (points - wanted).norm(dim=2).mean(dim=1)
    certainty = (answers[:, 6] - torch.log(left.detach() + FLOOR)).abs()
    return (left / (before + SMALLEST) + CERTAINTY_WEIGHT * certainty).mean(), left.detach().mean()
