"""Everything that can be asked for, as data: what buttons, keys, links and scripts put into the queue.

A session of work is a list of these, which can be saved as lines of text (:mod:`verefine_viz.viewer.command_json`).
The debugger carries them out in order, on one thread (:mod:`verefine_viz.viewer.debugger`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, dataclass_transform

from verefine_viz.batch.index import Order

Changes = tuple[tuple[str, Any], ...]
"""Settings to change: (("method.exploration", 0.2), …)."""
Goal = Literal["end", "event", "breakpoint"]
CloudColors = Literal["colour", "residual", "class", "error"]
Preset = Literal["inspect", "maps", "compare", "gallery"]
Pane = Literal["image", "3D"]
GalleryFilter = Literal["result", "cause", "object", "method", "run", "tag"]
Pose = tuple[float, ...]
"""The 16 numbers of a T_cam_obj, row by row."""
Side = Literal["A", "B"]
SidePose = Literal["best", "kept"]


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Command:
    """Base of all commands. What is derived from it is a frozen dataclass."""

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
    """It begins or pauses a run: what is logged is where that run ends."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    def logged(self, cursor: int) -> tuple[Command, ...]:
        """What the log holds of it, so that doing that again gives the same; ``cursor``: where the run is after it."""
        return () if self.controls_run else (self,)


# Kinds of commands


class MoveCommand(Command):
    """Shows another part of the history."""

    only_looks = keeps_b_running = True


class AdvanceCommand(Command):
    """Goes on in the open run, and computes what is missing."""

    keeps_b_running = True


class OpenCommand(Command):
    """Changes what is open."""

    is_long = True


class ViewCommand(Command):
    """Changes how it is shown."""

    runs_beside = only_looks = keeps_edited_pose = keeps_b_running = True


class ComparisonCommand(Command):
    """Is about B of a comparison, whatever the open run does."""

    runs_beside = keeps_edited_pose = True


# Moving through the run


class Step(AdvanceCommand):
    """To the end of the iteration that is shown stage by stage, else one iteration forward."""


class StepStage(AdvanceCommand):
    """One stage forward: current, simulated, mixed, refined, then the next iteration."""


class Back(MoveCommand):
    """One iteration back."""


class Seek(MoveCommand):
    """To an iteration that was computed already; 0 = before the first."""

    latest_wins = True
    cursor: int


class SeekStage(MoveCommand):
    """To one stage of an iteration."""

    cursor: int
    stage: str


class SeekEnd(MoveCommand):
    """To the last iteration that was computed."""


class SeekEvent(MoveCommand):
    """To the next (+1) or previous (−1) mark on the timeline, among the iterations that were computed."""

    direction: int


class RunUntil(AdvanceCommand):
    """Compute on, to the end, the next event, or a breakpoint; breakpoints stop all of them."""

    controls_run = True
    goal: Goal = "end"


class RunTo(AdvanceCommand):
    """Compute on until the timeline holds this many iterations, breakpoints or not."""

    controls_run = True
    length: int


class Pause(Command):
    """Stop computing after the iteration at hand."""

    keeps_edited_pose = controls_run = True


class Cancel(Command):
    """End what takes long and is being done, with everything as it was before; does not wait for its turn."""

    keeps_edited_pose = controls_run = True


class UseHulls(Command):
    """Do not wait for convex parts of new models: open what is being opened with their hulls; does not wait either."""

    keeps_edited_pose = controls_run = True


class TogglePause(Command):
    """Run if paused, pause if running."""

    controls_run = True


class Restart(OpenCommand):
    """Back to before iteration 1 with an empty timeline, settings changed if any are given."""

    changes: Changes = ()


# What is open, and how it is solved


class OpenFrame(OpenCommand):
    """Another frame of the session, ``scene/image``."""

    latest_wins = True
    frame: str
    hulls: bool = False
    """Physics takes every model for its convex hull, whatever the session says: nothing has to be decomposed."""


class OpenNeighbour(OpenCommand):
    """The next (+1) or previous (−1) frame of the session, by number."""

    direction: int


class OpenDemo(OpenCommand):
    """Another built-in scene."""

    name: str
    hulls: bool = False


class OpenSession(OpenCommand):
    """A session file."""

    path: str
    hulls: bool = False


class Estimate(OpenCommand):
    """New initial poses for one object of the open frame, as a new branch; the others of the frame stay."""

    instance_id: int
    estimator: Literal["ppf", "pcs", "densefusion", "session"]
    """session: back to those that the session gives its other objects."""


class Fork(Command):
    """A new branch from iteration ``cursor`` on (None = where we are), with settings changed."""

    changes: Changes = ()
    cursor: int | None = None
    run: bool = False
    """Whether to run the branch to the end at once: the what-if."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, run=False),)


class ForkFromPose(Command):
    """A new branch from where we are, in which the edited pose replaces the arm's current one."""

    keeps_edited_pose = True


