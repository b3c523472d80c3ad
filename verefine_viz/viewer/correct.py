"""Which poses count as correct on the page: by the usual 10 % of the diameter."""

from __future__ import annotations

from verefine_viz.evaluation.answers import CORRECT
from verefine_viz.evaluation.errors import PoseErrors


def is_correct(errors: PoseErrors | None) -> bool:
    """Whether a pose is near enough; False also where nobody can say."""
    return errors is not None and errors.relative < CORRECT


def verdict_mark(errors: PoseErrors | None) -> str:
    """✓ or ✗; nothing where nobody can say."""
    if errors is None:
        return ""
    return "✓" if is_correct(errors) else "✗"
