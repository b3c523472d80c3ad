"""Answers about a pose that are worked out only when somebody looks, and remembered."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PoseScore, ScoreMaps
from verefine_viz.evaluation.errors import PoseErrors, pose_errors

T = TypeVar("T")
_KEPT_MAPS = 12
_KEPT_NUMBERS = 20_000


class HasVerifier(Protocol):
    """The part of a toolbox that judging needs."""

    @property
    def verifier(self) -> Verifier: ...


class Judge:
    """Scores, maps, errors and plausibility of poses of one frame.

    Args:
        toolbox: where the verifier comes from.
        plausibility: (moving, fixed, support) → what physics says about the pose without moving it; None = not known.
    """

    def __init__(
        self, toolbox: HasVerifier, plausibility: Callable[[Placed, tuple[Placed, ...], Support], Any] | None = None
    ) -> None:
        self._toolbox = toolbox
        self._plausibility = plausibility
        self._numbers: OrderedDict[tuple[str, int, bytes], Any] = OrderedDict()
        self._maps: OrderedDict[tuple[str, int, bytes], Any] = OrderedDict()

    def score(self, target: Target, T_cam_obj: Float) -> PoseScore:
        """The verification score of one pose."""
        return self._remember(
            self._numbers, "score", target, T_cam_obj, lambda: self._toolbox.verifier.score(target, T_cam_obj[None])[0]
        )

    def maps(self, target: Target, T_cam_obj: Float) -> ScoreMaps:
        """The score of one pose pixel by pixel."""
        return self._remember(
            self._maps, "maps", target, T_cam_obj, lambda: self._toolbox.verifier.maps(target, T_cam_obj)
        )

    def errors(self, target: Target, T_cam_obj: Float) -> PoseErrors | None:
        """Errors against ground truth; None where there is none."""
        truth = target.instance.T_cam_obj_gt
        if truth is None:
            return None
        return self._remember(
            self._numbers, "errors", target, T_cam_obj, lambda: pose_errors(target.model, T_cam_obj, truth)
        )

    def plausibility(self, target: Target, T_cam_obj: Float) -> Any | None:
        """Gap, penetration, support polygon and stability; None where no support is known."""
        support = target.observation.support
        judge = self._plausibility
        if support is None or judge is None:
            return None
        placed = Placed(target.instance.instance_id, target.model, T_cam_obj)
        return self._remember(self._numbers, "plausibility", target, T_cam_obj, lambda: judge(placed, (), support))

    def _remember(
        self,
        kept: OrderedDict[tuple[str, int, bytes], Any],
        kind: str,
        target: Target,
        T_cam_obj: Float,
        work_out: Callable[[], T],
    ) -> T:
        key = (kind, target.instance.instance_id, T_cam_obj.tobytes())
        if key in kept:
            kept.move_to_end(key)
        else:
            kept[key] = work_out()
            while len(kept) > (_KEPT_MAPS if kept is self._maps else _KEPT_NUMBERS):
                kept.popitem(last=False)
        return kept[key]