class ShowBranch(Command):
    """Another branch of this frame's runs."""

    index: int


class SetBreakpoints(Command):
    """When a running method should stop and wait."""

    runs_beside = keeps_edited_pose = keeps_b_running = True
    changes: Changes


# What is shown


class Focus(Command):
    """An object of the frame, to which the page is then filtered; None = always the one that is worked on."""

    runs_beside = only_looks = keeps_b_running = True
    instance_id: int | None = None


class ShowScene(Command):
    """The whole scene instead of one object, until one is chosen."""

    runs_beside = only_looks = True


class SelectArm(Command):
    """Another hypothesis, whose history is shown; None = the one at work."""

    runs_beside = only_looks = keeps_b_running = True
    arm: int | None


class Compare(ViewCommand):
    """Two stages side by side."""

    a: str | None = None
    b: str | None = None


class ShowMap(ViewCommand):
    """Which score map lies on the camera image in 3D, and is large in the Score panel."""

    name: str


class ShowRefinerCrops(ViewCommand):
    """What a learned refiner saw, instead of the score maps, or these again; None = the other of both."""

    on: bool | None = None


class ProbePixel(ViewCommand):
    """The numbers of one pixel of the score maps."""

    latest_wins = True
    u: int
    v: int


class PlaceRuler(ViewCommand):
    """A ruler from the probed pixel to the next one that is probed; where there is one, it is taken away."""


class CutView(ViewCommand):
    """Cuts the object in focus open in 3D, on the side of the viewer: how much of its diameter is cut off [%]."""

    latest_wins = True
    percent: int


class MoveCamera(ViewCommand):
    """The 3D view of one browser: exactly where the sensor was, or close to the object in focus."""

    to: Literal["sensor", "object"]
    client: int | None = None
    """The browser that asked; None = no view moves."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return ()


class ColorCloud(ViewCommand):
    """What the colours of the observed cloud mean; None = the next of the four."""

    by: CloudColors | None = None


class ShowLayer(ViewCommand):
    """A layer of the 3D scene on or off; None = the other way."""

    name: str
    visible: bool | None = None


class ShowLayout(ViewCommand):
    """Which pictures the middle of the page holds."""

    preset: Preset


class Enlarge(ViewCommand):
    """The image or the 3D view alone in the middle; the one that is enlarged goes back; None = the next of both."""

    pane: Pane | None = None


class ScrubPath(Command):
    """One pose of the simulated path; None = hide it."""

    latest_wins = only_looks = keeps_edited_pose = keeps_b_running = True
    pose: int | None


class PlayPath(Command):
    """Show the simulated path pose by pose."""

    keeps_edited_pose = keeps_b_running = True


class Animate(Command):
    """Whether a step is shown stage by stage."""

    runs_beside = keeps_edited_pose = keeps_b_running = True
    on: bool


class ScoreGroundTruth(Command):
    """Score the ground truth and put it beside the best pose."""

    runs_beside = keeps_edited_pose = keeps_b_running = True


class EditPose(Command):
    """Start or stop editing the selected arm's pose with the gizmo."""

    on: bool = True


class ShowLandscape(ViewCommand):
    """The score around the best pose: curves of one frame's axes, a heat map over two of all axes; None = as before."""

    frame: Literal["table", "object"] | None = None
    across: int | None = None
    up: int | None = None


class EditPoseOnCurve(Command):
    """Edit the pose at a sample of a curve of the landscape."""

    keeps_edited_pose = True
    curve: int
    u: int
    v: int = 0
    """Of a click; it does not matter."""


class EditPoseInSlice(Command):
    """Edit the pose at a point of the landscape's heat map: column, and row from the top."""

    keeps_edited_pose = True
    u: int
    v: int


class EditOtherPose(Command):
    """Edit the pose that the observation cannot tell from the answer."""

    keeps_edited_pose = True


class DragPose(Command):
    """The edited pose, while it is dragged."""

    latest_wins = keeps_edited_pose = True
    T_cam_obj: Pose


# Writing files


class SaveSession(Command):
    """Settings, also those changed on the way, breakpoints and edited poses, to ``sessions/<name>.toml``."""

    keeps_edited_pose = True
    name: str
    replace: bool = False
    """Whether a file that holds another session, or another branch, may be replaced."""
    waiting: tuple[str, ...] = ()
    """What was typed as settings and is not in use, in words: it is not saved, and the page says so."""


