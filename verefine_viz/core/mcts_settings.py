"""What can be set of the tree search over a whole scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from verefine_viz.core.fields import LargeCount, Length, Settings, Weight


class MctsSettings(Settings):
    """PHYSIM-MCTS, the system that the paper compares with. docs/methods.md 3."""

    expansions: LargeCount = 50
    """Budget in expansions per object."""
    seconds: Annotated[float, Field(gt=0, le=86_400, allow_inf_nan=False)] | None = None
    """Budget in computing time per cluster instead [s]; results then depend on the machine."""
    exploration_px: Weight = 5000.0
    """α, weight of the exploration term [px]."""
    explained_m: Length = 0.010
    """A pixel whose observed and rendered depth differ by more than this adds 1 to the cost [m]."""
    trim: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 1.0
    """Trim of its trimmed ICP."""
    physics: Literal["published", "session"] = "published"
    """published: 60 steps, 10 kg, gravity 2 m/s², damping 0.99, friction 1, one hull each. session: [physics]."""
