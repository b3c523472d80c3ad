"""Everything a person can ask for, as data: what buttons, keys, links and scripts put into the queue.

A session of work is a list of these, which can be kept as lines of text (:mod:`verefine_viz.viewer.command_json`).
The debugger carries them out in order, on one thread (:mod:`verefine_viz.viewer.debugger`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from verefine_viz.batch.index import Order

Changes = tuple[tuple[str, Any], ...]
"""Settings to change: (("method.exploration", 0.2), …)."""


@dataclass(frozen=True)
class Command:
    """Base of all commands."""

    latest_wins: ClassVar[bool] = False
    """A newer one of the same kind makes an older one that still waits pointless (sliders, dragging)."""
    only_looks: ClassVar[bool] = False
    """It neither computes anything of a run nor changes what is open: it is carried out while another takes long."""
    is_long: ClassVar[bool] = False
    """It may take long, and changes nothing that is open before it is done."""
    runs_beside: ClassVar[bool] = False
    """A run of A goes on while it is carried out."""
    keeps_b_running: ClassVar[bool] = False
    """B of a comparison goes on being computed."""
    keeps_edited_pose: ClassVar[bool] = False
    """It leaves the edited pose as it is."""
    controls_run: ClassVar[bool] = False
    """It begins or pauses a run, which is logged when it ends."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        """What the log holds of it, so that doing that again gives the same; ``cursor``: where the run is after it."""
        return () if self.controls_run else (self,)


Goal = Literal["end", "event", "breakpoint"]
CloudColors = Literal["colour", "residual", "class"]
BatchFilter = Literal["result", "cause", "object", "method", "run"]
Pose = tuple[float, ...]
"""The 16 numbers of a T_cam_obj, row by row."""

# Moving through the run


@dataclass(frozen=True)
class Step(Command):
    """To the end of the iteration that is shown stage by stage, else one iteration forward."""

    keeps_b_running = True


@dataclass(frozen=True)
class StepStage(Command):
    """One stage forward: current, simulated, mixed, refined, then the next iteration."""

    keeps_b_running = True


@dataclass(frozen=True)
class Back(Command):
    """One iteration back."""

    only_looks = keeps_b_running = True


@dataclass(frozen=True)
class Seek(Command):
    """To an iteration that was computed already; 0 = before the first."""

    latest_wins = only_looks = keeps_b_running = True
    cursor: int


@dataclass(frozen=True)
class SeekStage(Command):
    """To one stage of an iteration."""

    only_looks = keeps_b_running = True

    cursor: int
    stage: str


@dataclass(frozen=True)
class SeekEnd(Command):
    """To the last iteration that was computed."""

    only_looks = keeps_b_running = True


@dataclass(frozen=True)
class SeekEvent(Command):
    """To the next (+1) or previous (−1) mark on the timeline, among the iterations that were computed."""

    only_looks = keeps_b_running = True

    direction: int


@dataclass(frozen=True)
class RunUntil(Command):
    """Compute on, to the end, the next event, or a breakpoint; breakpoints stop all of them."""

    keeps_b_running = controls_run = True

    goal: Goal = "end"


@dataclass(frozen=True)
class RunTo(Command):
    """Compute on until the timeline holds this many iterations, breakpoints or not."""

    keeps_b_running = controls_run = True

    length: int


@dataclass(frozen=True)
class Pause(Command):
    """Stop computing after the iteration at hand."""

    keeps_edited_pose = controls_run = True


@dataclass(frozen=True)
class Cancel(Command):
    """End what takes long and is being done, with everything as it was before; does not wait for its turn."""

    keeps_edited_pose = controls_run = True


@dataclass(frozen=True)
class TogglePause(Command):
    """Run if paused, pause if running."""

    controls_run = True


@dataclass(frozen=True)
class Restart(Command):
    """Back to before iteration 1 with an empty timeline, settings changed if any are given."""

    is_long = True

    changes: Changes = ()


# What is open, and how it is solved


@dataclass(frozen=True)
class OpenFrame(Command):
    """Another frame of the session, ``scene/image``."""

    is_long = True

    frame: str


@dataclass(frozen=True)
class OpenDemo(Command):
    """Another built-in scene."""

    is_long = True

    name: str


@dataclass(frozen=True)
class OpenSession(Command):
    """A session file."""

    is_long = True

    path: str


@dataclass(frozen=True)
class Estimate(Command):
    """New initial poses for one object of the open frame, as a new branch; the others of the frame stay."""

    is_long = True

    instance_id: int
    estimator: Literal["ppf", "pcs", "session"]
    """session: back to those that the session gives its other objects."""


@dataclass(frozen=True)
class Fork(Command):
    """A new branch from iteration ``cursor`` on (None = where we are), with settings changed."""

    changes: Changes = ()
    cursor: int | None = None
    run: bool = False
    """Whether to run the branch to the end at once: the what-if."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, run=False),)


@dataclass(frozen=True)
class ForkFromPose(Command):
    """A new branch from where we are, in which the edited pose replaces the arm's current one."""

    keeps_edited_pose = True


@dataclass(frozen=True)
class ShowBranch(Command):
    """Another branch of this frame's runs."""

    index: int


