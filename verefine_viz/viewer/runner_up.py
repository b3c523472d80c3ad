"""By how much the answer won, and whether the runner-up was the better pose."""

from __future__ import annotations

from verefine_viz.core.arrays import Float
from verefine_viz.core.digits import telling_digits
from verefine_viz.core.records import Best
from verefine_viz.evaluation.errors import add_s_mm
from verefine_viz.viewer.plays import BEST_OF_ALL
from verefine_viz.viewer.view import View

NO_LEAD = 1e-6
"""A smaller lead is none [score]."""
NEAR_TIE = 0.03
"""A smaller lead says little about which pose is better [score]. Of refined pairs on real frames, the one that scores
less is more than 1 mm nearer the truth in 3 of 10 where 0.01 to 0.03 lie between, in 3 of 20 up to 0.1, and never
beyond."""
WORTH_MM = 1.0
"""A runner-up that is nearer to the truth by less is as good."""


def ahead(view: View, best: Best) -> str:
    """As in: , 0.003 ahead of hypothesis 2, which is 4.1 mm nearer the truth.

    The latter where ground truth is known, of a lead below ``NEAR_TIE``, measured as ADD(-S) of the two poses. Empty
    where no other hypothesis could have been the answer.
    """
    if view.state is None or view.session.method.name not in BEST_OF_ALL:
        return ""
    highest = {
        j: max(arm.entries, key=lambda e: e.score.score) for j, arm in enumerate(view.state.arms) if j != best.arm
    }
    if not highest:
        return ""
    rival = max(highest, key=lambda j: highest[j].score.score)
    lead = best.score.score - highest[rival].score.score
    nearer = _nearer(view, best.T_cam_obj, highest[rival].T_cam_obj) if lead < NEAR_TIE else ""
    if lead < NO_LEAD:
        return f", level with hypothesis {rival + 1}{nearer}"
    return f", {lead:.{telling_digits(lead)}f} ahead of hypothesis {rival + 1}{nearer}"


def _nearer(view: View, T_best: Float, T_rival: Float) -> str:
    """As in: , which is 4.1 mm nearer the truth. Empty where it is not, or nobody knows."""
    T_gt, model = view.target.instance.T_cam_obj_gt, view.target.model
    if T_gt is None:
        return ""
    gain_mm = add_s_mm(model, T_best, T_gt) - add_s_mm(model, T_rival, T_gt)
    return f", which is {gain_mm:.1f} mm nearer the truth" if gain_mm >= WORTH_MM else ""
