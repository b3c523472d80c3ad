"""A run as data: what it was about, what every iteration did, and what it answered.

Everything that draws, compares, explains or tabulates a run reads this; ``run/run_file.py`` writes and reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.number_kinds import Id, Real
from verefine_viz.core.problem import Hypothesis, LeftOut, Problem
from verefine_viz.core.protocols import RunState
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.setting_types import Index, Seed
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import parsed_toml, resolve, session_toml
from verefine_viz.run.versions import versions
from verefine_viz.scenes.frames import parse_frame

FORMAT = 1
"""Format of the run file; a reader refuses later ones."""
DATA_FIRST = "Look at the data first:"
"""Stands before what does not fit together in a frame's data, behind the cause."""
WAITING = "not solved yet"
"""The message about a frame that has only just arrived in a watched folder; no table has such rows."""
Status = Literal["ok", "no_answer", "left_out", "failed"]


class ObjectHeader(Struct, frozen=True, eq=False):
    """One object of the frame, before the first iteration."""

    instance_id: Id
    obj_id: Id
    name: str
    """Name of the model."""
    diameter_m: Annotated[float, Meta(gt=0, le=1e300)]
    T_cam_obj_gt: Float | None
    """(4, 4) [m]; None = unknown."""
    hypotheses: tuple[Hypothesis, ...]
    initial: tuple[PoseScore, ...]
    """Scores of the hypotheses; none where there is no hypothesis."""


class RunHeader(Struct, frozen=True, eq=False):
    """What a run is about: enough to run it again."""

    format: int
    session: str
    """The session file, every field explicit."""
    frame: str
    """``scene/image``."""
    title: str
    versions: dict[str, str]
    """Python, the packages and the weights whose numbers enter the run."""
    objects: tuple[ObjectHeader, ...]
    """Objects to solve, in their order."""
    T_map_cam: Float | None = None
    """(4, 4) camera to the data set's world [m]; None where the data set does not know it."""
    T_table_cam: Float | None = None
    """(4, 4) camera to a frame on the support plane, z up [m]; None where there is no plane."""
    notes: tuple[str, ...] = ()
    """About the data."""


Size = Annotated[float, Meta(ge=0, le=1e300)]


class Answer(Struct, frozen=True, eq=False, kw_only=True):
    """What became of one object: its pose, its errors, its times, and why it is wrong. None, 0 or "" = unknown.

    A frame that failed has one for each object that ground truth names; without ground truth, one without an object.
    """

    frame: str
    """``scene/image``."""
    instance_id: Id | None = None
    obj_id: Id | None = None
    name: str = ""
    method: str = ""
    seed: Seed | None = None
    """Seed of the initial poses (hypotheses.seed)."""
    visib_fract: Real | None = None
    """Visible share of the object, where the data set knows it."""
    has_truth: bool = False
    """Whether the data set has its ground truth; such an object counts for the recall, also without an answer."""
    status: Status
    """ok; no_answer: the object has no hypothesis; left_out: its mask or its model is missing or damaged; failed: the
    whole frame is. ``message`` says why."""
    T_cam_obj: Float | None = None
    """(4, 4) the answer [m]."""
    middle_m: Float | None = None
    """(3,) the middle of the object's bounding box, in its own frame [m]."""
    score: Real | None = None
    initial_score: Real | None = None
    """Best of the hypotheses."""
    colour_fit: Real | None = None
    """f_c of the answer in [−1, 1]; None where colour does not count."""
    plausibility: Real | None = None
    """p of the answer in [0, 1]; None where plausibility does not count."""
    recorded_score: Real | None = None
    """Score of the answer by the program whose steps were recorded, in its own units."""
    missing_depth: Real | None = None
    """Share of the object's mask without depth."""
    add_s_mm: Size | None = None
    """ADD, or ADD-S for symmetric objects, of the answer against ground truth."""
    initial_add_s_mm: Size | None = None
    """ADD(-S) of the hypothesis with the best initial score."""
    rotation_deg: Size | None = None
    translation_mm: Size | None = None
    diameter_mm: Size | None = None
    best_hypothesis: Index | None = None
    """Number of the hypothesis that the answer comes from, from 1."""
    best_iteration: Index | None = None
    """0 = the answer is an initial pose."""
    worst_iteration: Index | None = None
    """The iteration that took this object furthest from its goal: by more than 3 % of the diameter, or by more than
    0.01 of the score where there is no ground truth. None where none took it so far."""
    undetermined_mm: Real | None = None
    """The furthest shift of the answer, along an axis of the table or the model, by which the score falls no more than
    noise of the depth image explains."""
    undetermined_deg: Real | None = None
    """Width for a turn; 180 about an axis of symmetry."""
    n_hypotheses: Index = 0
    n_iterations: Index = 0
    grasp: str = ""
    """How a simulated grasp by the answer ends (``grasping/grasp_trial.py``); "" where none was tried."""
    grasp_ground_truth: str = ""
    """Outcome by the ground-truth pose."""
    events: str = ""
    """Kinds and how often: ``arm_switched 4; score_fell 1``."""
    ms_refine: Real = 0.0
    ms_simulate: Real = 0.0
    ms_score: Real = 0.0
    ms_total: Real = 0.0
    cause: str = ""
    """Why the answer is wrong, where that is known."""
    evidence: str = ""
    """The cause in one sentence, with its numbers."""
    message: str = ""

    @property
    def scene_id(self) -> int:
        return parse_frame(self.frame)[0]

    @property
    def im_id(self) -> int:
        return parse_frame(self.frame)[1]

    @property
    def is_object(self) -> bool:
        """Whether it is about an object; False of a failed frame whose objects are unknown."""
        return self.status != "failed" or self.obj_id is not None

    @property
    def is_waiting(self) -> bool:
        """Whether it stands for a frame that is still to be solved."""
        return self.message == WAITING

    @property
    def can_be_right(self) -> bool:
        """Whether there is ground truth to compare an answer with; without an answer it is missed."""
        return self.has_truth or self.add_s_mm is not None

    @property
    def was_asked_for(self) -> bool:
        """Whether the method got it to solve: neither was it left out nor did its frame fail."""
        return self.status in ("ok", "no_answer")

    @property
    def doubt(self) -> str:
        """What of its frame's data does not fit together, as far as that was checked; else ""."""
        return self.evidence.partition(DATA_FIRST)[2].strip()

    @property
    def relative_error(self) -> float | None:
        """ADD(-S) as a share of the diameter; None where there is no answer or no ground truth."""
        if self.add_s_mm is None or not self.diameter_mm:
            return None
        return self.add_s_mm / self.diameter_mm

    @property
    def is_correct(self) -> bool | None:
        """ADD(-S) below 10 % of the diameter; None without ground truth."""
        if self.add_s_mm is None or self.diameter_mm is None:
            return None
        return self.add_s_mm < 0.1 * self.diameter_mm


