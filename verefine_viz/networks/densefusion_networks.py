"""The two networks of DenseFusion (Wang et al., CVPR 2019), with the names and shapes of the official weights.

docs/methods.md 5. The networks take one crop at a time: its size follows the object's mask, so that crops cannot be
batched. The official implementation wraps the colour branch in ``DataParallel``, whose ``module`` is in the names.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

POINT_FEATURES = (64, 128)
"""Features of a point, and as many of its pixel's colour, after the first and the second layer."""
PYRAMID = (1, 2, 3, 6)
"""Cells along each side of the pooling pyramid's levels."""
AUXILIARY = 21
"""Classes of an unused layer that the official weights have."""


@dataclass(frozen=True)
class Size:
    """Width of the networks."""

    stages: tuple[int, int, int, int]
    """Channels of the residual stages."""
    pyramid: int
    """Channels after the pooling pyramid."""
    enlarged: tuple[int, int, int]
    """Channels after each enlargement."""
    colour: int
    """Numbers that describe the colour around a pixel."""
    fused: tuple[int, int]
    """Channels of the layer before the features of the whole object, and number of these features."""
    head: tuple[int, int, int]
    """Hidden layers of the heads of PoseNet."""
    refiner_head: tuple[int, int]
    """Hidden layers of the heads of PoseRefineNet."""
    largest_colour: float
    """Divisor of colours: 1 for the official weights, which take them from 0 to 255."""
    unit_m: float
    """Unit of lengths inside [m]."""
    is_centred: bool
    """Whether PoseNet sees the points relative to their mean, instead of to the camera."""
    is_halved: bool
    """Whether the colour branch sees the crop at half its height and width."""
    dropout: tuple[float, float]
    """Dropout of channels in training after the pyramid and after each enlargement."""


OFFICIAL = Size(
    stages=(64, 128, 256, 512),
    pyramid=1024,
    enlarged=(256, 64, 64),
    colour=32,
    fused=(512, 1024),
    head=(640, 256, 128),
    refiner_head=(512, 128),
    largest_colour=1.0,
    unit_m=1.0,
    is_centred=False,
    is_halved=False,
    dropout=(0.3, 0.15),
)
SLIM = Size(
    stages=(16, 32, 48, 64),
    pyramid=64,
    enlarged=(32, 16, 16),
    colour=32,
    fused=(128, 256),
    head=(192, 96, 64),
    refiner_head=(192, 96),
    largest_colour=255.0,
    unit_m=0.1,
    is_centred=True,
    is_halved=True,
    dropout=(0.0, 0.0),
)
"""Ours: a twentieth of the parameters, for training and inference on a processor. Its numbers are near 1, so that it
learns in minutes: it takes long to learn to subtract a distance of 1 m from points that are 1 cm apart."""


