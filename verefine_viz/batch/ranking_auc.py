"""Whether scores can be trusted: how often a wrong answer outranks a right one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from verefine_viz.batch.rows import ObjectRow


def misled(rows: Iterable[ObjectRow]) -> float | None:
    """How often the score misleads: the share of pairs (wrong, right answer) in which the wrong one scores higher.

    0 = the score tells them apart, ½ = it knows nothing; None where there are no such pairs.
    """
    scores = [(row.is_correct, row.score) for row in rows if row.score is not None]
    wrong = np.array([score for is_correct, score in scores if is_correct is False])
    right = np.sort(np.array([score for is_correct, score in scores if is_correct]))
    if not len(wrong) or not len(right):
        return None
    below = np.searchsorted(right, wrong, "left")
    level = np.searchsorted(right, wrong, "right") - below
    return float((below + level / 2).sum() / (len(wrong) * len(right)))
