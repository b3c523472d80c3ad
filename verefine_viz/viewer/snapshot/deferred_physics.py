"""What physics says about the whole scene at the cursor: worked out bit by bit while nothing else waits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.viewer.snapshot.scene_state import SceneState
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator


@dataclass(frozen=True, eq=False)
class ScenePhysics:
    """What is known by now."""

    plausible: dict[int, Any] = field(default_factory=dict)
    """By instance_id: plausibility of its pose among the other objects."""
    overlaps: tuple[Any, ...] = ()
    """Pairs of objects that are partly in the same place, deepest first."""
    complete: bool = True
    """Whether everything was looked at."""


def others_of(scene: SceneState, instance_id: int) -> tuple[Placed, ...]:
    """The other objects where they stand."""
    return tuple(o.placed for o in scene.objects if o.placed is not None and o.instance_id != instance_id)


def known_physics(scene: SceneState, evaluator: CachedEvaluator) -> ScenePhysics:
    """What was worked out before; asks for nothing."""
    plausible = {}
    standing = [o for o in scene.objects if o.T_cam_obj is not None]
    for o in standing:
        assert o.T_cam_obj is not None
        found = evaluator.known_plausibility(o.target, o.T_cam_obj, others_of(scene, o.instance_id))
        if found is not None:
            plausible[o.instance_id] = found
    pairs = [evaluator.known_overlap(a, b) for a, b in _pairs(scene)]
    overlaps = sorted((found for _, found in pairs if found is not None), key=lambda found: -found.depth_mm)
    complete = all(known for known, _ in pairs) and len(plausible) == len(standing)
    return ScenePhysics(plausible, tuple(overlaps), complete)


def work_out(
    scene: SceneState, evaluator: CachedEvaluator, poses: Sequence[tuple[Target, Float]] = ()
) -> Iterator[None]:
    """Asks for one thing per turn: overlaps, then ``poses`` and the pose of each object among the others."""
    for a, b in _pairs(scene):
        if not evaluator.known_overlap(a, b)[0]:
            evaluator.overlap(a, b)
            yield
    standing = [(o.target, o.T_cam_obj) for o in scene.objects if o.T_cam_obj is not None]
    for target, T_cam_obj in (*poses, *standing):
        others = others_of(scene, target.instance.instance_id)
        if evaluator.known_plausibility(target, T_cam_obj, others) is None:
            evaluator.plausibility(target, T_cam_obj, others)
            yield


def _pairs(scene: SceneState) -> list[tuple[Placed, Placed]]:
    """Every two objects; the one that is solved later first, since it is what sinks into the other."""
    placed = [o.placed for o in scene.objects if o.placed is not None]
    return [(b, a) for a, b in combinations(placed, 2)]
