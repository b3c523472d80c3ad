"""A learned refiner: a small network sees depth, observed and rendered, and gives a step. docs/methods.md 4.4.

It knows no object: it was trained on shapes that are in no data set. What it sees is a crop around the object at the
current pose (:mod:`verefine_viz.learned.depth_crops`). Its step is coarse and its basin wide; ICP with a tight gate,
called afterwards, refines the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import DepthNetSettings, IcpSettings
from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.errors import InputError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.refiner_steps import RefinerStep, TrainedRange
from verefine_viz.learned.depth_crops import (
    ANSWERS,
    CHANNELS,
    DEEPEST,
    FORMAT,
    REACH,
    SIDE_PX,
    DepthCrops,
    Extent,
    crops_at,
    extent_of,
    moved_by,
)
from verefine_viz.learned.onnx_network import PACKAGED, OnnxNetwork
from verefine_viz.refiners.icp import Icp
from verefine_viz.rendering.prepared import MeshStore

NETWORK = "depth_net"
"""Its name in weights and settings."""
LARGEST_RAD, LARGEST_SHIFT = np.deg2rad(60.0), 1.0
"""Longest step [rad], [radii]: badly trained weights must not throw an object out of sight."""
TURN_RADII = 0.6
"""How far a turn by 1 rad moves an object's points on average, about [radii]."""
LEAST_SHARE = 0.7
"""A step shorter than this share of the error that the network expects after it is not taken: call after call, the pose
would wander among poses that depth cannot distinguish."""


@dataclass(frozen=True, eq=False)
class NetworkStep:
    """One step of the network from N poses."""

    channels: NDArray[np.float32]
    """(N, C, S, S) input of the network."""
    answers: Float
    """(N, 7) output of the network; 0 where the crop shows nothing."""
    Ts_cam_obj: Float
    """(N, 4, 4) the poses after it [m]."""


def weights_path(settings: DepthNetSettings) -> Path:
    """The file of the weights that the settings name."""
    return Path(settings.weights) if settings.weights else PACKAGED / f"{NETWORK}.onnx"


class DepthNet:
    """Refines poses by steps of the network.

    Args:
        settings: weights and number of steps.
        simplify_mm: deviation of the rendered mesh; the score's, so that one mesh serves both [mm].

    Raises:
        InputError: the weights cannot be read, or belong to another network.
    """

    def __init__(self, settings: DepthNetSettings, simplify_mm: float) -> None:
        self.settings = settings
        self._network = OnnxNetwork(weights_path(settings), NETWORK, FORMAT)
        self._meshes = MeshStore(simplify_mm)
        self._extents: WeakKeyDictionary[ObjectModel, Extent] = WeakKeyDictionary()

    @property
    def trained_range(self) -> TrainedRange | None:
        """Trained range, from the model card of the weights."""
        return self._network.card.trained_range

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); the given one where the mask holds no depth or the model does not show.

        Raises:
            InputError: the network's output is not finite, or has the wrong size.
        """
        return self.steps(target, T_cam_obj)[-1].Ts_cam_obj[0]

    def steps(self, target: Target, T_cam_obj: Float) -> list[NetworkStep]:
        """Every step from a pose (4, 4), with the network's input and output."""
        observation, instance = target.observation, target.instance
        mesh, extent = self._meshes.get(target.model), self._extent(target.model)
        Ts = finite(T_cam_obj, "pose to refine", (4, 4))[None]
        steps = []
        for _ in range(self.settings.iterations):
            crops = crops_at(observation.depth_m, instance.mask, observation.camera, mesh, extent, Ts)
            steps.append(step_from(Ts, crops, self._network, extent))
            Ts = steps[-1].Ts_cam_obj
        return steps

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        """The network's input and output, step by step; a step too short to be worth it is not taken."""
        extent = self._extent(target.model)
        return [
            self._explained(step.channels[0], step.answers[0], extent)
            for step in self.steps(target, T_cam_obj)
            if step.channels.any()
        ]

    def _explained(self, channels: NDArray[np.float32], answer: Float, extent: Extent) -> RefinerStep:
        of: dict[str, NDArray[np.float32]] = dict(zip(CHANNELS, channels, strict=True))
        both = (of["own"] > 0) & (of["drawn"] > 0)
        shown = {"observed": of["measured"] > 0, "rendered": of["drawn"] > 0, "difference": both}
        step, expected_radii = _bounded(answer), float(np.exp(answer[6]))
        trained = self.trained_range
        return RefinerStep(
            crops={name: np.where(where, of[name], np.float32(np.nan)) for name, where in shown.items()}
            | {"masks": of["own"] + 2 * of["drawn"]},
            limits={
                "observed": (-DEEPEST, DEEPEST),
                "rendered": (-DEEPEST, DEEPEST),
                "difference": (-1.0, 1.0),
                "masks": (0.0, 3.0),
            },
            turn=step[:3],
            shift_m=step[3:] * extent.radius_m,
            centre_px=np.full(2, (SIDE_PX - 1) / 2),
            px_per_m=SIDE_PX / (2 * REACH * extent.radius_m),
            is_taken=_is_worth_it(step, answer),
            expected_mm=1e3 * expected_radii * extent.radius_m,
            trained_mm=None if trained is None else 1e3 * _largest_error(trained) * extent.radius_m,
        )

    def _extent(self, model: ObjectModel) -> Extent:
        extent = self._extents.get(model)
        if extent is None:
            extent = self._extents[model] = extent_of(model.vertices, model.diameter_m)
        return extent


