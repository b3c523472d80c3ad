"""Settings of breakpoints."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from verefine_viz.core.fields import Settings

MOST = {"score_falls_by": 1, "jump_mm": 10_000, "jump_deg": 180, "error_grows_by_mm": 10_000}
"""The largest number of each breakpoint that has one; what happens never exceeds it."""


class ThresholdSettings(Settings):
    """Breakpoints with a number; unset = never."""

    score_falls_by: Annotated[float, Field(ge=0, le=MOST["score_falls_by"])] | None = None
    """The accepted score is lower than the arm's previous one by more than this [score]."""
    jump_mm: Annotated[float, Field(ge=0, le=MOST["jump_mm"])] | None = None
    """The accepted pose moved further than this [mm]."""
    jump_deg: Annotated[float, Field(ge=0, le=MOST["jump_deg"])] | None = None
    """The accepted pose turned further than this [deg]."""
    error_grows_by_mm: Annotated[float, Field(ge=0, le=MOST["error_grows_by_mm"])] | None = None
    """ADD(-S) of the accepted pose against ground truth grew by more than this [mm]."""


class BreakpointSettings(ThresholdSettings):
    """When a running method should stop and wait; unset = never."""

    simulated_rejected: bool = False
    """The refined pose was kept instead of the simulated one, by however little: the usual case."""
    refined_rejected: bool = False
    """The simulated pose was kept instead of the refined one."""
    arm_switched: bool = False
    """The bandit chose another hypothesis than before."""
    unstable: bool = False
    """The object touches something and would tip: its centre of mass is outside its support after the simulation."""
    physics_worse: bool = False
    """The simulated pose scores at least 0.2 less than the pose it began with."""
    empty_render: bool = False
    """A pose rendered to nothing, or its score was not a number."""
    waiting: ThresholdSettings = ThresholdSettings()
    """Numbers of breakpoints that are off, for when they are switched on: the page keeps them."""
