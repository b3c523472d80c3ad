"""What can be set of the estimators, which propose first poses from depth and model alone."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from verefine_viz.core.fields import Count, LargeCount, LengthOrNone, Seed, Settings, Share


class PpfSettings(Settings):
    """Point pair features. docs/methods.md 6; defaults as measured on real frames (bench/estimators.py)."""

    step: Annotated[float, Field(ge=0.02, lt=0.5, allow_inf_nan=False)] = 0.05
    """Grid of model and scene points as a share of the diameter."""
    distance_bin: Annotated[float, Field(ge=0.02, lt=0.5, allow_inf_nan=False)] = 0.05
    """Bin of distances as a share of the diameter."""
    angle_bin_deg: Annotated[float, Field(ge=4, le=45, allow_inf_nan=False)] = 12.0
    """Bin of the three angles [deg]."""
    bin_limit: LargeCount = 1000
    """Most model pairs kept in a bin; each then stands for several. Flat faces fill few bins with very many pairs."""
    reference_every: Count = 5
    """Every n-th scene point is a reference."""
    turn_bins: Annotated[int, Field(ge=12, le=360)] = 36
    """Bins of the turn about the reference's normal, 360° together."""
    peaks: Annotated[int, Field(ge=1, le=100)] = 4
    """Most poses that a reference proposes."""
    cluster_share: Share = 0.1
    """Poses nearer than this share of the diameter, and …"""
    cluster_deg: Annotated[float, Field(gt=0, lt=180, allow_inf_nan=False)] = 18.0
    """… turned by less than this are one hypothesis [deg]."""
    candidates: Count = 60
    """Clusters with most votes that are ranked by their agreement with the depth image."""
    tolerance: Annotated[float, Field(gt=0, lt=0.5, allow_inf_nan=False)] = 0.03
    """Depths that differ by less than this share of the diameter agree."""
    seed: Seed = 0
    """Seeds the points drawn on the model."""


class PcsSettings(Settings):
    """Congruent point sets (Super4PCS). docs/methods.md 3.2."""

    delta_m: Annotated[float, Field(ge=5e-4, le=1, allow_inf_nan=False)] = 0.0035
    """δ, distance within which two points correspond [m]; pairs, quads and fits may differ by 2δ."""
    grid_m: Annotated[float, Field(ge=5e-4, le=1, allow_inf_nan=False)] = 0.005
    """Side of the grid that thins segment and model [m]."""
    part_share: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.1
    """Parts of the segment that stand alone and hold less than this share of its points are left out: a mask that leaks
    leaves such. 0 keeps all (published code)."""
    samples: Annotated[int, Field(ge=1, le=2000)] = 300
    """Points of the model, spread evenly, of which those that lie on the segment are counted."""
    spacing_m: LengthOrNone = 0.014
    """Those of them that are at least so far apart make up the quads [m]; the number of quads grows with the fourth
    power of the number of points. 0 takes all (published code)."""
    bases: LargeCount = 100
    """Bases tried; the published code goes on for 1 s, so that its results depend on the machine."""
    quads: LargeCount = 1000
    """Most quads of a base that are looked at, a random choice."""
    keep_share: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.7
    """Poses whose LCP is below this share of the best one are left out. Published code: 0.2, and then the middle of a
    cluster is often none of the good poses."""
    bins: Count = 2000
    """Most bins, the best ones, that go into the clusters."""
    seed: Seed = 0
    """Seeds bases, quads and clusters."""