class DepthNetIcp:
    """The network first, then ICP with the tight gate throughout, which cannot undo what the network achieved.

    Args:
        net: the network.
        icp: settings of the ICP that follows, except its gate.
    """

    def __init__(self, net: DepthNet, icp: IcpSettings) -> None:
        self._net, self._icp = net, Icp(structs.replace(icp, gate="published"))

    @property
    def trained_range(self) -> TrainedRange | None:
        """Trained range of the network, which runs first."""
        return self._net.trained_range

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); as :meth:`DepthNet.refine`."""
        return self._icp.refine(target, self._net.refine(target, T_cam_obj, fixed), fixed)

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        """The steps of the network, which runs first."""
        return self._net.explain(target, T_cam_obj)


def step_from(Ts_cam_obj: Float, crops: DepthCrops, network: OnnxNetwork, extent: Extent) -> NetworkStep:
    """The network's step from N poses (N, 4, 4) with their crops; a pose whose crop shows nothing stays as it is."""
    answers = network(crops.channels)
    if answers.shape != (len(Ts_cam_obj), ANSWERS):
        raise InputError(
            f"weights {network.path} give {' × '.join(map(str, answers.shape))} numbers for {len(Ts_cam_obj)} crops, "
            f"expected {len(Ts_cam_obj)} × {ANSWERS}; see verefine-viz train {NETWORK}"
        )
    answers[~crops.is_usable] = 0.0
    poses = [
        moved_by(T, _taken(answer), R, extent) if is_usable else T
        for T, answer, R, is_usable in zip(Ts_cam_obj, answers, crops.Rs_crop_cam, crops.is_usable, strict=True)
    ]
    return NetworkStep(crops.channels, answers, np.stack(poses))


def _taken(answer: Float) -> Float:
    """The step (6,) of an answer (7,); 0 where it is not worth it."""
    step = _bounded(answer)
    return step if _is_worth_it(step, answer) else np.zeros(6)


def _bounded(answer: Float) -> Float:
    """The step (6,) of an answer (7,), its turn and shift limited to the longest step."""
    step = answer[:6].copy()
    for part, longest in ((step[:3], LARGEST_RAD), (step[3:], LARGEST_SHIFT)):
        length = float(np.sqrt(part @ part))
        if length > longest:
            part *= longest / length
    return step


def _is_worth_it(step: Float, answer: Float) -> bool:
    moved = TURN_RADII * np.sqrt(step[:3] @ step[:3]) + np.sqrt(step[3:] @ step[3:])
    return bool(moved > LEAST_SHARE * np.exp(answer[6]))


def _largest_error(trained: TrainedRange) -> float:
    """Mean error of the points of a pose at the limit of the trained range [radii]."""
    return TURN_RADII * float(np.deg2rad(trained.rotation_deg)) + trained.shift_radii
