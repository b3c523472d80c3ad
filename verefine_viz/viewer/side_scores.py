"""Scores of two runs side by side: what they tell where both score by the same settings, and where they do not."""

from __future__ import annotations

from typing import Any

from verefine_viz.session.outcomes import Answer, Outcome, Winner
from verefine_viz.viewer.markup import text, warning
from verefine_viz.viewer.scales import NOT_COMPARABLE
from verefine_viz.viewer.side_view import SidesView


def better(v: SidesView, o: Outcome) -> Winner | None:
    """Who has an object nearer to ground truth, or scores it higher; None where neither can be said."""
    return o.winner if v.scores_alike or _is_known(o) else None


def has_both(o: Outcome) -> bool:
    """Whether both runs have an answer for an object."""
    return o.a is not None and o.b is not None


def own_score(answer: Answer) -> float:
    """Of an answer, by the settings of its own run."""
    return answer.best.score.score


def scores_note(v: SidesView) -> str:
    """A box above scores that do not compare; empty where they do."""
    found = _rules(v)
    if not found:
        return ""
    said = "; ".join(f"{name} is {plain(one)} in A, {plain(other)} in B" for name, one, other in found)
    instead = (
        "Errors against ground truth are."
        if any(_is_known(o) for o in v.outcomes)
        else "Without ground truth nothing here says which is better: give both the same."
    )
    return warning(f"Scores of A and B are {NOT_COMPARABLE}: {said}. {instead}")


def score_sign(v: SidesView) -> str:
    """A sign behind the heading of scores that do not compare."""
    return "" if v.scores_alike else " ⚠"


def judged_by_a(v: SidesView, o: Outcome) -> str:
    """A tooltip: B's answer by the settings of A, where B scores by others."""
    if v.scores_alike or o.b is None:
        return ""
    return text(f"each by its own settings, {NOT_COMPARABLE}; by those of A, B's answer scores {o.b.score:.2f}")


def plain(value: Any) -> str:
    """The value of a setting, cut where it is long."""
    said = f"{value:g}" if isinstance(value, float) else str(value)
    return said if len(said) <= 40 else f"{said[:39]}…"


def _rules(v: SidesView) -> tuple[tuple[str, Any, Any], ...]:
    """The settings of the score that differ: (dotted name, of A, of B)."""
    if v.scores_alike:
        return ()
    # Two renderers of one rule agree to the last digits that matter.
    return tuple(s for s in v.settings if s[0].startswith("score.") and s[0] != "score.renderer")


def _is_known(o: Outcome) -> bool:
    """Whether ground truth says how far off both are."""
    return o.a is not None and o.b is not None and o.a.errors is not None and o.b.errors is not None
