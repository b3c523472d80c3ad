"""One moment of the debugger, frozen: all that the panels and the 3D scene need to draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.refiner_steps import RefinerStep
from verefine_viz.core.scores import PoseScore, ScoreMaps
from verefine_viz.core.settings import Edit, Session
from verefine_viz.diagnosis.ambiguity import OtherPose
from verefine_viz.diagnosis.signs import FinishedObject
from verefine_viz.evaluation.landscape import Landscape, Slice
from verefine_viz.evaluation.near_symmetry import NearSymmetry
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.run.edits import edits_of, never_reached
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot
from verefine_viz.viewer.snapshot.frame_track import TrackFrame
from verefine_viz.viewer.snapshot.scene_state import ScenePhysics, SceneState
from verefine_viz.viewer.state.batch_gallery import Entry, Gallery
from verefine_viz.viewer.state.grasp_trials import ShownGrasp, shown_grasp
from verefine_viz.viewer.state.timeline_marks import Mark
from verefine_viz.viewer.state.view_options import ViewOptions, revealed, stage_label
from verefine_viz.viewer.state.workspace import WrittenFile

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspPair


@dataclass(frozen=True, eq=False)
class EvaluatedPose:
    """One pose with everything known about it."""

    name: str
    """One of ``view_options.STAGES``, or what a scene is called."""
    T_cam_obj: Float
    """(4, 4); of a scene (m, 4, 4)."""
    score: PoseScore | None
    errors: PoseErrors | None
    ms: float = 0.0
    is_of_best_scene: bool = False
    """Whether it is the answer for what it adds to the whole scene: alone another pose may score higher."""
    side: c.Side | None = None
    """The run of a comparison that it is of; ``name`` is then that of the run."""

    @property
    def color(self) -> RGB:
        """In which it is drawn."""
        return SIDE_COLORS[self.side] if self.side else STAGE_COLORS.get(self.name, STAGE_COLORS["current"])

    @property
    def label(self) -> str:
        """What the page calls it."""
        return stage_label(self.name)


@dataclass(frozen=True, eq=False)
class ComparedPose:
    """One of the two stages that are compared."""

    pose: EvaluatedPose
    maps: ScoreMaps | None
    """None in a snapshot that is not deep."""
    probe: Probe | None = None


@dataclass(frozen=True, eq=False)
class BranchSummary:
    """One of the runs on this frame."""

    name: str
    length: int
    n_iterations: int
    best: tuple[Best | None, ...]
    """Per instance."""
    errors: tuple[PoseErrors | None, ...]
    """Per instance, of ``best``."""
    has_other_scale: bool = False
    """Whether the score of ``best`` is by other settings than that of the shown branch."""


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    done: int
    total: int
    running: bool
    remaining_s: float | None
    """Estimate; None where nothing was timed yet."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What is on the screen."""

    session: Session
    """The settings of the open branch, and what was changed and moved on the way."""
    session_path: Path | None
    session_file: Path | None
    """Where the open session was read or written last, absolute; None = in no file."""
    frames: tuple[str, ...]
    track: tuple[TrackFrame, ...]
    """The object in focus over the frames of a sequence; empty where the frames are none."""
    frame: str
    link: str
    """What the page's address has behind its #: this frame, object and iteration."""
    demos: tuple[str, ...]
    sessions: tuple[str, ...]
    """Session files that lie at hand."""
    batch: Gallery | None
    """The batch whose answers are listed; None = no batch was opened."""
    entry: Entry | None
    """What the batch says about the object in focus; None where it says nothing."""
    problem: Problem
    exploration: float
    """The weight c of UCB's bonus in the choice that follows the cursor; ``session`` has the one at the end."""
    doubts: tuple[str, ...]
    """What of the frame's data does not fit together, with what to check."""
    recording: Path | None
    """The file that the open branch was read from; None = it was computed here."""
    missing: str
    """What of that file could not be read, or was never written, a sentence; "" = nothing."""
    branches: tuple[BranchSummary, ...]
    branch: int
    cursor: int
    progress: Progress
    iterations: tuple[Iteration, ...]
    """The whole history, without its newest iteration where that is shown stage by stage."""
    marks: tuple[Mark, ...]
    is_answer: bool
    """Whether the end of a finished run shows its answer, not the iteration that it tried last."""
    is_partial: bool
    """Whether the iteration at the cursor is shown up to a stage before its last one: what it comes to is not known."""
    shown: Iteration | None
    """The latest iteration up to the cursor that worked on the object in focus."""
    target: Target
    """The object in focus."""
    state: Any
    """The method's state of the object in focus at the cursor: ``arms``, ``best``, ``initial``; None without any."""
    begun: Any
    """The same after the first iteration on the object, with the scores of that time; ``state`` where it had none."""
    poses: dict[str, EvaluatedPose]
    """By stage, those that exist (and are revealed) at the cursor."""
    arm: int
    """The hypothesis in focus."""
    options: ViewOptions
    a: ComparedPose | None
    b: ComparedPose | None
    plausible: dict[str, Any]
    """Plausibility by stage, where it is known: of the pose before the simulation ("current"), of the accepted
    one ("accepted") or the answer ("best"), and of the edited one ("edited")."""
    initial_errors: tuple[PoseErrors | None, ...]
    """Per hypothesis of the object in focus."""
    error_series: tuple[tuple[Iteration, PoseErrors | None, PoseErrors | None], ...]
    """(iteration, errors of its accepted pose, errors of the best pose so far) of the object in focus."""
    ground_truth: EvaluatedPose | None
    """Scored; None where there is none."""
    landscape: Landscape | None
    """The score around the best pose of the object in focus; None where it is not known, or not asked for."""
    score_slice: Slice | None
    """The same over the two axes that are chosen."""
    other_pose: OtherPose | None
    """A pose that the observation cannot tell from that answer; None also where that is not known."""
    near_symmetries: tuple[NearSymmetry, ...] | None
    """Of the model of the object in focus; None where they are not known by now."""
    scene: SceneState
    """All objects of the frame."""
    finished: tuple[FinishedObject, ...]
    """Every object once the run is over, wherever the cursor is; empty before, and while it is computed."""
    frame_score: PoseScore | None
    """Of all answers so far, rendered together; None for a single object."""
    map_target: Target
    """Whose score ``a`` and ``b`` are: the object in focus, or all objects as one where the whole scene is shown."""
    best_errors: Mapping[int, PoseErrors | None]
    """By iteration: errors of the best pose of its object; empty unless the whole scene is shown."""
    physics: ScenePhysics
    """What is known by now about the scene."""
    grasp: GraspPair | None = None
    """The grasps by the pose of the object in focus and by its ground truth; None where they were not carried out."""
    refiner: Refiner | None = None
    """Of the iteration that is shown, or that made the answer; None where recorded steps are repeated."""
    refiner_steps: Sequence[RefinerStep] | None = None
    """What it saw in that iteration; None where that is not asked for, or not known."""
    refiner_start: str = ""
    """Which iteration that is, of an answer, and how far from the ground truth it began and how far it was trained
    for, where both are known."""
    deep: bool = True
    """Whether score maps, the probed pixel and plausibility were worked out; else panels keep theirs. While a
    pose is edited plausibility always is: it has to follow the pose."""
    message: str = ""
    """What just happened or went wrong, in a sentence."""
    refused: bool = False
    """Whether the message says what went wrong."""
    offer: tuple[str, Command] | None = None
    """Words and command of the link behind a message that refuses."""
    written: tuple[WrittenFile, ...] = ()
    """Files written lately."""
    comparison: ComparisonSnapshot | None = None
    """The comparison with another run; None = there is none."""

    def at(self, index: int) -> Iteration:
        """Iteration ``index``, from 1: every run numbers them without a gap, also where it was forked or read."""
        return self.iterations[index - 1]

    @property
    def name(self) -> str:
        """Of the object in focus."""
        return self.target.model.name

    @property
    def finished_in_focus(self) -> FinishedObject | None:
        """The object in focus once the run is over."""
        return next((o for o in self.finished if o.instance_id == self.target.instance.instance_id), None)

    @property
    def is_whole_scene(self) -> bool:
        """Whether panels show the scene instead of one object."""
        return self.options.whole_scene and len(self.scene.objects) > 1

    @property
    def T_cam_obj_grasped(self) -> Float | None:
        """The pose by which the object in focus is grasped: the edited one, or else the answer so far."""
        return next((self.poses[name].T_cam_obj for name in ("edited", "best") if name in self.poses), None)

    @cached_property
    def shown_grasp(self) -> ShownGrasp | None:
        """The grasp that is drawn in 3D."""
        return shown_grasp(self.grasp, self.options.grasp_by, self.options.grasp_moment)

    @property
    def has_plausibility(self) -> bool:
        """Whether ``plausible`` is up to date."""
        return self.deep or self.options.edited is not None

    @property
    def n_arms(self) -> int:
        return len(self.target.instance.hypotheses)

    @property
    def is_current(self) -> bool:
        """Whether the iteration at the cursor is the one that is shown."""
        return self.shown is not None and self.shown.index == self.cursor

    @cached_property
    def edits(self) -> tuple[Edit, ...]:
        """The edited poses that the session has in this frame."""
        return edits_of(self.session.edits, self.problem, is_only_frame=len(self.frames) == 1)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about the frame, and of what the session does behind the end of the run."""
        changes, p = self.session.changes, self.progress
        # A change on the way may make the run longer.
        is_known = not any(p.done < change.after_iteration <= p.total for change in changes)
        return (*self.problem.notes, *(never_reached(self.edits, changes, p.total) if is_known else ()))

    @property
    def at_end(self) -> bool:
        """Whether the cursor is at the end of a finished run."""
        return self.cursor == self.progress.done == self.progress.total

    @property
    def wants_landscape(self) -> bool:
        """Whether the score around the best pose is to be worked out: at the end, or where it is asked for."""
        is_idle = not self.progress.running and not self.is_whole_scene
        return "best" in self.poses and is_idle and (self.at_end or self.options.landscape_wanted)

    @cached_property
    def data_doubts(self) -> tuple[str, ...]:
        """``doubts``, or what a batch reports of the same frame: before a run is over it may know more."""
        if self.doubts or self.batch is None or self.entry is None:
            return self.doubts
        doubt = self.batch.doubt_in(self.entry.run, self.frame).removesuffix(".")
        return (doubt,) if doubt else ()

    @cached_property
    def own_iterations(self) -> tuple[Iteration, ...]:
        """Those of the object in focus, whole history."""
        own = self.target.instance.instance_id
        return tuple(i for i in self.iterations if i.instance_id == own)


@dataclass(frozen=True)
class Probe:
    """One pixel of the score, in numbers. None = nothing was measured, or rendered, there."""

    u: int
    v: int
    observed_m: float | None
    rendered_m: float | None
    difference_mm: float | None
    angle_deg: float | None
    f_d: float
    f_n: float
    pixel_class: str
    contribution: float
    """What depth and normal of this pixel add to the score: (1 − w) (f_d + f_n) / 2N; 0 where it is not counted."""
    counted: bool
    correlation: float | None = None
    """What it adds to f_c, times the number of explained pixels; None where the colour term does not count it."""
    rendered_rgb: tuple[int, int, int] | None = None
    observed_rgb: tuple[int, int, int] | None = None
    """Of the smoothed image; None where the colour term is off."""


def visit(snapshot: Snapshot, iteration: Iteration) -> c.Command:
    """Goes to an iteration, also to the last one of a finished run, where the end would show the answer."""
    p = snapshot.progress
    if iteration.index == p.done == p.total:
        return c.SeekStage(iteration.index, iteration.stages[-1].name)
    return c.Seek(iteration.index)


def is_revealed(snapshot: Snapshot, stage: str) -> bool:
    """Whether the iteration is shown up to this stage."""
    if snapshot.shown is None:
        return False
    return stage in revealed(snapshot.shown, snapshot.options.stage if snapshot.is_current else None)
