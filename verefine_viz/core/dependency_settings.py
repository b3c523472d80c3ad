"""What can be set of the order in which the objects of a scene are solved."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from verefine_viz.core.fields import Index, InputPath, Length, Order, Settings, Share


class DependencySettings(Settings):
    """Which objects touch, hide or carry which, and hence in which order they are solved. docs/methods.md 2."""

    rule: Literal["recommended", "published"] = "recommended"
    """recommended: contact, occlusion and support from the visible clouds. published: masks that touch when dilated by
    one pixel form a cluster, lower tops come first."""
    order: Order = ()
    """Clusters in the order to solve them, which wins over any rule: object ids, or "#4" for instance 4 where an object
    is there twice, as [[8, 2], [3]]."""
    order_file: InputPath = ""
    """A JSON file of orders by frame, {"50/1": [[8, 2], [3]]}, relative to the session file."""
    cut: tuple[tuple[Index, Index], ...] = ()
    """Pairs of instances between which no edge is to count."""
    contact_m: Length = 0.015
    """Visible clouds nearer than this may touch [m]."""
    border_px: Annotated[int, Field(ge=1, le=100)] = 3
    """Width of the common border of two masks [px]."""
    occlusion_m: Length = 0.010
    """Along the common border the nearer object hides the other if it is nearer by more than this [m]."""
    footprint_share: Share = 0.1
    """An object lies over another if more than this share of its footprint does."""
    base_m: Length = 0.020
    """An object whose lowest visible point is lower than this over the plane stands on it [m]."""
