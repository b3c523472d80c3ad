"""What a person can ask for when two runs are compared. A is the run that is open, B stands beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from verefine_viz.viewer.commands import Changes, Command

Side = Literal["A", "B"]
SidePose = Literal["best", "kept"]


@dataclass(frozen=True)
class CompareRun(Command):
    """B is a new run of the same frame from its start, with the settings of the open run and these changes.

    ("preset", "published") among them sets all that the preset sets.
    """

    changes: Changes = ()
    more: str = ""
    """Further changes, as a person writes them: "score.tau_m = 0.01; physics.collider = hull"."""
    run: bool = True
    """Whether to compute it to its end at once."""


@dataclass(frozen=True)
class CompareBranch(Command):
    """B is another branch of this frame."""

    index: int


@dataclass(frozen=True)
class CompareRecording(Command):
    """B is a recording of this frame (.rrd)."""

    path: str


@dataclass(frozen=True)
class OpenRecording(Command):
    """A recording as the open run (.rrd), on the frame that it was made of."""

    path: str


@dataclass(frozen=True)
class RunB(Command):
    """Compute B on until it holds this many iterations; None = to its end. The open run is left alone."""

    length: int | None = None


@dataclass(frozen=True)
class PauseB(Command):
    """Stop computing B after the iteration at hand."""


@dataclass(frozen=True)
class StopComparing(Command):
    """Show the open run alone again; B stays as a branch."""


@dataclass(frozen=True)
class SwapSides(Command):
    """B becomes the open run, and A stands beside it."""


@dataclass(frozen=True)
class SeekMoment(Command):
    """Both runs to a place on their common timeline; 0 = before the first."""

    latest_wins: ClassVar[bool] = True
    place: int


@dataclass(frozen=True)
class StepMoment(Command):
    """Both runs some places further on their common timeline, or back."""

    by: int


@dataclass(frozen=True)
class SeekDifference(Command):
    """Both runs to where B first does something otherwise than A."""


@dataclass(frozen=True)
class ShowSide(Command):
    """The poses of A or of B in 3D on or off; None = the other way."""

    side: Side
    visible: bool | None = None


@dataclass(frozen=True)
class ShowSidePoses(Command):
    """Which poses of both are drawn: the best so far, or what the latest iteration kept."""

    which: SidePose


SIDE_COMMANDS: tuple[type[Command], ...] = (
    CompareRun, CompareBranch, CompareRecording, OpenRecording, RunB, PauseB, StopComparing, SwapSides, SeekMoment,
    StepMoment, SeekDifference, ShowSide, ShowSidePoses,
)  # fmt: skip
