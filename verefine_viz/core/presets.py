"""Settings that go together."""

from __future__ import annotations

from typing import Any

PUBLISHED: dict[str, dict[str, Any]] = {
    "score": {"pixels": "published", "alpha": 0.707, "tau_m": 0.020, "pixel_centre": "half", "simplify_mm": 0.0},
    "icp": {"metric": "point", "stop": "published", "gate": "published", "matches": "all", "max_iterations": 10},
    "tricp": {"trim": 1.0},
    "pcs": {"part_share": 0.0, "spacing_m": 0.0, "keep_share": 0.2},
    "dependency": {"rule": "published"},
    "method": {
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
    "physics": {"collider": "hull", "margin_m": 1e-3, "placed": "dynamic", "steps": 3},
}
"""What ``preset = "published"`` changes (docs/methods.md 1.8 and 9)."""