class _Block(nn.Module):
    """Two convolutions of 3 × 3 beside a shortcut; no normalisation."""

    def __init__(self, n_in: int, n_out: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(n_in, n_out, 3, stride, dilation, dilation, bias=False)
        self.conv2 = nn.Conv2d(n_out, n_out, 3, 1, dilation, dilation, bias=False)
        self.downsample = None
        if stride != 1 or n_in != n_out:
            self.downsample = nn.Sequential(nn.Conv2d(n_in, n_out, 1, stride, bias=False))

    def forward(self, x: Tensor) -> Tensor:
        shortcut = x if self.downsample is None else self.downsample(x)
        return torch.relu(self.conv2(torch.relu(self.conv1(x))) + shortcut)


class _ResNet(nn.Module):
    """ResNet-18 whose last two stages are dilated instead of strided: (1, 3, H, W) → (1, C, H / 8, W / 8)."""

    def __init__(self, stages: tuple[int, int, int, int]) -> None:
        super().__init__()
        a, b, c, d = stages
        self.conv1 = nn.Conv2d(3, a, 7, 2, 3, bias=False)
        self.layer1 = nn.Sequential(_Block(a, a), _Block(a, a))
        self.layer2 = nn.Sequential(_Block(a, b, stride=2), _Block(b, b))
        self.layer3 = nn.Sequential(_Block(b, c), _Block(c, c, dilation=2))
        self.layer4 = nn.Sequential(_Block(c, d), _Block(d, d, dilation=4))

    def forward(self, image: Tensor) -> Tensor:
        x = F.max_pool2d(torch.relu(self.conv1(image)), 3, 2, 1)
        return self.layer4(self.layer3(self.layer2(self.layer1(x))))


class _Pool(nn.Module):
    """Means over n × n cells, as ``AdaptiveAvgPool2d``, in operations that ONNX has for maps of any size."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.n = n

    def forward(self, x: Tensor) -> Tensor:
        return self._cells(x.shape[2]) @ x @ self._cells(x.shape[3]).T

    def _cells(self, length: int) -> Tensor:
        """(n, length) the share of each pixel in each cell; cells overlap where n does not divide the length."""
        pixel, cell = torch.arange(length)[None, :], torch.arange(self.n)[:, None]
        first, end = cell * length // self.n, ((cell + 1) * length + self.n - 1) // self.n
        inside = ((pixel >= first) & (pixel < end)).float()
        return inside / inside.sum(dim=1, keepdim=True)


class _Pyramid(nn.Module):
    """Features beside their means over ever smaller cells."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        self.stages = nn.ModuleList(nn.Sequential(_Pool(n), nn.Conv2d(n_in, n_in, 1, bias=False)) for n in PYRAMID)
        self.bottleneck = nn.Conv2d(n_in * (len(PYRAMID) + 1), n_out, 1)

    def forward(self, x: Tensor) -> Tensor:
        size = x.shape[2:]
        levels = [F.interpolate(stage(x), size=size, mode="bilinear", align_corners=False) for stage in self.stages]
        return torch.relu(self.bottleneck(torch.cat([*levels, x], dim=1)))


class _Enlarge(nn.Module):
    """Twice the height and width."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        up = nn.Upsample(scale_factor=2, mode="bilinear", align_corners=True)
        self.conv = nn.Sequential(up, nn.Conv2d(n_in, n_out, 3, padding=1), nn.PReLU())

    def forward(self, x: Tensor) -> Tensor:
        return self.conv(x)


class _PspNet(nn.Module):
    """The colour branch: image (1, 3, H, W) → (1, E, H, W), H and W multiples of 8."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        a, b, c = size.enlarged
        self._dropout = size.dropout
        self.feats = _ResNet(size.stages)
        self.psp = _Pyramid(size.stages[3], size.pyramid)
        self.up_1, self.up_2, self.up_3 = _Enlarge(size.pyramid, a), _Enlarge(a, b), _Enlarge(b, c)
        self.final = nn.Sequential(nn.Conv2d(c, size.colour, 1), nn.LogSoftmax(dim=1))
        self.classifier = nn.Sequential(
            nn.Linear(size.stages[2], size.stages[2]), nn.ReLU(), nn.Linear(size.stages[2], AUXILIARY)
        )

    def forward(self, image: Tensor) -> Tensor:
        first, later = self._dropout
        x = F.dropout2d(self.psp(self.feats(image)), first, self.training)
        x = F.dropout2d(self.up_1(x), later, self.training)
        x = F.dropout2d(self.up_2(x), later, self.training)
        return self.final(self.up_3(x))


class _Module(nn.Module):
    """Layer between ``cnn`` and the colour branch in the names of the official weights."""

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.module = module


class _Colours(nn.Module):
    """The colour branch under its official name."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.model = _Module(_PspNet(size))
        self._largest, self._is_halved = size.largest_colour, size.is_halved

    def forward(self, image: Tensor) -> Tensor:
        if not self._is_halved:
            return self.model.module(image / self._largest)
        colours = self.model.module(F.avg_pool2d(image / self._largest, 2))
        return F.interpolate(colours, size=image.shape[2:], mode="nearest")


class _Fusion(nn.Module):
    """Points (1, 3, N) and colours (1, E, N) → features of each pair (1, 384, N), and of the object (1, G, N)."""

    def __init__(self, size: Size, n_object: int) -> None:
        super().__init__()
        a, b = POINT_FEATURES
        self.conv1, self.conv2 = nn.Conv1d(3, a, 1), nn.Conv1d(a, b, 1)
        self.e_conv1, self.e_conv2 = nn.Conv1d(size.colour, a, 1), nn.Conv1d(a, b, 1)
        self.conv5, self.conv6 = nn.Conv1d(n_object, size.fused[0], 1), nn.Conv1d(*size.fused, 1)
        self._n_object = n_object

    def forward(self, points: Tensor, colours: Tensor) -> tuple[Tensor, Tensor]:
        x, e = torch.relu(self.conv1(points)), torch.relu(self.e_conv1(colours))
        near = torch.cat([x, e], dim=1)
        x, e = torch.relu(self.conv2(x)), torch.relu(self.e_conv2(e))
        pairs = torch.cat([near, x, e], dim=1)
        # PoseNet makes the object's features from the second layer alone, PoseRefineNet from both.
        whole = torch.relu(self.conv6(torch.relu(self.conv5(pairs[:, -self._n_object :]))))
        return pairs, whole


class PoseNet(nn.Module):
    """A pose from each of N points of an object.

    Args:
        n_classes: objects that it knows.
        size: width of the network.
    """

    def __init__(self, n_classes: int, size: Size = OFFICIAL) -> None:
        super().__init__()
        second = 2 * POINT_FEATURES[1]
        self.n_classes = n_classes
        self._unit_m, self._is_centred = size.unit_m, size.is_centred
        self.cnn = _Colours(size)
        self.feat = _Fusion(size, second)
        widths = (2 * POINT_FEATURES[0] + second + size.fused[1], *size.head)
        for head, n in (("r", 4), ("t", 3), ("c", 1)):
            for k in range(3):
                self.add_module(f"conv{k + 1}_{head}", nn.Conv1d(widths[k], widths[k + 1], 1))
            self.add_module(f"conv4_{head}", nn.Conv1d(widths[3], n * n_classes, 1))

    def forward(
        self, image: Tensor, points: Tensor, chosen: Tensor, index: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Per point: quaternion wxyz, not normalised (N, 4), offset from the point (N, 3) [m], confidence (N,); and
        the colours' description (1, E, N).

        Args:
            image: (1, 3, H, W) the crop, H and W multiples of 8.
            points: (1, N, 3) [m], in the camera's frame.
            chosen: (N,) where the points lie in the flattened crop.
            index: (1,) number of the object's class.
        """
        colours = self.cnn(image).flatten(2)[:, :, chosen]
        quats, offsets, confidences = self.poses(points, colours, index)
        return quats[0], offsets[0], confidences[0], colours

    def poses(self, points: Tensor, colours: Tensor, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Poses of the points (B, N, 3) and colours (B, E, N) of B objects: (B, N, 4), (B, N, 3) and (B, N)."""
        seen = points - points.mean(dim=1, keepdim=True) if self._is_centred else points
        pairs, whole = self.feat(seen.transpose(1, 2) / self._unit_m, colours)
        features = torch.cat([pairs, whole.mean(dim=2, keepdim=True).expand_as(whole)], dim=1)
        r, t, c = (self._head(name, features, index) for name in "rtc")
        return r, t * self._unit_m, torch.sigmoid(c[:, :, 0])

    def _head(self, name: str, x: Tensor, index: Tensor) -> Tensor:
        """(B, N, n) output of a head for each object's class."""
        for k in range(3):
            x = torch.relu(self.get_submodule(f"conv{k + 1}_{name}")(x))
        every = self.get_submodule(f"conv4_{name}")(x).unflatten(1, (self.n_classes, -1))
        return every[torch.arange(len(x)), index].transpose(1, 2)


class PoseRefineNet(nn.Module):
    """A step from the current pose.

    Args:
        n_classes: objects that it knows.
        size: width of the network; equal to PoseNet's.
    """

    def __init__(self, n_classes: int, size: Size = OFFICIAL) -> None:
        super().__init__()
        self.n_classes = n_classes
        self._unit_m = size.unit_m
        self.feat = _Fusion(size, 2 * sum(POINT_FEATURES))
        widths = (size.fused[1], *size.refiner_head)
        for head, n in (("r", 4), ("t", 3)):
            for k in range(2):
                self.add_module(f"conv{k + 1}_{head}", nn.Linear(widths[k], widths[k + 1]))
            self.add_module(f"conv3_{head}", nn.Linear(widths[2], n * n_classes))

    def forward(self, points: Tensor, colours: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        """Quaternion wxyz, not normalised (4,), and shift (3,) [m], both in the frame of the current pose.

        Args:
            points: (1, N, 3) [m], in the frame of the current pose.
            colours: (1, E, N) as PoseNet gives it.
            index: (1,) number of the object's class.
        """
        quats, shifts = self.steps(points, colours, index)
        return quats[0], shifts[0]

    def steps(self, points: Tensor, colours: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        """Steps of B poses at once: (B, 4) and (B, 3) [m] of (B, N, 3), (B, E, N) and (B,)."""
        whole = self.feat(points.transpose(1, 2) / self._unit_m, colours)[1].mean(dim=2)
        r, t = (self._head(name, whole, index) for name in "rt")
        return r, t * self._unit_m

    def _head(self, name: str, x: Tensor, index: Tensor) -> Tensor:
        for k in range(2):
            x = torch.relu(self.get_submodule(f"conv{k + 1}_{name}")(x))
        every = self.get_submodule(f"conv3_{name}")(x).view(len(x), self.n_classes, -1)
        return every[torch.arange(len(x)), index]


def pose_net_example() -> tuple[tuple[Tensor, ...], tuple[dict[int, Any] | None, ...]]:
    """Example inputs of PoseNet and their variable sizes, for the export."""
    height, width, n = (torch.export.Dim(name, min=2, max=2**14) for name in ("height", "width", "points"))
    image, chosen = torch.zeros(1, 3, 80, 120), torch.arange(50)
    return (image, torch.zeros(1, 50, 3), chosen, torch.tensor([0])), (
        {2: 8 * height, 3: 8 * width},
        {1: n},
        {0: n},
        None,
    )


def refine_net_example(n_colours: int) -> tuple[tuple[Tensor, ...], tuple[dict[int, Any] | None, ...]]:
    """Example inputs of PoseRefineNet, for colours that so many numbers describe."""
    n = torch.export.Dim("points", min=2, max=2**14)
    return (torch.zeros(1, 50, 3), torch.zeros(1, n_colours, 50), torch.tensor([0])), ({1: n}, {2: n}, None)
