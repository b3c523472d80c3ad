"""What a run did, iteration by iteration, and its outcome. Errors are null without ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from verefine_viz.core.palette import RGB
from verefine_viz.core.records import EventKind, StageName
from verefine_viz.core.remedies import SettingValue
from verefine_viz.page.frame_messages import DoubtShown, InitialPose
from verefine_viz.page.protocol import MomentDrawn
from verefine_viz.page.wire import Message, Part, Pose

MarkTone = Literal["problem", "rejected", "flip", "switched", "best", "edited"]
AnswerTone = Literal["right", "wrong", "unknown", "doubt", "none"]


class ScoredStage(Part, frozen=True):
    """A pose at one stage of an iteration; parts of the score are null where it was not scored."""

    name: StageName
    score: float | None
    depth_fit: float | None
    normal_fit: float | None
    colour_fit: float | None
    plausibility: float | None
    err: float | None
    """ADD(-S) [mm]."""
    deg: float | None
    mm: float | None
    """Error of the translation."""
    ms: float
    T: Pose
    text: str
    """What it did, in words."""


class BestPose(Part, frozen=True):
    """The best pose of an object so far."""

    score: float
    err: float | None
    deg: float | None
    mm: float | None
    arm: int
    k: int
    """The iteration that made it; 0 = an initial pose."""
    stage: StageName
    T: Pose


class ArmChoice(Part, frozen=True):
    """The bandit's numbers at its choice, one per arm; null where an arm was not played."""

    plays: Sequence[float]
    mean: Sequence[float | None]
    bonus: Sequence[float | None]
    """Bonus for arms that were seldom played."""
    ucb: Sequence[float | None]
    """mean + bonus."""
    reason: str


class ArmState(Part, frozen=True):
    """A hypothesis after an iteration."""

    plays: float
    mean: float
    score: float
    err: float | None
    T: Pose


class PlacedObject(Part, frozen=True):
    """Another object at its place in the scene."""

    obj: int
    T: Pose


class ScenePass(Part, frozen=True):
    """The outcome of a pass over the objects of a cluster."""

    number: int
    score: float
    """Score of this pass's poses as a scene."""
    best_known: float
    """Score of the objects' best poses so far, as a scene."""
    reward: float
    """Reward of the chosen arms."""
    incumbent: float
    """The highest score of all passes so far."""


class SearchNode(Part, frozen=True):
    """A node of the search tree."""

    node: int
    parent: int
    obj: int
    arm: int
    lcp: float
    """Share of the model's points that the segment explains at the initial pose."""


class SearchStep(Part, frozen=True):
    """A step of the search tree."""

    cluster: int
    branch: Sequence[int]
    """Nodes from the root to the one visited."""
    node: SearchNode | None
    """The node that was added."""
    choices: Sequence[str]
    """Why each node after the root was chosen, in words."""
    rollout: Sequence[PlacedObject]
    """The other objects of the completed scene."""
    cost: float
    """Pixels of the complete scene that are not explained."""
    incumbent: float
    """The lowest cost so far."""


class IterationRow(Part, frozen=True):
    """One iteration."""

    k: int
    obj: int
    arm: int
    n: int
    """Its number among this arm's iterations."""
    own: int
    """Its number among this object's iterations."""
    pass_: int | None
    cluster: int
    stages: Sequence[ScoredStage]
    accepted: StageName
    best: BestPose
    """Best pose of this object, after the iteration."""
    events: Sequence[tuple[EventKind, str]]
    """[kind, text]."""
    choice: ArmChoice | None
    """null where the method does not choose."""
    arms: Sequence[ArmState]
    """Hypotheses of this object, after the iteration."""
    path: int | None
    """Number of simulated poses."""
    placed: Sequence[PlacedObject]
    """Other objects, at their places in the scene."""
    scene: ScenePass | None
    tree: SearchStep | None
    ms: float
    brief: str
    text: str
    """What it did, in a sentence or two."""


class Mark(Part, frozen=True):
    """A mark on the timeline: an iteration that is worth a look."""

    k: int
    obj: int
    kind: str
    text: str
    tone: MarkTone