class Export(Command):
    """Write the recording, the 3D scene as one HTML file, the results CSV, or the score maps as PNG."""

    runs_beside = is_long = keeps_edited_pose = keeps_b_running = True
    what: Literal["recording", "scene", "results", "maps", "commands"]
    client: int | None = None
    """The browser that asked, which gets the file as well; None = it is only written."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, client=None),)


# The gallery of a batch


class OpenAt(OpenCommand):
    """A frame at one of its iterations, computed up to there if need be."""

    frame: str
    iteration: int
    run: str = ""
    """Of several batch runs the one whose session is opened; empty = the one that is open."""
    instance: int | None = None
    """instance_id of the object that is then in focus."""
    object: int | None = None
    """obj_id of the object that is then in focus, which the frame holds once."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, iteration=cursor),)


class OpenLink(OpenCommand):
    """What stands behind the # of the page's address, see :mod:`verefine_viz.viewer.state.page_link`."""

    link: str


class OpenFailure(OpenCommand):
    """The next (+1) or previous (−1) answer of the gallery, in its order and among what its filters leave."""

    direction: int


class OpenPoint(OpenCommand):
    """The answer whose point in the plot of score over error lies nearest."""

    u: int
    v: int


class RefreshGallery(ViewCommand):
    """A folder that is watched has changed."""

    latest_wins = True

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return ()


class ArrangeGallery(ViewCommand):
    """Which of a batch's answers are listed, and in which order."""

    latest_wins = True
    order: Order = "error"
    only: tuple[tuple[GalleryFilter, str], ...] = ()
    search: str = ""
    browser: str = ""
    """The browser that asked, which shows it already."""


class TagAnswers(ViewCommand):
    """Gives answers a tag, or takes it away; kept in ``tags.json`` beside their run."""

    answers: tuple[int, ...]
    """Their numbers in the gallery, in the order of frames.csv."""
    tag: str
    on: bool = True


class SaveFilter(ViewCommand):
    """Keeps what the gallery shows under a name, in the same file."""

    name: str
    order: Order = "error"
    only: tuple[tuple[GalleryFilter, str], ...] = ()
    search: str = ""


class DeleteFilter(ViewCommand):
    """Forgets a saved filter."""

    name: str


# The order in which objects are solved; each restarts the run


class CutDependency(Command):
    """Let what is seen between two instances count no more, or count again."""

    first: int
    """instance_id."""
    second: int
    cut: bool = True


class MoveInOrder(Command):
    """Solve an object one place earlier (−1) or later (+1).

    At the end of its cluster, the whole cluster changes places with the next one.
    """

    instance_id: int
    by: int


class ResetOrder(Command):
    """Back to the order of the rule."""


# The world in which objects are simulated; restarts the run


class DropUnknown(Command):
    """Let an unknown object of the surroundings stop nothing, or stop others again."""

    number: int
    """1, 2, …"""
    drop: bool = True


# Two runs compared: A is the run that is open, B stands beside it


class CompareRun(ComparisonCommand):
    """B is a new run of the same frame from its start, with the settings of the open run and these changes.

    ("preset", "published") among them sets all that the preset sets.
    """

    is_long = True
    changes: Changes = ()
    more: str = ""
    """Further changes, as they are typed: "score.tau_m = 0.01; physics.collider = hull"."""
    run: bool = True
    """Whether to compute it to its end at once."""

    def logged(self, cursor: int) -> tuple[Command, ...]:
        return (replace(self, run=False),)


class CompareBranch(ComparisonCommand):
    """B is another branch of this frame."""

    index: int


class CompareRecording(ComparisonCommand):
    """B is a recording of this frame (.rrd)."""

    is_long = True
    path: str


class OpenRecording(OpenCommand):
    """A recording as the open run (.rrd), on the frame that it was made of."""

    path: str


class RunB(ComparisonCommand):
    """Compute B on until it holds this many iterations; None = to its end. The open run is left alone."""

    controls_run = True
    length: int | None = None


class PauseB(ComparisonCommand):
    """Stop computing B after the iteration at hand."""

    controls_run = True


class StopComparing(ComparisonCommand):
    """Show the open run alone again; B stays as a branch."""


class SwapSides(Command):
    """B becomes the open run, and A stands beside it."""


class SeekMoment(MoveCommand):
    """Both runs to a pair of iterations, from 1; 0 = before the first."""

    latest_wins = True
    place: int


class StepMoment(AdvanceCommand):
    """Both runs some pairs of iterations further, or back."""

    by: int


class SeekDifference(AdvanceCommand):
    """Both runs to where B first does something otherwise than A."""


class ShowSide(ViewCommand):
    """The poses of A or of B in 3D on or off; None = the other way."""

    side: Side
    visible: bool | None = None


class ShowSidePoses(ViewCommand):
    """Which poses of both are drawn: the best so far, or what the latest iteration accepted."""

    which: SidePose
