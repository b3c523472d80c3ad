"""What a person can ask for when two runs are compared. A is the run that is open, B stands beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from verefine_viz.viewer.commands import Changes, Command

Side = Literal["A", "B"]
SidePose = Literal["best", "kept"]


@dataclass(frozen=True)
class CompareRun(Command):
    """B is a new run of the same frame from its start, with the settings of the open run and these changes.

    ("preset", "published") among them sets all that the preset sets.
    """

    runs_beside = is_long = keeps_edited_pose = True

    changes: Changes = ()
    more: str = ""
    """Further changes, as a person writes them: "score.tau_m = 0.01; physics.collider = hull"."""
    run: bool = True
    """Whether to compute it to its end at once."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, run=False),)


@dataclass(frozen=True)
class CompareBranch(Command):
    """B is another branch of this frame."""

    runs_beside = keeps_edited_pose = True

    index: int


@dataclass(frozen=True)
class CompareRecording(Command):
    """B is a recording of this frame (.rrd)."""

    runs_beside = is_long = keeps_edited_pose = True

    path: str


@dataclass(frozen=True)
class OpenRecording(Command):
    """A recording as the open run (.rrd), on the frame that it was made of."""

    is_long = True

    path: str


@dataclass(frozen=True)
class RunB(Command):
    """Compute B on until it holds this many iterations; None = to its end. The open run is left alone."""

    runs_beside = keeps_edited_pose = True

    length: int | None = None

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return ()  # How far B was computed is noted when it stops.


@dataclass(frozen=True)
class PauseB(Command):
    """Stop computing B after the iteration at hand."""

    runs_beside = keeps_edited_pose = True

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return ()  # How far B was computed is noted when it stops.


@dataclass(frozen=True)
class StopComparing(Command):
    """Show the open run alone again; B stays as a branch."""

    runs_beside = keeps_edited_pose = True


@dataclass(frozen=True)
class SwapSides(Command):
    """B becomes the open run, and A stands beside it."""


@dataclass(frozen=True)
class SeekMoment(Command):
    """Both runs to a place on their common timeline; 0 = before the first."""

    latest_wins = only_looks = keeps_b_running = True
    place: int


@dataclass(frozen=True)
class StepMoment(Command):
    """Both runs some places further on their common timeline, or back."""

    keeps_b_running = True

    by: int


@dataclass(frozen=True)
class SeekDifference(Command):
    """Both runs to where B first does something otherwise than A."""

    keeps_b_running = True


@dataclass(frozen=True)
class ShowSide(Command):
    """The poses of A or of B in 3D on or off; None = the other way."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    side: Side
    visible: bool | None = None


@dataclass(frozen=True)
class ShowSidePoses(Command):
    """Which poses of both are drawn: the best so far, or what the latest iteration kept."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    which: SidePose
