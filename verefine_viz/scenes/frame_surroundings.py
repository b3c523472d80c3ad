"""The world of a frame as settings have it: a plane alone, what the depth shows, or a mesh; docs/methods.md 7.4."""

from __future__ import annotations

from dataclasses import replace

from verefine_viz.core.errors import unknown
from verefine_viz.core.observation import Observation
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.observation.observed_support import observed_surroundings
from verefine_viz.scenes.environment_mesh import mesh_surroundings

AROUND = "physics.support: "
"""How notes on the surroundings begin."""


def with_surroundings(
    observation: Observation, frame: str, physics: PhysicsSettings
) -> tuple[Observation, tuple[str, ...]]:
    """The observation in the world of ``physics``, and notes where that is not as it was asked for.

    Raises:
        VerefineError: the mesh of the surroundings cannot be used.
    """
    support, around, notes = observation.support, None, ()
    if support is None:
        return observation, ()
    if physics.support == "mesh":
        around = mesh_surroundings(physics, observation, support)
    if physics.support == "observed":
        dropped = {number for name, number in physics.dropped if name == frame}
        around = observed_surroundings(observation, support, dropped)
        numbers = [one.number for one in around.unknown] if around is not None else []
        absent = sorted(dropped.difference(numbers)) if around is not None else []
        notes = tuple(f"{AROUND}{unknown('unknown object', n, numbers)}; none is dropped for it" for n in absent)
        if around is None:
            notes = (f"{AROUND}too little is seen outside of the objects; the support plane is used instead",)
    if around is support.surroundings:
        return observation, notes
    return replace(observation, support=replace(support, surroundings=around)), notes