class RunEnd(Struct, frozen=True, eq=False, kw_only=True):
    """How a run ended: its answers, and where the time went."""

    answers: tuple[Answer, ...]
    """One for each object of the frame, those that were left out last."""
    seconds: Real = 0.0
    """All the time it took, from reading the frame to its last record [s]."""
    stages_ms: dict[str, Real] = field(default_factory=dict)
    """Where the time went, by stage (``run.answers.STAGES``) [ms]."""
    notes: tuple[str, ...] = ()
    """About the frame's data: objects left out, unknown names in a given order, …"""
    doubts: tuple[str, ...] = ()
    """What of the frame's data does not fit together, with what to check: cam_K, depth, models, the plane."""
    n_unreadable: Index = 0
    """Objects that were left out as their model or mask is missing or damaged."""

    @property
    def failed(self) -> bool:
        """Whether the whole frame could not be solved."""
        return any(answer.status == "failed" for answer in self.answers)

    @property
    def is_failure(self) -> bool:
        """Whether an object has no answer, or an ADD(-S) not below 10 % of the diameter."""
        return any(answer.status != "ok" or answer.is_correct is False for answer in self.answers)

    @property
    def can_be_mended(self) -> bool:
        """Whether another try may solve more, once files are as they should be."""
        return self.failed or self.n_unreadable > 0


class RunRecord(Struct, frozen=True, eq=False):
    """A run from its start as far as it went."""

    header: RunHeader
    iterations: tuple[Iteration, ...] = ()
    """1, 2, …, without a gap."""
    end: RunEnd | None = None
    """None while it runs, or where it was stopped."""
    damaged: bool = False
    """Whether bytes in its file were changed, so that what follows them could not be read."""
    missing: str = ""
    """What of its file could not be read, a sentence; "" = nothing."""

    @property
    def is_complete(self) -> bool:
        """Whether the run came to its end, and all of it is here."""
        return self.end is not None and not self.missing


def unsolved(frame: str, one: LeftOut, status: Status, message: str, method: str, seed: int | None = None) -> Answer:
    """The answer about an object that was not solved, and why."""
    return Answer(
        frame=frame,
        instance_id=one.instance_id,
        obj_id=one.obj_id,
        name=one.name,
        method=method,
        seed=seed,
        visib_fract=one.visib_fract,
        has_truth=one.has_truth,
        status=status,
        message=message,
    )


def failed_run(session: Session, frame: str, message: str, objects: Sequence[LeftOut] = ()) -> RunRecord:
    """The record of a frame that could not be solved, with an answer about each object that is known to be in it."""
    message, method, seed = " ".join(message.split()), session.method.name, session.hypotheses.seed
    answers = tuple(unsolved(frame, one, "failed", message, method, seed) for one in objects)
    if not answers:
        answers = (Answer(frame=frame, method=method, seed=seed, status="failed", message=message),)
    header = RunHeader(FORMAT, session_toml(session), frame, session.title, versions(session), ())
    return RunRecord(header, (), RunEnd(answers=answers))


def header_of(problem: Problem, state: RunState | None, session: Session) -> RunHeader:
    """The header of a run of ``session``, given its state before the first iteration; None where nothing is scored."""
    support = problem.observation.support
    initial = [None] * len(problem.targets) if state is None else state.initial
    objects = tuple(
        ObjectHeader(
            target.instance.instance_id,
            target.instance.obj_id,
            target.model.name,
            target.model.diameter_m,
            target.instance.T_cam_obj_gt,
            target.instance.hypotheses,
            () if scores is None else tuple(scores[j] for j in range(len(scores))),
        )
        for target, scores in zip(problem.targets, initial, strict=True)
    )
    return RunHeader(
        FORMAT,
        session_toml(session),
        problem.frame,
        session.title or problem.title,
        versions(session),
        objects,
        problem.observation.T_map_cam,
        None if support is None else support.T_world_cam,
        problem.notes,
    )


def session_of(header: RunHeader) -> Session:
    """The session that makes the same run.

    Raises:
        SettingsError: it is damaged, or this version cannot run it.
    """
    try:
        raw = parsed_toml(header.session)
    except ValueError:
        raise SettingsError("the session of the run is no TOML") from None
    return resolve(raw, "the session of the run")
