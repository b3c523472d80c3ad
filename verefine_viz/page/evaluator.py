"""Scores, maps, errors and plausibility of poses, worked out when they are asked for and cached."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.accuracy import CORRECT, PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration
from verefine_viz.core.refiner_steps import LearnedRefiner, RefinerStep
from verefine_viz.core.scores import PoseScore, ScoreMaps
from verefine_viz.diagnosis.symmetry import undeclared_turn
from verefine_viz.diagnosis.undeclared_turn import UndeclaredTurn
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.landscape import landscape, score_slice
from verefine_viz.evaluation.near_symmetry import NearSymmetry, flips, near_symmetries
from verefine_viz.evaluation.pose_errors import add_s_mm, add_where_add_s_is_below, pose_errors
from verefine_viz.evaluation.pose_landscape import Landscape, Slice
from verefine_viz.evaluation.seen_error import nearest_allowed
from verefine_viz.rendering.colour import rgb_of, smoothed

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

T = TypeVar("T")
Key = tuple[Any, ...]
"""Key of a cached result: its kind, then the arguments."""
_CACHED_MAPS = 12
_CACHED_NUMBERS = 20_000
NEAR_M = 0.01
"""Objects farther apart than this do not affect each other [m]."""


class CachedEvaluator:
    """Scores, maps, errors and plausibility of poses of one frame.

    Args:
        toolbox: where the verifier comes from.
        plausibility: (moving, fixed, support) → evaluation of the pose by physics, without moving it; None = not
            available.
        overlap: (one, other) → their overlap, or None where they do not overlap; None = not available.
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
        """The score of one pose pixel by pixel; None for a verifier without maps."""
        key = _key("maps", target, T_cam_obj)
        return self._remember(key, lambda: self._toolbox.picture_verifier.maps(target, T_cam_obj))

    def refiner_steps(self, refiner: LearnedRefiner, target: Target, T_cam_obj: Float) -> Sequence[RefinerStep]:
        """The input and output of a learned refiner called at a pose."""
        key = (*_key("refiner maps", target, T_cam_obj), id(refiner))
        # The refiner is kept with its result, so that no other one can get its id.
        return self._remember(key, lambda: (refiner, refiner.explain(target, T_cam_obj)))[1]

    def scene_score(self, targets: Sequence[Target], Ts_cam_obj: Float, whole_frame: bool = False) -> PoseScore:
        """The score of one combination of poses (m, 4, 4) as a scene."""
        verifier = self._toolbox.verifier
        key = ("scene", whole_frame, tuple(t.instance.instance_id for t in targets), Ts_cam_obj.tobytes())
        return self._remember(key, lambda: verifier.score_scene(targets, Ts_cam_obj[None], (), whole_frame)[0])

    def scene_maps(self, targets: Sequence[Target], Ts_cam_obj: Float) -> ScoreMaps | None:
        """The score of one combination of poses (m, 4, 4) as a scene, pixel by pixel; None as :meth:`maps`."""
        verifier = self._toolbox.picture_verifier
        key = ("scene maps", tuple(t.instance.instance_id for t in targets), Ts_cam_obj.tobytes())
        return self._remember(key, lambda: verifier.scene_maps(targets, Ts_cam_obj))

    def errors(self, target: Target, T_cam_obj: Float) -> PoseErrors | None:
        """Errors against ground truth; None where there is none."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return None
        key = _key("errors", target, T_cam_obj)
        return self._remember(key, lambda: pose_errors(target.model, T_cam_obj, T_gt))

    def add_s_mm(self, model: ObjectModel, T_one: Float, T_other: Float) -> float:
        """ADD(-S) between two poses of a model [mm]."""
        return add_s_mm(model, T_one, T_other)

    def add_over_symmetries(self, target: Target, T_cam_obj: Float) -> float | None:
        """ADD as a share of the diameter, for a pose that is correct by ADD-S only; None where both agree."""
        return add_where_add_s_is_below(target, T_cam_obj, CORRECT)

    def undeclared_turn(self, target: Target, T_cam_obj: Float) -> UndeclaredTurn | None:
        """The turn by a symmetry that the model does not declare, if that is why a pose counts as wrong; else None."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return None
        key = _key("undeclared turn", target, T_cam_obj)
        return self._remember(key, lambda: undeclared_turn(target.model, T_cam_obj, T_gt, CORRECT))

    def allowed(self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]) -> AllowedPoses:
        """The poses that the image allows besides a pose, poses of the run included."""
        key = (*_key("allowed", target, T_cam_obj), len(iterations))
        return self._remember(key, lambda: allowed_poses(self.verifier, target, T_cam_obj, (), iterations))

    def known_allowed(self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]) -> AllowedPoses | None:
        """The cached result of :meth:`allowed`; None = it was not called yet."""
        return self._numbers.get((*_key("allowed", target, T_cam_obj), len(iterations)))

    def seen_error(
        self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]
    ) -> tuple[AllowedPoses, float] | None:
        """The poses that the image allows besides ground truth, and the distance of a pose from them [mm]; None before
        :meth:`allowed` was called at ground truth.
        """
        T_gt = target.instance.T_cam_obj_gt
        of_gt = None if T_gt is None else self.known_allowed(target, T_gt, iterations)
        return of_gt and (of_gt, nearest_allowed(of_gt, target.model, T_cam_obj)[1])

    def landscape(self, target: Target, T_cam_obj: Float, iterations: Sequence[Iteration]) -> Landscape:
        """The score around a pose."""
        allowed = self.allowed(target, T_cam_obj, iterations)
        key = _key("landscape", target, T_cam_obj)
        return self._remember(key, lambda: landscape(self.verifier, target, allowed))

    def score_slice(
        self, target: Target, T_cam_obj: Float, axes: tuple[int, int], iterations: Sequence[Iteration]
    ) -> Slice:
        """The score over two axes of a pose's landscape."""
        allowed = self.allowed(target, T_cam_obj, iterations)
        key = (*_key("slice", target, T_cam_obj), axes)
        return self._remember(key, lambda: score_slice(self.verifier, target, allowed, *axes))

    def near_symmetries(self, model: ObjectModel) -> tuple[NearSymmetry, ...]:
        """The turns after which a model's shape nearly looks the same; a second's work where they are not cached."""
        return near_symmetries(model)

    def flips(self, model: ObjectModel) -> Float:
        """(n, 4, 4) turns that represent :meth:`near_symmetries`."""
        return flips(near_symmetries(model))

    def scored_colours(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A colour image (H, W, 3) as the score sees it."""
        return rgb_of(smoothed(rgb))

    def plausibility(self, target: Target, T_cam_obj: Float, others: Sequence[Placed] = ()) -> Any | None:
        """Gap, penetration, support polygon and stability among ``others``; None where no support is known."""
        support = target.observation.support
        evaluator = self._plausibility
        if support is None or evaluator is None:
            return None
        placed = Placed(target.instance.instance_id, target.model, T_cam_obj)
        near = tuple(other for other in others if _are_near(placed, other))
        return self._remember(_among(placed, near), lambda: evaluator(placed, near, support))

    def known_plausibility(self, target: Target, T_cam_obj: Float, others: Sequence[Placed] = ()) -> Any | None:
        """The cached result of :meth:`plausibility`; None = it was not called yet."""
        placed = Placed(target.instance.instance_id, target.model, T_cam_obj)
        return self._numbers.get(_among(placed, [other for other in others if _are_near(placed, other)]))

    def overlap(self, one: Placed, other: Placed) -> Any | None:
        """The overlap of two objects; None where they do not overlap, or where that is not known."""
        evaluator = self._overlap
        if evaluator is None or not _are_near(one, other):
            return None
        return self._remember(_pair(one, other), lambda: evaluator(one, other))

    def known_overlap(self, one: Placed, other: Placed) -> tuple[bool, Any | None]:
        """Whether :meth:`overlap` was called before (or need not be), and its result."""
        if self._overlap is None or not _are_near(one, other):
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


def _are_near(one: Placed, other: Placed) -> bool:
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
