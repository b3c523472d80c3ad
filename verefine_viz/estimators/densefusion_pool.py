"""Initial poses by DenseFusion, as the paper's pool has them (Sec. V). docs/methods.md 5."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.networks.densefusion_weights import pose_network


class DenseFusionPool:
    """The most confident point's pose, and poses of other points, all equally likely.

    Args:
        settings: weights, classes, points and seed.

    Raises:
        VerefineError: the weights are missing or cannot be used.
    """

    def __init__(self, settings: DenseFusionSettings) -> None:
        self.settings = settings
        self._network = pose_network(settings)

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        """At most ``n`` poses, the most confident first; see :class:`core.protocols.Estimator`.

        Raises:
            InputError: the frame has no colour, or the network does not know the object.
        """
        progress.checkpoint()
        poses = self._network.poses(target)
        if poses is None:
            return ()
        first = int(poses.confidences[: poses.n_distinct].argmax())
        others = np.delete(np.arange(poses.n_distinct), first)
        rng = np.random.default_rng(self.settings.seed)
        drawn = rng.choice(others, min(n - 1, len(others)), replace=False)
        drawn = drawn[np.argsort(-poses.confidences[drawn], kind="stable")]
        return tuple(
            Hypothesis(poses.Ts_cam_obj[k], float(poses.confidences[k]), "densefusion") for k in (first, *drawn)
        )
