"""What a built-in scene is made of, and how its objects come to rest on the table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.rest import settle_to_rest
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.demo_view import Viewpoint
from verefine_viz.scenes.sensor import Sensor


@dataclass(frozen=True)
class Item:
    """An object, as it is let go above the table."""

    model: str
    """Name in :mod:`demo_models`."""
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0
    """About the vertical, after the tilt."""
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """About its own x, then y axis: which side is down."""
    drop_m: float = 0.004
    """Height of its lowest point above the table when it is let go; to land on another object, let it go above that."""
    is_asked_for: bool = True
    """False: it lies there, has no mask, and nobody estimates its pose."""
    seen_as: str = ""
    """The model that depth and mask show instead, such as a jug without its glass handle; empty = the model itself."""


@dataclass(frozen=True)
class MaskFault:
    """What is wrong with an instance's mask."""

    grow_px: int = 0
    """Dilated by so many pixels, or eroded if negative."""
    leaks_onto: int | None = None
    """Index of the item of which the mask swallows the visible pixels."""


FirstPoses = Callable[[Float, Float, np.random.Generator], tuple[tuple[Float, str], ...]]
"""(true T_world_obj, T_world_cam, generator) → first poses T_world_obj with their descriptions, best first."""


@dataclass(frozen=True)
class DemoScene:
    """A built-in scene; its frames are its viewpoints."""

    title: str
    """For people, in plain words."""
    items: tuple[Item, ...]
    """In the order in which they are let go, one after the other."""
    views: tuple[Viewpoint, ...] = (Viewpoint(),)
    sensor: Sensor = field(default_factory=Sensor)
    blind: Callable[[NDArray[np.int32], Float], Mask] | None = None
    """(labels (H, W), points_world (H, W, 3)) → pixels (H, W) that are not measured, on top of the sensor's own."""
    mask_faults: dict[int, MaskFault] = field(default_factory=dict)
    """By index of the item."""
    first_poses: FirstPoses | None = None
    """How the hypotheses of this scene come about; None = perturbed ground truth as the settings say."""
    note: str = ""
    """What a person should know about the scene."""


LAYOUT_FRAME = Support(np.eye(4), np.array([0.0, 0.0, 1.0]), "given", 1.0)
"""Objects are laid out without any camera: the world takes its place."""


def prepare(items: Sequence[Item], patience: Patience = ENDLESS) -> None:
    """Builds what :func:`settled` needs and what is then kept on disk: most of its time, when it is first asked.

    Raises:
        Cancelled: nobody waits for it any more.
    """
    simulator = BulletSimulator(PhysicsSettings(), patience=patience)
    for item in items:
        patience.ask()
        simulator.collider(_body(item))


@cache
def settled(items: tuple[Item, ...]) -> tuple[Float, ...]:
    """Where items come to rest: T_world_obj (4, 4) each."""
    simulator = BulletSimulator(PhysicsSettings())
    resting: list[Placed] = []
    for k, item in enumerate(items):
        model = _body(item)
        tilt = axis_angle([0, 1, 0], np.deg2rad(item.tilt_deg[1])) @ axis_angle([1, 0, 0], np.deg2rad(item.tilt_deg[0]))
        R = axis_angle([0, 0, 1], np.deg2rad(item.yaw_deg)) @ tilt
        lowest_m = float((model.vertices @ R[2]).min())
        falling = Placed(k, model, transform(R, [item.x_m, item.y_m, item.drop_m - lowest_m]))
        path = settle_to_rest(simulator, falling, resting, LAYOUT_FRAME)
        resting.append(Placed(k, model, path.T_cam_obj))
    return tuple(p.T_cam_obj for p in resting)


def _body(item: Item) -> ObjectModel:
    """What falls; its points play no part in it."""
    return demo_model(item.model, 100, 0)
