"""A run as data: what it was about, what every iteration did, and what it answered.

Everything that draws, compares, explains or tabulates a run reads this; ``run/run_file.py`` writes and reads it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.finding import Finding
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.number_kinds import Id, Index, Real, Seed
from verefine_viz.core.problem import Hypothesis, LeftOut
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import PoseScore

FORMAT = 2
"""Format of the run file; a reader refuses later ones, and reads :mod:`verefine_viz.run.first_format`."""
DATA_FIRST = "Look at the data first:"
"""Stands before each doubt about a frame's data, behind the cause."""
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

    ``make tables`` writes the docstrings of what is a column of frames.csv into docs/tables.md.

    A frame that failed has one for each object that ground truth names; without ground truth, one without an object.
    """

    frame: str
    """``scene/image``."""
    instance_id: Id | None = None
    """Number of the object in the frame, from 0: its place in ``scene_gt.json``; with masks from a detections file, its
    rank by detection score."""
    obj_id: Id | None = None
    """BOP's number of the object's model."""
    name: str = ""
    """Name of the object's model."""
    method: str = ""
    """Method of the session (``method.name``)."""
    seed: Seed | None = None
    """Seed of the initial poses (``hypotheses.seed``)."""
    visib_fract: Real | None = None
    """Visible share of the object, 0 to 1, where the data set says."""
    has_truth: bool = False
    """Whether ground truth is known; every such object counts in the share of right ones, with an answer or without."""
    status: Status
    """``ok``: there is an answer; ``no_answer``: there was no hypothesis; ``left_out``: its mask or its model is
    missing or damaged (mend it: ``--retry-failed`` then solves the frame again), its mask is empty, or it was not
    detected; ``failed``: its frame could not be solved. ``message`` says why."""
    T_cam_obj: Float | None = None
    """(4, 4) the answer [m]."""
    middle_m: Float | None = None
    """(3,) the middle of the object's bounding box, in its own frame [m]."""
    score: Real | None = None
    """Verification score of the answer, 0 to 1."""
    initial_score: Real | None = None
    """Best score among the hypotheses as they were given."""
    colour_fit: Real | None = None
    """Colour term f_c of the answer, -1 to 1: correlation of rendered and observed colour; unknown where colour does
    not count (``score.colour_weight`` is 0, or model or image have no contrast)."""
    plausibility: Real | None = None
    """Plausibility p of the answer, 0 to 1: half of it for touching without sinking in, half for being stable; unknown
    where it does not count (``score.plausibility_weight`` is 0, or no support plane is known)."""
    recorded_score: Real | None = None
    """Score that the program whose steps were recorded gave to the answer, in its own units; unknown where nothing was
    recorded, it gave none, or the answer is another pose."""
    missing_depth: Real | None = None
    """Share of the object's mask without depth, 0 to 1."""
    add_s_mm: Size | None = None
    """Error of the answer [mm]: ADD, the mean distance of model points from where they should be; for objects declared
    symmetric ADD-S, from the nearest such point. Right is below 10 % of the diameter. Points are sampled on the surface
    (docs/tables.md, What errors are measured on)."""
    initial_add_s_mm: Size | None = None
    """ADD(-S) of the hypothesis with the best initial score [mm]."""
    rotation_deg: Size | None = None
    """Rotation error of the answer [°], the smallest over declared symmetries."""
    translation_mm: Size | None = None
    """Translation error of the answer [mm]."""
    diameter_mm: Size | None = None
    """Diameter of the object's model [mm]."""
    ar: Real | None = None
    """Mean of ar_vsd, ar_mssd and ar_mspd: over many objects, 0 for one without an answer, BOP's average recall. Each
    answer is compared with the ground truth of its own object, on its mesh in `models`."""
    ar_vsd: Real | None = None
    """Share of BOP's thresholds of VSD that the answer passes, 0 to 1."""
    ar_mssd: Real | None = None
    """Share of BOP's thresholds of MSSD that the answer passes, 0 to 1."""
    ar_mspd: Real | None = None
    """Share of BOP's thresholds of MSPD that the answer passes, 0 to 1."""
    best_hypothesis: Index | None = None
    """Number of the hypothesis that the answer comes from, from 1."""
    best_iteration: Index | None = None
    """The iteration that made the answer, counted over the frame; 0: a hypothesis as it was given."""
    worst_iteration: Index | None = None
    """The iteration that gave up a correct pose for the wrong answer; else the one that took the accepted pose furthest
    from the ground truth, if one added more than 3 % of the diameter to the error; without ground truth the one that
    lost most score, if more than 0.01. None where none did. The page opens an answer here, else at ``best_iteration``.
    """
    undetermined_mm: Real | None = None
    """How far the image allows the answer to be shifted along an axis of the table or of the model, all other motions
    being free, with a probability of 95 % [mm]; at most 30: the longer side (docs/methods.md 1.15). The noise, and what
    the answer leaves unexplained, are measured in the frame itself."""
    undetermined_deg: Real | None = None
    """How far it allows the answer to be turned so, about an axis through what is seen of the object [°]; 180 about an
    axis of symmetry, declared or not."""
    n_alike: Index = 0
    """Poses elsewhere, such as flips, that fit as well as the answer or better."""
    error_seen_mm: Real | None = None
    """ADD(-S) to the nearest pose that the image allows beside ground truth [mm]: 0 to a few mm for a mug that is wrong
    by its hidden handle alone. Of an answer that is right it is ``add_s_mm``."""
    right_seen: bool | None = None
    """Whether that is below 10 % of the diameter: right as far as the image shows."""
    n_hypotheses: Index = 0
    """Hypotheses it started from."""
    n_iterations: Index = 0
    """Iterations spent on it."""
    grasp: str = ""
    """How a simulated grasp by the answer ends, with ``batch --grasp`` (``grasp.answers``): ``success``, ``slipped``,
    ``no contact``, ``collided with the target``, ``collided with a neighbour``, ``collided with the ground``, or ``no
    collision-free grasp`` (docs/methods.md 8.4). Unknown where it was not tried: no answer, an object of the frame
    without ground truth, no support plane."""
    grasp_ground_truth: str = ""
    """How a simulated grasp by the ground-truth pose ends."""
    events: str = ""
    """What happened in its iterations and how often, by kind: ``arm_switched 4; score_fell 1``."""
    ms_refine: Real = 0.0
    """Time in the refiner [ms]."""
    ms_simulate: Real = 0.0
    """Time in the physics simulation [ms]."""
    ms_score: Real = 0.0
    """Time that iterations waited for scores [ms]."""
    ms_total: Real = 0.0
    """Time of its iterations [ms]."""
    findings: tuple[Finding, ...] = ()
    """Why it is wrong or cannot be, as far as that is known: the main reason first, then what else had a part in it."""
    doubts: tuple[str, ...] = ()
    """What of its frame's data does not fit together, and may be behind that, as far as it was checked."""
    message: str = ""
    """Why there is no answer, or what was missing: no support plane, say; also that an answer is right by ADD-S only,
    while ADD over the declared symmetries is above 10 % of the diameter."""

    @property
    def scene_id(self) -> int:
        """BOP's number of the scene."""
        return parse_frame(self.frame)[0]

    @property
    def im_id(self) -> int:
        """BOP's number of the image."""
        return parse_frame(self.frame)[1]

    @property
    def is_object(self) -> bool:
        """Whether it is about an object; False of a failed frame whose objects are unknown."""
        return self.status != "failed" or self.obj_id is not None

    @property
    def is_failure(self) -> bool:
        """Whether there is no answer, or its ADD(-S) is not below 10 % of the diameter."""
        return self.status != "ok" or self.is_correct is False

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
    def cause(self) -> str:
        """Why the answer is wrong or missing, one of docs/causes.md; needs ground truth, and ``batch`` without
        ``--no-diagnose``; without ground truth only ``impossible``.
        """
        return self.findings[0].cause if self.findings else ""

    @property
    def evidence(self) -> str:
        """The cause in a sentence, with its numbers; where the camera, the models or the depth of the frame look wrong
        it ends with that: "Look at the data first: …". Without ground truth it says that alone, and also where the
        support plane looks wrong; where it says nothing of the data, why an answer is physically impossible.
        """
        sentences = [*(finding.text for finding in self.findings[:1]), *(f"{DATA_FIRST} {d}." for d in self.doubts)]
        return " ".join(" ".join(sentences).split())

    @property
    def relative_error(self) -> float | None:
        """ADD(-S) as a share of the diameter; None where there is no answer or no ground truth."""
        if self.add_s_mm is None or not self.diameter_mm:
            return None
        return self.add_s_mm / self.diameter_mm

    @property
    def is_correct(self) -> bool | None:
        """ADD(-S) below 10 % of the diameter; None without ground truth."""
        limit_mm = self.correct_below_mm
        return None if self.add_s_mm is None or limit_mm is None else self.add_s_mm < limit_mm

    def __repr__(self) -> str:
        if self.score is None:
            return f"<Answer {self.name or 'without an object'} in {self.frame}: {self.message or self.status}>"
        parts = [f"score {self.score:.2f}"]
        if self.add_s_mm is not None:
            verdict = "" if self.is_correct is None else "right, " if self.is_correct else "wrong, "
            parts.append(f"{verdict}ADD(-S) {self.add_s_mm:.1f} mm")
        elif self.undetermined_mm is not None and self.undetermined_deg is not None:
            parts.append(f"undetermined by {self.undetermined_mm:.1f} mm and {self.undetermined_deg:.0f}°")
        parts += [self.cause] if self.cause else []
        return f"<Answer {self.name} in {self.frame}: {', '.join(parts)}>"

    @property
    def correct_below_mm(self) -> float | None:
        """The ADD(-S) from which on an answer is wrong [mm]; None where the diameter is unknown."""
        return None if self.diameter_mm is None else CORRECT * self.diameter_mm


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
        """Whether an answer is missing or wrong."""
        return any(answer.is_failure for answer in self.answers)

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

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.header.objects)
        return f"<RunRecord of {self.header.frame}: {names or 'no object'}, {len(self.iterations)} iterations>"

    @property
    def is_complete(self) -> bool:
        """Whether the run came to its end, and all of it is here."""
        return self.end is not None and not self.missing


def awaited(frame: str) -> RunRecord:
    """The record of a frame that is not solved yet: its name alone."""
    return RunRecord(RunHeader(FORMAT, "", frame, "", {}, ()))


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