class RunMessage(Message, frozen=True):
    """Iterations of a branch, appended to those of the window; `from` 0 replaces all."""

    branch: int
    from_: int
    """The first row is iteration `from` + 1."""
    total: int
    over: bool
    missing: str
    """What the recording lacks, in words; "" where it is complete."""
    rows: Sequence[IterationRow]
    start: Mapping[int, Sequence[InitialPose]] | None
    """Initial poses by object, where they or their scores differ from the oldest branch's."""
    marks: Sequence[Mark]
    """All marks of the branch so far."""
    notes: Sequence[str]


class FindingShown(Part, frozen=True):
    """One thing that had a part in an answer that is wrong, missing or in doubt."""

    cause: str
    title: str
    text: str
    k: int | None
    """The iteration to look at; 0 = before the first."""
    advice: str
    try_: Mapping[str, SettingValue] | None
    """Settings that may help, by dotted name."""
    by_batch: bool
    """Whether it comes from the batch, which re-ran to find it."""
    numbers: Mapping[str, float]
    """The evidence, in the numbers of its cause (docs/causes.md); errors are ADD(-S) as a share of the diameter."""
    tab: str = ""
    """The tab whose picture of the answer shows it."""
    tab_there: str = ""
    """The tab that shows it at its iteration."""


class MomentShown(Part, frozen=True):
    """A key moment of what the run did to an object."""

    k: int
    """0 = before the first; the answer stands at the last."""
    stage: StageName | None
    """The last stage that is shown; null = the whole iteration."""
    title: str
    caption: str
    legend: Sequence[tuple[str, RGB]]
    """The poses that are drawn over the photo: names and colours."""
    drawn: MomentDrawn
    """As in the want ``film``."""


class RunnerUpPose(Part, frozen=True):
    """The best pose of another hypothesis."""

    arm: int
    lead: float
    """By how much its score is lower."""
    apart_mm: float
    T: Pose


class AllowedByImage(Part, frozen=True):
    """Samples of the poses that the image cannot distinguish from an answer."""

    poses: Sequence[Pose]
    """At most 12: spread along the least certain motion, then isolated poses that look alike."""
    words: str
    """The least certain motion, in words."""
    unasked: bool
    """Whether they are drawn from the start: the observation is ambiguous, or a turn is far from determined."""


class RefinerRange(Part, frozen=True):
    """How far from the ground truth a learned refiner was trained to start, and how far the initial poses are."""

    deg: float
    mm: float
    """For an object of this size."""
    starts: Sequence[tuple[float, float]]
    """Turn [°] and shift of the object's middle [mm] of each initial pose."""


class JudgedObject(Part, frozen=True):
    """The outcome of one object; without an answer, the fields about the answer are null."""

    obj: int
    label: str
    tone: AnswerTone
    words: str
    limit: float
    """Up to this error an answer is right [mm]: 10 % of the diameter."""
    findings: Sequence[FindingShown]
    score: float | None = None
    gt_score: float | None = None
    err: float | None = None
    """ADD(-S) [mm]."""
    deg: float | None = None
    mm: float | None = None
    """Error of the translation."""
    way: str | None = None
    """What the error of the rotation is, in words: tilt or turn on the table."""
    k: int | None = None
    arm: int | None = None
    stage: StageName | None = None
    T: Pose | None = None
    runner_up: RunnerUpPose | None = None
    also_fits: Pose | None = None
    """A distant pose that explains the image equally well."""
    allowed: AllowedByImage | None = None
    """null before the score around the answer is known, and where the image allows no visibly different pose."""
    film: Sequence[MomentShown] = ()
    """How the answer came about, in four to six moments."""
    trained: RefinerRange | None = None
    """null where this or the ground truth is unknown."""


class JudgedScene(Part, frozen=True):
    """The outcome of all objects together."""

    tone: AnswerTone
    words: str
    worst: int | None
    """The object to look at first."""
    right: int
    known: int
    """Objects with ground truth."""


class VerdictMessage(Message, frozen=True):
    """The outcome of a finished run, and why; sent again when physics or the score around the answers is known."""

    branch: int
    over: bool
    missing: str
    """What a recording lacks, in words."""
    objects: Sequence[JudgedObject]
    scene: JudgedScene
    doubts: Sequence[DoubtShown]
    notes: Sequence[str]
    """Reasons to doubt the physics."""
