"""Scores, maps, errors and plausibility of poses, worked out when they are asked for and cached."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration
from verefine_viz.core.refiner_steps import LearnedRefiner, RefinerStep
from verefine_viz.core.scores import PoseScore, ScoreMaps
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.ambiguity import OtherPose, other_pose, run_poses
from verefine_viz.diagnosis.symmetry import UndeclaredTurn, undeclared_turn
from verefine_viz.evaluation.landscape import Landscape, Slice, landscape, score_slice
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.near_symmetry import NearSymmetry, flips, near_symmetries
from verefine_viz.evaluation.pose_errors import PoseErrors, pose_errors

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

T = TypeVar("T")
Key = tuple[Any, ...]
"""What was asked: its kind first."""
_CACHED_MAPS = 12
_CACHED_NUMBERS = 20_000
_near_symmetries: WeakKeyDictionary[ObjectModel, tuple[NearSymmetry, ...]] = WeakKeyDictionary()
"""Near-symmetries of the models of all frames, which share them."""
NEAR_M = 0.01
"""Objects further apart than this have nothing to do with each other [m]."""


class CachedEvaluator:
    """Scores, maps, errors and plausibility of poses of one frame.

    Args:
        toolbox: where the verifier comes from.
        plausibility: (moving, fixed, support) → what physics says about the pose without moving it; None = not known.
        overlap: (one, other) → how deep one object is in another, or None where it is not; None = not known.
    """

    def __init__(
        self,
        toolbox: Toolbox,
        plausibility: Callable[[Placed, tuple[Placed, ...], Support], Any] | None = None,
        overlap: Callable[[Placed, Placed], Any | None] | None = None,
    ) -> None:
        self._toolbox = toolbox
        self._plausibility = plausibility
        self._overlap = overlap
        self._numbers: OrderedDict[Key, Any] = OrderedDict()
        self._maps: OrderedDict[Key, Any] = OrderedDict()

    @property
    def verifier(self) -> Verifier:
        return self._toolbox.verifier

    def score(self, target: Target, T_cam_obj: Float) -> PoseScore:
        """The verification score of one pose."""
        key = _key("score", target, T_cam_obj)
        return self._remember(key, lambda: self._toolbox.verifier.score(target, T_cam_obj[None])[0])

    def maps(self, target: Target, T_cam_obj: Float) -> ScoreMaps | None:
        """The score of one pose pixel by pixel; None where it is not made of pixels."""
        key = _key("maps", target, T_cam_obj)
        return self._remember(key, lambda: self._toolbox.verifier.maps(target, T_cam_obj))

    def refiner_steps(self, refiner: LearnedRefiner, target: Target, T_cam_obj: Float) -> Sequence[RefinerStep]:
        """What a learned refiner saw and answered when it was called at a pose."""
        key = (*_key("refiner maps", target, T_cam_obj), id(refiner))
        # With the refiner itself, so that no other one gets its id meanwhile.
        return self._remember(key, lambda: (refiner, refiner.explain(target, T_cam_obj)))[1]

    def scene_score(self, targets: Sequence[Target], Ts_cam_obj: Float, whole_frame: bool = False) -> PoseScore:
        """The score of one combination of poses (m, 4, 4) as a scene."""
        verifier = self._toolbox.verifier
        key = ("scene", whole_frame, tuple(t.instance.instance_id for t in targets), Ts_cam_obj.tobytes())
        return self._remember(key, lambda: verifier.score_scene(targets, Ts_cam_obj[None], (), whole_frame)[0])

    def scene_maps(self, targets: Sequence[Target], Ts_cam_obj: Float) -> ScoreMaps | None:
        """The score of one combination of poses (m, 4, 4) as a scene, pixel by pixel; None as :meth:`maps`."""
        verifier = self._toolbox.verifier
        key = ("scene maps", tuple(t.instance.instance_id for t in targets), Ts_cam_obj.tobytes())
        return self._remember(key, lambda: verifier.scene_maps(targets, Ts_cam_obj))

    def errors(self, target: Target, T_cam_obj: Float) -> PoseErrors | None:
        """Errors against ground truth; None where there is none."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return None
        key = _key("errors", target, T_cam_obj)
        return self._remember(key, lambda: pose_errors(target.model, T_cam_obj, T_gt))

    def undeclared_turn(self, target: Target, T_cam_obj: Float) -> UndeclaredTurn | None:
        """The turn, which the model does not declare, that makes a pose count as wrong; None where that is not why."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return None
        key = _key("undeclared turn", target, T_cam_obj)
        return self._remember(key, lambda: undeclared_turn(target.model, T_cam_obj, T_gt, CORRECT))

    def landscape(self, target: Target, T_cam_obj: Float) -> Landscape:
        """The score around a pose."""
        key = _key("landscape", target, T_cam_obj)
        return self._remember(key, lambda: landscape(self.verifier, target, T_cam_obj))

    def known_landscape(self, target: Target, T_cam_obj: Float) -> Landscape | None:
        """What :meth:`landscape` returned if it was called before, else None."""
        return self._numbers.get(_key("landscape", target, T_cam_obj))

    def score_slice(self, target: Target, T_cam_obj: Float, axes: tuple[int, int]) -> Slice:
        """The score over two axes of a pose's landscape."""
        around = self.landscape(target, T_cam_obj)
        key = (*_key("slice", target, T_cam_obj), axes)
        return self._remember(key, lambda: score_slice(self.verifier, target, around, *axes))

    def other_pose(self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]) -> OtherPose | None:
        """A pose of a run, or of the landscape, that the observation cannot tell from an answer; None = none is."""
        around = self.landscape(target, T_cam_obj)
        key = (*_key("other pose", target, T_cam_obj), len(iterations))
        poses = [*run_poses(target, iterations), *(T_cam_obj @ flips(self.near_symmetries(target.model)))]
        return self._remember(key, lambda: other_pose(self.verifier, target, around, poses))

    def known_other_pose(
        self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]
    ) -> tuple[bool, OtherPose | None]:
        """Whether :meth:`other_pose` was called before, and its result."""
        key = (*_key("other pose", target, T_cam_obj), len(iterations))
        return key in self._numbers, self._numbers.get(key)

    def near_symmetries(self, model: ObjectModel) -> tuple[NearSymmetry, ...]:
        """The turns after which a model's shape nearly looks the same; a second's work where they are not cached."""
        if model not in _near_symmetries:
            _near_symmetries[model] = near_symmetries(model)
        return _near_symmetries[model]

    def plausibility(self, target: Target, T_cam_obj: Float, others: Sequence[Placed] = ()) -> Any | None:
        """Gap, penetration, support polygon and stability among ``others``; None where no support is known."""
        support = target.observation.support
        evaluator = self._plausibility
        if support is None or evaluator is None:
            return None
        placed = Placed(target.instance.instance_id, target.model, T_cam_obj)
        near = tuple(other for other in others if are_near(placed, other))
        return self._remember(_among(placed, near), lambda: evaluator(placed, near, support))

    def known_plausibility(self, target: Target, T_cam_obj: Float, others: Sequence[Placed] = ()) -> Any | None:
        """What :meth:`plausibility` returned if it was called before, else None."""
        placed = Placed(target.instance.instance_id, target.model, T_cam_obj)
        return self._numbers.get(_among(placed, [other for other in others if are_near(placed, other)]))

    def overlap(self, one: Placed, other: Placed) -> Any | None:
        """How deep one object is in another; None where it is not, or where that is not known."""
        evaluator = self._overlap
        if evaluator is None or not are_near(one, other):
            return None
        return self._remember(_pair(one, other), lambda: evaluator(one, other))

    def known_overlap(self, one: Placed, other: Placed) -> tuple[bool, Any | None]:
        """Whether :meth:`overlap` was called before (or need not be), and its result."""
        if self._overlap is None or not are_near(one, other):
            return True, None
        key = _pair(one, other)
        return key in self._numbers, self._numbers.get(key)

    def _remember(self, key: Key, work_out: Callable[[], T]) -> T:
        cache, size = (self._maps, _CACHED_MAPS) if "maps" in key[0] else (self._numbers, _CACHED_NUMBERS)
        if key in cache:
            cache.move_to_end(key)
        else:
            cache[key] = work_out()
            while len(cache) > size:
                cache.popitem(last=False)
        return cache[key]