@dataclass(frozen=True)
class SetBreakpoints(Command):
    """When a running method should stop and wait."""

    runs_beside = keeps_edited_pose = keeps_b_running = True

    changes: Changes


# Looking


@dataclass(frozen=True)
class Focus(Command):
    """An object of the frame, to which the page is then filtered; None = always the one that is worked on."""

    runs_beside = only_looks = keeps_b_running = True

    instance_id: int | None = None


@dataclass(frozen=True)
class ShowScene(Command):
    """The whole scene instead of one object, until one is chosen."""

    runs_beside = only_looks = True


@dataclass(frozen=True)
class SelectArm(Command):
    """Another hypothesis, whose history is shown; None = the one at work."""

    runs_beside = only_looks = keeps_b_running = True

    arm: int | None


@dataclass(frozen=True)
class Compare(Command):
    """Two stages side by side."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    a: str | None = None
    b: str | None = None


@dataclass(frozen=True)
class ShowMap(Command):
    """Which score map lies on the camera image in 3D, and is large in the Score panel."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    name: str


@dataclass(frozen=True)
class ProbePixel(Command):
    """The numbers of one pixel of the score maps."""

    latest_wins = runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True
    u: int
    v: int


@dataclass(frozen=True)
class ColorCloud(Command):
    """What the colours of the observed cloud mean; None = the next of the three."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    by: CloudColors | None = None


@dataclass(frozen=True)
class ShowLayer(Command):
    """A layer of the 3D scene on or off; None = the other way."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    name: str
    visible: bool | None = None


@dataclass(frozen=True)
class ScrubPath(Command):
    """One pose of the simulated path; None = hide it."""

    latest_wins = only_looks = keeps_edited_pose = keeps_b_running = True
    pose: int | None


@dataclass(frozen=True)
class PlayPath(Command):
    """Show the simulated path pose by pose."""

    keeps_edited_pose = keeps_b_running = True


@dataclass(frozen=True)
class Animate(Command):
    """Whether a step is shown stage by stage."""

    runs_beside = keeps_edited_pose = keeps_b_running = True

    on: bool


@dataclass(frozen=True)
class ScoreGroundTruth(Command):
    """Score the ground truth and put it beside the best pose."""

    runs_beside = keeps_edited_pose = keeps_b_running = True


@dataclass(frozen=True)
class EditPose(Command):
    """Start or stop editing the selected arm's pose with the gizmo."""

    on: bool = True


@dataclass(frozen=True)
class DragPose(Command):
    """The edited pose, while it is dragged."""

    latest_wins = keeps_edited_pose = True
    T_cam_obj: Pose


# Writing files


@dataclass(frozen=True)
class SaveSession(Command):
    """Settings, also those changed on the way, breakpoints and edited poses, to ``sessions/<name>.toml``."""

    keeps_edited_pose = True

    name: str
    replace: bool = False
    """Whether a file that holds another session, or another branch, may be replaced."""
    waiting: tuple[str, ...] = ()
    """What was typed as settings and is not in use, in words: it is not saved, and that is said."""


@dataclass(frozen=True)
class Export(Command):
    """Write the recording, the 3D scene as one HTML file, the results CSV, or the score maps as PNG."""

    runs_beside = is_long = keeps_edited_pose = keeps_b_running = True

    what: Literal["recording", "scene", "results", "maps", "commands"]
    client: int | None = None
    """The browser that asked, which gets the file as well; None = it is only written."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, client=None),)


# The gallery of a batch


@dataclass(frozen=True)
class OpenAt(Command):
    """A frame at one of its iterations, computed up to there if need be."""

    is_long = True

    frame: str
    iteration: int
    run: str = ""
    """Of several batch runs the one whose session is opened; empty = the one that is open."""
    instance: int | None = None
    """instance_id of the object that is then in focus."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, iteration=cursor),)


@dataclass(frozen=True)
class OpenFailure(Command):
    """The next (+1) or previous (−1) answer of the gallery, in its order and among what its filters leave."""

    is_long = True

    direction: int


@dataclass(frozen=True)
class OpenPoint(Command):
    """The answer whose point in the plot of score over error lies nearest."""

    is_long = True

    u: int
    v: int


@dataclass(frozen=True)
class SortBatch(Command):
    """The order in which a batch's answers are listed."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    order: Order


@dataclass(frozen=True)
class FilterBatch(Command):
    """Which of a batch's answers are listed; every filter counts until it is set to "all"."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True

    by: BatchFilter
    value: str


@dataclass(frozen=True)
class TurnPage(Command):
    """Another page of the gallery, counted from 0."""

    latest_wins = runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True
    page: int


# The order in which objects are solved; each restarts the run


@dataclass(frozen=True)
class CutDependency(Command):
    """Let what is seen between two instances count no more, or count again."""

    first: int
    """instance_id."""
    second: int
    cut: bool = True


@dataclass(frozen=True)
class MoveInOrder(Command):
    """Solve an object one place earlier (−1) or later (+1).

    At the end of its cluster, the whole cluster changes places with the next one.
    """

    instance_id: int
    by: int


@dataclass(frozen=True)
class ResetOrder(Command):
    """Back to the order of the rule."""
