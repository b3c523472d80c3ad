"""Why the two stages that are compared differ in score, in plain words. Pure text: who shows it escapes it."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.digits import telling_digits
from verefine_viz.core.scores import PoseScore
from verefine_viz.viewer.edited_words import edited_beside
from verefine_viz.viewer.truth_score import truth_beside
from verefine_viz.viewer.view import Judged, View

_SAME = 1e-6


def compared(view: View) -> str:
    """Why the two stages that are compared differ in score; of which object, where there are several."""
    a, b = view.a, view.b
    label = view.scene.object(view.target.instance.instance_id).label
    if a is None or b is None:
        return f"{label} has no pose to judge; give it a hypothesis."
    pairs = [(wanted, side.pose) for wanted, side in ((view.look.a, a), (view.look.b, b)) if side.pose.name != wanted]
    missing = [wanted for wanted, _ in pairs]
    instead = " and ".join(dict.fromkeys(pose.label for _, pose in pairs))
    lead = f"{label}: " if len(view.scene.objects) > 1 else ""
    # An iteration that is told to its end will not make it any more.
    yet = "" if view.shown is not None and not view.is_partial else " yet"
    lead += f"No {' and no '.join(missing)} pose here{yet}; shown instead: {instead}. " if missing else ""
    return lead + _difference(a.pose, b.pose) + truth_beside(a.pose, b.pose) + edited_beside(view)


def score_digits(scores: Sequence[PoseScore | None]) -> int:
    """Decimals that tell some scores apart; three at least."""
    known = [s.score for s in scores if s is not None]
    return max(3, telling_digits(max(known) - min(known))) if known else 3


def _difference(a: Judged, b: Judged) -> str:
    """How much more the second one scores, and from what."""
    one, other = a.score, b.score
    if one is None or other is None:
        return f"{a.label} or {b.label} was not scored."
    digits = score_digits([one, other])
    if a.name != b.name and one == other:
        return f"{a.label.capitalize()} and {b.label} score the same: {other.score:.{digits}f}."
    if a.name == b.name:
        return f"{b.label.capitalize()} scores {other.score:.{digits}f}."
    said = f"{b.label.capitalize()} {other.score:.{digits}f} against {a.label} {one.score:.{digits}f}"
    lead = other.score - one.score
    depth, normal = (other.depth_fit - one.depth_fit) / 2, (other.normal_fit - one.normal_fit) / 2
    larger = max(abs(depth), abs(normal))
    if abs(lead) < _SAME and larger < _SAME:
        return f"{said}: the same."
    parts = f"(depth {depth:+.{digits}f}, normals {normal:+.{digits}f})".replace("-", "−")
    more = "the same" if abs(lead) < _SAME else f"{abs(lead):.{digits}f} {'more' if lead > 0 else 'less'}"
    if abs(lead) < larger / 2:
        said += f": {more}, since what depth and normals change nearly cancels out {parts}."
    else:
        said += f": {more}, mostly from {'depth' if abs(depth) >= abs(normal) else 'normals'} {parts}."
    return said + _pixels(one, other)


def _pixels(one: PoseScore, other: PoseScore) -> str:
    """The class of pixels that changed most; empty where none did by 1 %."""
    name = max(one.shares, key=lambda k: abs(other.shares[k] - one.shares[k]))
    change = other.shares[name] - one.shares[name]
    if abs(change) < 0.01:
        return ""
    points = f"{100 * abs(change):.0f} percentage points"
    return f" The share of {name} pixels went {'up' if change > 0 else 'down'} by {points}."
