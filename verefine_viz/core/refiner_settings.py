"""What can be set of the built-in refiners."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from verefine_viz.core.fields import Count, LengthOrNone, Settings, Share


class IcpSettings(Settings):
    """Point-to-point (or point-to-plane) ICP. docs/methods.md 4.1."""

    metric: Literal["point", "plane"] = "point"
    """Distance that a step minimises."""
    stop: Literal["published", "max_iterations", "tolerance"] = "max_iterations"
    """published: stops after 2 inner iterations, as the authors' PCL settings do. max_iterations: always runs them all.
    tolerance: until the step is below 1e-6."""
    max_iterations: Count = 10
    """Inner iterations per refiner call."""
    gate: Literal["shrinking", "published"] = "shrinking"
    """Largest distance of a correspondence. published: 0.1 × the observed cloud's largest extent, which leaves far
    starts untouched. shrinking: starts at 0.5 of it and tightens to the published gate."""
    matches: Literal["same_side", "all"] = "same_side"
    """Which correspondences within the gate count. all: every one (published). same_side: those whose observed and
    model normals lie within 90° of each other, so that the seen front is not pulled to the model's back."""


class TricpSettings(Settings):
    """Trimmed ICP. docs/methods.md 4.2."""

    trim: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 1.0
    """Share of the observed points, the best matching ones, that the fit uses; 0.9-0.5 bears leaking masks better."""
    energy_ratio: Share = 0.99
    """A pass that leaves more than this share of the energy before is the last."""
    max_passes: Count = 50
    """Most passes of a call."""
    explained_m: LengthOrNone = 0.008
    """Observed points closer than this to an object already placed are left out [m]; 0 keeps all."""
