"""Presets: recommended values, the paper's choices, or those of the authors' public code.

docs/methods.md 1.8 lays the presets side by side, with the reasons; a test compares it with this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Fields = Mapping[str, Mapping[str, Any]]
"""Values by section and name, as in a session file."""

PRESETS: dict[str, Fields] = {
    "recommended": {"method": {"refiner": "depth_net_icp"}},
    "paper": {
        # Sec. III-B, Eq. 1: N is the valid depth of the segment. Sec. V: 20 mm, 45°, and 1 − cos 45° is 0.293.
        "score": {
            "pixels": "observed",
            "tau_m": 0.020,
            "alpha": 0.293,
            "colour_weight": 0.0,
            "plausibility_weight": 0.0,
        },
        # Sec. V: PCL's basic point-to-point ICP with 50 iterations, spread over 5 iterations of PIR.
        "icp": {"metric": "point", "stop": "max_iterations", "gate": "published", "matches": "all"},
        "densefusion": {"iterations": 1},  # Sec. V: 2, distributed over 2 iterations of PIR.
        "tricp": {"trim": 1.0},  # Sec. V: "the same settings as" Mitash et al., who do not trim.
        "hypotheses": {"flips": False},
        "pcs": {"part_share": 0.0, "spacing_m": 0.0, "keep_share": 0.2},  # Sec. V: by the code of Mitash et al.
        "mcts": {"expansions": 50},  # Sec. V: 150 refinements a scene of three objects, those of roll-outs not counted.
        "dependency": {"rule": "recommended", "clusters": "components"},  # Sec. IV-A
        "method": {
            "refiner": "icp",  # Sec. V
            "sim_candidate": "full",  # Sec. III-B
            "accept": "latest",  # Sec. III-B
            "exploration": 0.7,  # Sec. III-C gives none; the authors' 0.1 is for a score that spreads less.
            "discount": 0.99,  # Sec. IV-C: "a small factor"; as before.
            "scene_reward": "best_known",  # Sec. IV-C
            "scene_answer": "per_object",  # Sec. III-C: the best of all estimates of a bandit.
            "scene_prior": "object",  # Sec. IV-C: as for single objects.
            "scene_pixels": "frame",  # Sec. IV-C: "a complete scene".
            "occluders": "placed",  # Sec. IV, Fig. 3
            "carry_clusters": True,  # Sec. IV-A: clusters are ordered front to back.
        },
        # Sec. V
        "physics": {
            "steps": 3,
            "step_s": 1 / 60,
            "substeps": 4,
            "solver_iterations": 10,
            "mass_kg": 1.0,
            "support": "plane",
        },
    },
    "published": {
        "scene": {"model_sampling": "even"},
        "score": {
            "pixels": "published",
            "alpha": 0.707,
            "tau_m": 0.020,
            "pixel_centre": "half",
            "simplify_mm": 0.0,
            "colour_weight": 0.0,
            "plausibility_weight": 0.0,
        },
        "icp": {"metric": "point", "stop": "published", "gate": "published", "matches": "all", "max_iterations": 10},
        "hypotheses": {"flips": False},
        "tricp": {"trim": 1.0},
        "pcs": {"part_share": 0.0, "spacing_m": 0.0, "keep_share": 0.2},
        "dependency": {"rule": "published", "clusters": "cuthill_mckee"},
        "method": {
            "refiner": "icp",
            "sim_candidate": "full",
            "accept": "latest",
            "exploration": 0.1,
            "discount": 0.99,
            "scene_reward": "current_pass",
            "scene_answer": "per_object",
            "scene_prior": "object",
            "scene_pixels": "frame",
            "occluders": "none",
            "carry_clusters": False,
        },
        "physics": {
            "collider": "hull",
            "inertia": "box",
            "margin_m": 1e-3,
            "placed": "dynamic",
            "steps": 3,
            "support": "plane",
        },
    },
}
"""Presets by name. A field that a preset leaves out has its own default."""

WITH_REFINER: dict[tuple[str, str], Fields] = {
    ("recommended", "depth_net_icp"): {"score": {"colour_weight": 0.1}, "hypotheses": {"flips": True}},
    ("paper", "icp"): {"hypotheses": {"max_per_object": 3}, "method": {"iterations": 5}, "icp": {"max_iterations": 10}},
    ("paper", "trimmed_icp"): {
        "hypotheses": {"max_per_object": 25},
        "method": {"iterations": 2},
        "physics": {"steps": 60},
    },
    ("paper", "densefusion"): {"hypotheses": {"max_per_object": 5}, "method": {"iterations": 2}},
}
"""What a preset sets besides for a refiner: recommended colour and flips, which lose right answers without the network
(docs/methods.md 1.11); paper its budgets (Sec. V, Tables I to III; docs/methods.md 1.0)."""


def preset_fields(preset: str, refiner: str | None = None) -> dict[str, dict[str, Any]]:
    """Values that a preset sets with a refiner (None = the preset's own); empty for an unknown preset."""
    fields = PRESETS.get(preset, {})
    of_refiner = WITH_REFINER.get((preset, refiner or fields.get("method", {}).get("refiner", "")), {})
    return {s: {**fields.get(s, {}), **of_refiner.get(s, {})} for s in {**fields, **of_refiner}}