def together(evaluator: CachedEvaluator, targets: Sequence[Target], Ts_cam_obj: Float, session: Session) -> PoseScore:
    """The score of several objects (m, 4, 4) rendered together, by the rule of the session."""
    return evaluator.scene_score(targets, Ts_cam_obj, session.method.scene_pixels == "frame")


def are_near(one: Placed, other: Placed) -> bool:
    """Whether the spheres around two objects come close to each other."""
    (centre_one, radius_one), (centre_other, radius_other) = _sphere(one), _sphere(other)
    return float(np.linalg.norm(centre_one - centre_other)) < radius_one + radius_other + NEAR_M


def _sphere(placed: Placed) -> tuple[Float, float]:
    centre_obj, radius_m = _sphere_of(placed.model)
    return placed.T_cam_obj[:3, :3] @ centre_obj + placed.T_cam_obj[:3, 3], radius_m


@lru_cache(maxsize=64)
def _sphere_of(model: ObjectModel) -> tuple[Float, float]:
    low, high = model.points.min(axis=0), model.points.max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def _key(kind: str, target: Target, T_cam_obj: Float) -> Key:
    return kind, target.instance.instance_id, T_cam_obj.tobytes()


def _among(placed: Placed, near: Sequence[Placed]) -> Key:
    around = tuple(sorted((p.instance_id, p.T_cam_obj.tobytes()) for p in near))  # Their order does not matter.
    return "plausibility", placed.instance_id, placed.T_cam_obj.tobytes(), around


def _pair(one: Placed, other: Placed) -> Key:
    return "overlap", one.instance_id, one.T_cam_obj.tobytes(), other.instance_id, other.T_cam_obj.tobytes()
