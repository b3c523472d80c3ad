"""Simulators by name: Bullet, and those of other programs, which give the path of an object and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError, ShapeError, unknown
from verefine_viz.core.geometry import as_rigid, n_within_reach
from verefine_viz.core.observation import Support
from verefine_viz.core.own_parts import NO_PARTS, Lender, OwnParts
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import PoseSimulator, Simulator
from verefine_viz.core.records import NO_CONTACTS, SimulatedPath
from verefine_viz.core.settings import BULLET, PhysicsSettings

SAME_START = 1e-3
"""Largest deviation of an entry of a path's first pose from the given pose [-, m]."""
SIMULATORS: dict[str, Callable[[PhysicsSettings], PoseSimulator]] = {}
"""Beside Bullet. A new one is a class with ``settle`` (core.protocols.PoseSimulator) and a line here; docs/guide.md,
"Your own simulator"."""


def simulator_names() -> tuple[str, ...]:
    """What ``physics.simulator`` may be."""
    return (BULLET, *SIMULATORS)


def make_simulator(
    settings: PhysicsSettings, progress: ProgressToken = NEVER_CANCELLED, own: OwnParts = NO_PARTS
) -> Simulator | None:
    """The simulator that the settings ask for; None where they switch physics off.

    Args:
        settings: of physics.
        progress: checked while Bullet's collider of a model is built.
        own: parts of the caller, preferred to others of the same name.

    Raises:
        SettingsError: no simulator has that name; lists those that exist.
    """
    if not settings.enabled:
        return None
    if settings.simulator in own.simulators:
        return PluggedSimulator(settings.simulator, own.simulators[settings.simulator])
    if settings.simulator == BULLET:
        from verefine_viz.physics.simulator import BulletSimulator

        return BulletSimulator(settings, progress=progress)
    if settings.simulator not in SIMULATORS:
        raise SettingsError(unknown("simulator", settings.simulator, simulator_names()))
    return PluggedSimulator(settings.simulator, SIMULATORS[settings.simulator](settings))


class PluggedSimulator:
    """Wraps a part that moves an object as a simulator (core.protocols): without contacts, so it cannot tell tipping.

    Args:
        name: in settings.
        simulator: of another program.
    """

    def __init__(self, name: str, simulator: PoseSimulator) -> None:
        self.name = name
        self._simulator, self._lender = simulator, Lender(f"simulator {name}")

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> SimulatedPath:
        """The path of ``moving`` over ``n_steps`` steps; it ends where the object leaves the reach of the camera.

        Raises:
            ShapeError: the simulator returns the wrong number of poses, an invalid pose, or a path that does not begin
                at the given pose.
            PartError: the simulator raises an exception.
        """
        who = f"simulator {self.name}"
        with self._lender.call(moving, fixed, support, n_steps) as lent:
            poses: Float = np.asarray(self._simulator.settle(*lent), dtype=np.float64)
        if poses.shape != (n_steps + 1, 4, 4):
            raise ShapeError(f"{who} gave poses of shape {poses.shape} for {n_steps} steps, expected {n_steps + 1}×4×4")
        path = np.stack([as_rigid(T, f"pose {k} of {who}") for k, T in enumerate(poses)])
        if not np.allclose(path[0], moving.T_cam_obj, rtol=0, atol=SAME_START):
            raise ShapeError(f"the path of {who} does not begin at the given pose; expected that pose first")
        path = path[: n_within_reach(path)]
        return SimulatedPath(path, (NO_CONTACTS,) * (len(path) - 1))
