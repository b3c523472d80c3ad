"""Plausibility as a term of the score: could the object be there? Around any verifier (docs/methods.md 1.14)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import PhysicsSettings

Check = Callable[[Placed, Sequence[Placed], Support], float]
"""Plausibility p of an object among others on a support."""


class PlausibleVerifier:
    """A verifier (core.protocols) whose scores f become (1 − w) f + w p.

    p of a pose is that among the ``placed`` objects; of a combination of poses, the mean of its objects' among each
    other. It is 0 where the model is not in the image, or the pose is invalid. Frames without a support plane have no
    such term.

    Args:
        verifier: gives f, with ``score.plausibility_weight`` above 0 in its settings.
        check: returns p in [0, 1]; its ShapeError counts as 0.
        physics: what ``check`` depends on.
    """

    def __init__(self, verifier: Verifier, check: Check, physics: PhysicsSettings) -> None:
        self.settings = verifier.settings
        self.physics = physics
        self._verifier = verifier
        self._check = check

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4)."""
        scores = self._verifier.score(target, Ts_cam_obj, placed)
        return self._with_term(scores, (target,), np.asarray(Ts_cam_obj)[:, None], placed)

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Callable[[], Scores] | None:
        """Starts f in parallel; p is computed by the thread that waits for the scores."""
        begun = self._verifier.begin(target, Ts_cam_obj, placed)
        if begun is None:
            return None
        return lambda: self._with_term(begun(), (target,), np.asarray(Ts_cam_obj)[:, None], placed)

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps | None:
        """Maps of f for one pose: p has no maps."""
        return self._verifier.maps(target, T_cam_obj, placed, at)

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """Scores of N combinations of poses (N, m, 4, 4)."""
        scores = self._verifier.score_scene(targets, Ts_cam_obj, placed, whole_frame)
        return self._with_term(scores, targets, np.asarray(Ts_cam_obj), placed)

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        *,
        at: PixelGrid | None = None,
    ) -> ScoreMaps | None:
        """Maps of f of one combination (m, 4, 4)."""
        return self._verifier.scene_maps(targets, Ts_cam_obj, placed, at=at)

    def _with_term(self, scores: Scores, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed]) -> Scores:
        """The scores f of N combinations (N, m, 4, 4) with the term."""
        support, w = targets[0].observation.support, self.settings.plausibility_weight
        if support is None:
            return scores
        ids = [target.instance.instance_id for target in targets]
        around = [one for one in placed if one.instance_id not in ids]
        share = np.zeros(len(Ts))
        for n in np.flatnonzero(scores.n_rendered):
            scene = [Placed(i, t.model, T) for i, t, T in zip(ids, targets, Ts[n], strict=True)]
            own = [self._share(one, [*around, *scene[:k], *scene[k + 1 :]], support) for k, one in enumerate(scene)]
            share[n] = np.mean(own)
        score = (1 - w) * scores.score + w * share
        if scores.undefined is not None:
            score[scores.undefined] = 0.0
        return replace(scores, score=score, plausibility=share, plausibility_weight=w)

    def _share(self, one: Placed, others: Sequence[Placed], support: Support) -> float:
        try:
            return self._check(one, others, support)
        except ShapeError:  # Not a rigid transform, or too far away for a simulation.
            return 0.0


def are_comparable(one: Verifier, other: Verifier) -> bool:
    """Whether the scores of two verifiers can be compared."""
    physics = [v.physics if isinstance(v, PlausibleVerifier) else None for v in (one, other)]
    return one.settings == other.settings and physics[0] == physics[1]
