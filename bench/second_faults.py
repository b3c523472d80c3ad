"""A second, smaller fault put into a made-up scene in which something else is broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from tests.failing_scenes import GENERATORS
from tests.made_up_frames import SETTINGS, Broken, leaning, level, seen_through
from verefine_viz.core.arrays import Mask
from verefine_viz.core.causes import Cause
from verefine_viz.studies.disturbance import without_depth


def lost_depth(broken: Broken, rng: np.random.Generator) -> Broken:
    """A tenth to a quarter of the object has no depth, on one side."""
    mask = broken.problem.target(broken.instance_id).instance.mask
    lost = _one_side(mask, rng.uniform(0.1, 0.25), rng)
    return replace(broken, problem=without_depth(broken.problem, lost))


def loose_mask(broken: Broken, rng: np.random.Generator) -> Broken:
    """The mask is 2 px too wide, or leaves out a tenth of the object."""
    instance = broken.problem.target(broken.instance_id).instance
    wide = np.asarray(binary_dilation(instance.mask, iterations=2), dtype=bool)
    mask = wide if rng.random() < 0.5 else instance.mask & ~_one_side(instance.mask, 0.1, rng)
    spoilt = seen_through(mask, instance, broken.problem.observation, SETTINGS.cloud_points)
    instances = tuple(spoilt if i is instance else i for i in broken.problem.instances)
    return replace(broken, problem=replace(broken.problem, instances=instances))


def leaning_plane(broken: Broken, rng: np.random.Generator) -> Broken:
    """The support plane is tilted by 4-8° and some millimetres off."""
    observation = broken.problem.observation
    if observation.support is None:
        return broken
    heading, angle_deg, down_m = rng.uniform(0, 2 * np.pi), rng.uniform(4, 8), rng.uniform(-0.005, 0.005)
    support = leaning(observation.support, level(heading), angle_deg, down_m)
    return replace(broken, problem=replace(broken.problem, observation=replace(observation, support=support)))


def short_budget(broken: Broken, rng: np.random.Generator) -> Broken:
    """One iteration less per hypothesis, where there is more than one."""
    iterations = broken.toolbox.session.method.iterations
    toolbox = broken.toolbox.restarted({"method": {"iterations": max(iterations - 1, 1)}})
    return replace(broken, toolbox=toolbox)


SECOND: dict[Cause, Callable[[Broken, np.random.Generator], Broken]] = {
    Cause.DEPTH: lost_depth,
    Cause.MASK: loose_mask,
    Cause.PLANE: leaning_plane,
    Cause.BUDGET: short_budget,
}
"""Smaller faults, by what they would be called."""


def with_second(broken: Broken, seed: int) -> tuple[Broken, Cause]:
    """The scene with one smaller fault of another kind, and which."""
    rng = np.random.default_rng((77, list(GENERATORS).index(broken.cause), seed))
    kinds = [cause for cause in SECOND if cause != broken.cause]
    kind = kinds[rng.integers(len(kinds))]
    return SECOND[kind](broken, rng), kind


def _one_side(mask: Mask, part: float, rng: np.random.Generator) -> Mask:
    """That part of a mask's pixels which lies furthest in some direction of the image."""
    v, u = np.nonzero(mask)
    heading = rng.uniform(0, 2 * np.pi)
    furthest = np.argsort(np.cos(heading) * u + np.sin(heading) * v)[: round(part * len(v))]
    side = np.zeros_like(mask)
    side[v[furthest], u[furthest]] = True
    return side
