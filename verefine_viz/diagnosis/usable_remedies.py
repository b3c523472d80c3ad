"""Tells which remedies a session can use."""

from __future__ import annotations

from verefine_viz.core.remedies import Remedy
from verefine_viz.core.settings import Session
from verefine_viz.methods.known_methods import method_of


def is_read(remedy: Remedy, session: Session) -> bool:
    """Whether a session's method uses the setting of a remedy."""
    method, physics = method_of(session.method.name), session.physics.enabled
    if method.repeats:
        return False
    if remedy.setting == "scene.gravity" and session.scene.source == "demo":
        return False
    reads = {
        "method.exploration": method.has_ucb,
        "method.iterations": not method.has_tree,
        "mcts.expansions": method.has_tree,
        "method.refiner": not method.has_tree,
        "hypotheses.max_per_object": not method.first_only,
        "score.colour_weight": method.verifies,
        "score.plausibility_weight": method.verifies,
        "physics.collider": method.simulates and physics,
        "physics.enabled": method.simulates,
    }
    return reads.get(remedy.setting, True)
