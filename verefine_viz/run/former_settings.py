"""Sessions of earlier versions, in files and in run files: they hold settings that are constants now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

FORMER: Mapping[str, Mapping[str, float]] = {
    "ppf": {"turn_bins": 36, "peaks": 4, "cluster_share": 0.1, "cluster_deg": 18.0},
    "pcs": {"quads": 1000, "bins": 2000},
    "dependency": {"border_px": 3, "footprint_share": 0.1, "base_m": 0.020},
    "grasp": {"stop_n": 10.0, "approach_m": 0.10, "lift_m": 0.15, "voxel_m": 0.005},
}
"""What each has been since, by section and name."""


def without_former(raw: Mapping[str, Any]) -> dict[str, Any]:
    """A session as read, without what is constant now where it has that value; another value stays, and is refused."""
    return {name: _without(section, FORMER.get(name, {})) for name, section in raw.items()}


def _without(section: Any, former: Mapping[str, float]) -> Any:
    if not isinstance(section, Mapping):
        return section
    return {name: value for name, value in section.items() if name not in former or former[name] != value}
