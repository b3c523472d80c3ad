"""First poses from point pair features (Drost 2010), our own. docs/methods.md 6.

Pairs of oriented points look the same from everywhere: distance, and three angles. Pairs of the segment vote for poses
of the model whose pairs look alike; near votes are one pose; the depth image ranks what is left.
"""

from __future__ import annotations

import math
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.estimator_settings import PpfSettings
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.estimators.ppf_agreement import agreement
from verefine_viz.estimators.ppf_cache import Learnt, cache_file, learn, read, write
from verefine_viz.estimators.ppf_cloud import segment_surface, thinned
from verefine_viz.estimators.ppf_cluster import Nearness, clustered, distinct
from verefine_viz.estimators.ppf_vote import voted_poses

MIN_POINTS = 10
"""Thinned points below which a segment says nothing."""


class Ppf:
    """Estimator by point pair features. The answer depends on the arguments of each call only.

    Args:
        settings: of the method.
        cache_folder: where tables of models are kept; None = in the user's cache folder.
    """

    def __init__(self, settings: PpfSettings, cache_folder: Path | None = None) -> None:
        self.settings = settings
        self._folder = cache_folder
        self._learnt: WeakKeyDictionary[ObjectModel, Learnt] = WeakKeyDictionary()

    def hypotheses(self, target: Target, n: int, patience: Patience = ENDLESS) -> tuple[Hypothesis, ...]:
        """At most ``n`` poses, best first, no two of which look the same; see :class:`core.protocols.Estimator`.

        The confidence is in (0, 1]: see :func:`ppf_agreement.agreement`.
        """
        s, model = self.settings, target.model
        d = model.diameter_m
        segment = thinned(segment_surface(target), s.step * d)
        if len(segment.points) < MIN_POINTS:
            return ()
        learnt = self._of(model, patience)
        references = np.arange(0, len(segment.points), s.reference_every)
        patience.ask(f"Looking for {model.name} in its segment by votes of {len(references)} of its points.")
        Ts, votes = voted_poses(segment, references, learnt.table, s.turn_bins, s.peaks, patience)
        center_obj = learnt.table.points.mean(axis=0)
        nearness = Nearness(model.symmetries, center_obj, s.cluster_share * d, math.radians(s.cluster_deg))
        patience.ask(f"Choosing poses of {model.name} that differ among {len(Ts):,}.")
        candidates = clustered(Ts, votes, nearness)[0][: s.candidates]
        patience.ask()
        agree = agreement(target, learnt.cloud, learnt.field, segment, candidates, s.tolerance * d)
        order = np.argsort(-agree, kind="stable")
        order = order[agree[order] > 0]
        chosen = order[distinct(candidates[order], n, nearness)]
        return tuple(Hypothesis(candidates[i], float(agree[i]), f"ppf #{k}") for k, i in enumerate(chosen, start=1))

    def _of(self, model: ObjectModel, patience: Patience) -> Learnt:
        """What is known of the model: from memory, else from disk, else learnt now."""
        known = self._learnt.get(model)
        if known is None:
            path = cache_file(model, self.settings, self._folder)
            known = read(path)
            if known is None:
                patience.ask(f"Learning the point pairs of {model.name}.")
                known = learn(model, self.settings, patience)
                write(path, known)
            self._learnt[model] = known
        return known
