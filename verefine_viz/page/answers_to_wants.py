"""What wants and ``evaluate`` are answered with. Errors are null without ground truth; a pose is T_cam_obj by rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from verefine_viz.core.records import MarkKind
from verefine_viz.page.frame_messages import Box, Polygon
from verefine_viz.page.wire import Answer, Message, Part, Pose

Light = Literal["green", "amber", "red", "grey"]
Point = tuple[float, float]
"""[x, y] mm, seen from above or from the side."""
DoubtRole = Literal["mask", "edges", "given", "fits"]


# maps, outlines, shaded


class ScoreNumbers(Part, frozen=True):
    """A score with its parts; they are null where it is not of Eq. 1."""

    score: float
    depth_fit: float | None
    normal_fit: float | None
    colour_fit: float | None
    plausibility: float | None
    n: int
    """Pixels that count."""
    counts: dict[str, int]
    """Pixels by class."""
    err: float | None
    """ADD(-S) [mm]; null also of several objects together."""
    deg: float | None
    mm: float | None


class MapScale(Part, frozen=True):
    """What the colours of maps are relative to."""

    depth: tuple[float, float]
    """Nearest and farthest [m], one for all poses of these objects."""
    tau_mm: float
    colour_weight: float


class StoredArray(Part, frozen=True, array_like=True):
    """Where an array lies in a blob; ``[name, dtype, offset, n, step]``."""

    name: str
    dtype: str
    offset: int
    """In bytes."""
    n: int
    """Number of values."""
    step: float | None = None
    """In a file whole numbers of this step are stored, the highest of the type is no value."""


class MapsAnswer(Answer, frozen=True):
    """The score of a pose, or of several together, pixel by pixel.

    Arrays over the region: rendered [m], 0 = none; angle [rad]; f_d; f_n; classes, 0 = none; counted; and of a model
    with colours correlation and rendered_rgb, which a shared file has only where colour counts. NaN = no value.
    """

    region: Box
    """[u0, v0, width, height]."""
    score: ScoreNumbers
    scale: MapScale
    blob: str
    arrays: Sequence[StoredArray]


class OutlinesAnswer(Answer, frozen=True):
    """For each pose that was asked for its polygons."""

    outlines: Sequence[Sequence[Polygon]]
    """A polygon is [u, v, u, v, …] px, closed; pixel centres are whole."""


class DoubtShape(Part, frozen=True):
    """What is drawn of a doubt: masks, edges of depth, models as the data have them and as they would fit."""

    role: DoubtRole
    label: str
    obj: int | None
    """null: of the whole frame."""
    polygons: Sequence[Polygon]


class DoubtAnswer(Answer, frozen=True):
    """What shows a doubt about the data in the image."""

    shapes: Sequence[DoubtShape]


class ShadedAnswer(Answer, frozen=True):
    """A model as it would look: RGBA, once or twice as fine as the image."""

    region: Box
    """[u0, v0, width, height]."""
    url: str | None
    """null where it does not show in the image."""


class FilmAnswer(Answer, frozen=True):
    """Pictures of key moments: the photo with contours, and the map beside it."""

    urls: Sequence[str]


# physics


class PosePhysics(Part, frozen=True):
    """What geometry says of a pose; null where physics is not asked, and of what only a picture needs."""

    obj: int
    name: str
    """The stage of the pose; "" = where the object stands."""
    tone: Light
    words: str
    gap_mm: float | None = None
    """To the nearest surface."""
    depth_mm: float | None = None
    """Depth of the deepest penetration."""
    into: str | None = None
    """What it penetrates."""
    margin_mm: float | None = None
    """Centre of mass to the edge of the support polygon; negative: outside; null without support."""
    stable: bool | None = None
    """Whether friction at the contacts can hold it; null where that is unknown."""
    touches: Sequence[str] | None = None
    outline: Sequence[Point] | None = None
    """From above, as the three below."""
    polygon: Sequence[Point] | None = None
    """The support polygon."""
    com: Point | None = None
    """Centre of mass."""
    contacts: Sequence[Point] | None = None


class PlaneFit(Part, frozen=True):
    """How well the support plane fits."""

    share: float
    """Share of the background that lies on it."""
    rms_mm: float
    tilt_deg: float
    """Between its normal and gravity."""


class UnknownSolid(Part, frozen=True):
    """An object that the depth image shows and no model explains."""

    number: int
    size_mm: Sequence[float]
    """Sides of its box, longest first."""
    dropped: bool
    """Whether it stops nothing."""


class SupportAround(Part, frozen=True):
    """What supports and stops the objects."""

    source: str
    """plane: nothing else; observed: what the depth image shows; mesh: a mesh of the surroundings."""
    plane: PlaneFit
    surfaces: int
    solids: int
    unknown: Sequence[UnknownSolid]


class OverlappingPair(Part, frozen=True):
    """Two objects that are partly in the same place."""

    first: int
    """The one that is solved later."""
    second: int
    depth_mm: float


class TouchedPartner(Part, frozen=True):
    """What is touched at the end of a step."""

    name: str
    n: int
    """Contact points."""
    force_n: float
    depth_mm: float
    """Depth of the deepest penetration."""


class TippingMoment(Part, frozen=True):
    """Where the centre of mass leaves the support."""

    step: int
    overhang_mm: float


class SimulatedMotion(Part, frozen=True):
    """What the simulation did in the latest iteration of the object."""

    k: int
    n: int
    """Number of poses: one more than steps."""
    poses: Sequence[Pose]
    moved_mm: Sequence[float]
    """From the first pose, at each."""
    turned_deg: Sequence[float]
    contacts: Sequence[Sequence[TouchedPartner]]
    """At the end of each step, the hardest pressed first."""
    has_contacts: bool
    """Whether the simulator gives contacts."""
    tipping: TippingMoment | None
    words: str


class PhysicsAnswer(Answer, frozen=True):
    """Whether the objects can stand where they are, and what the simulation did."""

    empty: str
    """Why nothing is simulated; "" where it is."""
    doubts: Sequence[str]
    surroundings: SupportAround | None
    objects: Sequence[PosePhysics]
    """Where each stands."""
    poses: Sequence[PosePhysics]
    """Poses of the object asked for: before and after, with what a picture needs."""
    overlaps: Sequence[OverlappingPair]
    """Deepest first."""
    path: SimulatedMotion | None


# landscape


class ScoreCurve(Part, frozen=True):
    """The score along one axis."""

    axis: int
    frame: str
    """Whose axis it is."""
    kind: Literal["shift", "turn"]
    words: str
    unit: Literal["mm", "°"]
    offsets: Sequence[float]
    scores: Sequence[float]
    low: float
    """Offsets between which the score cannot tell."""
    high: float
    width: str
    """In words: ±0.3 mm."""
    poses: Sequence[Pose]
    """At each offset."""


class CurvesAnswer(Answer, frozen=True):
    """Answer to `landscape`: the score around a pose along twelve axes."""

    T: Pose
    score: float
    curves: Sequence[ScoreCurve]
    undetermined: str
    """The least certain of them, in words."""
    undetermined_mm: float
    undetermined_deg: float


class SliceAxis(Part, frozen=True):
    """One of the two axes of a map of scores."""

    words: str
    unit: Literal["mm", "°"]
    offsets: Sequence[float]


class SliceAnswer(Answer, frozen=True):
    """Answer to `landscape`: the score over two axes."""

    across: SliceAxis
    up: SliceAxis
    scores: Sequence[Sequence[float]]
    """By rows, from below."""
    poses: Sequence[Sequence[Pose]]


class OtherPose(Part, frozen=True):
    """A pose elsewhere that fits as well."""

    T: Pose
    score: float
    score_of_answer: float
    noise: float
    """Difference of both that the noise of the image explains."""
    apart_mm: float
    words: str


class OtherAnswer(Answer, frozen=True):
    """Answer to `landscape`: what fits as well elsewhere."""

    other: OtherPose | None
    near: Sequence[str]
    """Turns after which the shape nearly looks the same, in words."""


# compare


class RunPair(Part, frozen=True, array_like=True):
    """The n-th iteration on one object in both runs; ``[obj, n, a, b]``."""

    obj: int
    n: int
    a: int | None
    """null where A has none."""
    b: int | None


class DifferingSetting(Part, frozen=True, array_like=True):
    """A setting in which both differ; ``[name, a, b]``, values in words."""

    name: str
    a: str
    b: str


class RunDeparture(Part, frozen=True):
    """Where B begins to do otherwise than A."""

    place: int
    """Number of the pair, from 1; 0 = before iteration 1."""
    kind: str
    text: str
    """What B does, to go on behind "B"."""
    a: int | None
    b: int | None


class ComparedAnswer(Part, frozen=True):
    """The answer of one of both runs for an object."""

    score: float
    """By the run's own settings."""
    score_by_a: float
    """By those of A."""
    err: float | None
    """ADD(-S) [mm]."""
    deg: float | None
    mm: float | None
    k: int
    arm: int


class ObjectInBoth(Part, frozen=True):
    """An object in both runs; null where a run does not solve it."""

    obj: int
    name: str
    a: ComparedAnswer | None
    b: ComparedAnswer | None
    winner: Literal["A", "B", "even"] | None
    """Nearer to ground truth, or where none is known of the higher score; null where that cannot be said."""


class RunEffort(Part, frozen=True):
    """What a run has cost so far."""

    iterations: int
    planned: int
    refiner_calls: int
    rollout_calls: int
    """Refiner calls that only complete a scene."""
    ms: float


class BothEfforts(Part, frozen=True):
    """What both runs have cost so far."""

    a: RunEffort
    b: RunEffort


class CompareAnswer(Answer, frozen=True):
    """Two branches side by side, as far as both are computed."""

    names: tuple[str, str]
    settings: Sequence[DifferingSetting]
    scores_alike: bool
    """Whether both score by the same rule."""
    pairs: Sequence[RunPair]
    departures: Sequence[RunDeparture]
    """The first other deed, the first other score."""
    words: str
    """Where they part."""
    rows: Sequence[ObjectInBoth]
    frame: tuple[float, float] | None
    """How well all answers of A, and of B, explain the frame together; null for one object."""
    effort: BothEfforts


# crops, recorded, track


class RefinerStepShown(Part, frozen=True):
    """One step of a refiner."""

    url: str
    """What it saw, as a PNG."""
    words: Sequence[str]


class CropsAnswer(Answer, frozen=True):
    """What a learned refiner saw and answered in an iteration."""

    k: int | None
    """The latest that worked on the object; null = none did."""
    empty: str
    """Why there are no steps."""
    steps: Sequence[RefinerStepShown] = ()
    refiner: str = ""
    start: str = ""
    """How far from the ground truth it began, and up to where it was trained, in words."""


class RecordedPose(Part, frozen=True):
    """A pose of another program, with its score and ours."""

    k: int
    """0 = an initial pose."""
    arm: int
    name: str
    theirs: float | None
    ours: float | None
    ms: float | None
    note: str


class RecordedAnswer(Answer, frozen=True):
    """What another program recorded, as far as the run has repeated it."""

    rows: Sequence[RecordedPose]
    rank: float | None
    """Rank correlation of both scores; null of fewer than four."""


class SequenceLane(Part, frozen=True):
    """An object over the frames."""

    name: str
    object: int
    """Its model."""
    words: str
    """How it moves; "" where the frames are no sequence."""


class SequenceMark(Part, frozen=True, array_like=True):
    """What stands out; ``[lane, frame, kind]``, both by their places."""

    lane: int
    frame: int
    kind: MarkKind


class SequenceAnswer(Answer, frozen=True):
    """The objects of a scene over its frames; no lanes where fewer than two frames have answers.

    Arrays over lanes and frames: state, 0 nothing, 1 pose, 2 no pose, 3 not solved; key in the gallery, -1 = in none;
    and those of the following that are known: err, ADD(-S) [mm]; share, that of the diameter; score; recorded_score,
    another program's; colour_fit; moved_mm and turned_deg since the last frame with a pose; undetermined_mm;
    missing_depth, share of the object's pixels. NaN = no value.
    """

    run: str
    """Name of the batch; "" = none."""
    scene: int
    scenes: Sequence[int]
    """All that there are."""
    frames: Sequence[str]
    lanes: Sequence[SequenceLane]
    marks: Sequence[SequenceMark]
    reference: Literal["world", "camera"]
    """What motions are relative to."""
    legend: dict[str, str]
    """What each kind of mark means; empty where the frames are no sequence."""
    jump_mm: float
    """Larger changes are jumps."""
    jump_deg: float
    blob: str
    arrays: Sequence[StoredArray]


# evaluate


class GraspFrame(Part, frozen=True):
    """One moment of a grasp, from the side."""

    gripper: Sequence[Sequence[Point]]
    """Palm and both fingers."""
    objects: Sequence[tuple[int, Sequence[Point]]]
    """[obj, outline]."""


class GraspOutcome(Part, frozen=True):
    """How a simulated grasp ends, and what it did; empty where none was carried out."""

    verdict: str
    good: bool
    source: str
    """Where grasps come from: annotated or sampled."""
    free: int
    """Grasps in which the gripper meets nothing."""
    blocked: int
    words: str
    """Why none was carried out."""
    n: int = 0
    """Moments."""
    stages: Sequence[str] = ()
    """By moment, as all below."""
    gap_mm: Sequence[float] = ()
    """Between the fingers."""
    force_n: Sequence[Sequence[float]] = ()
    """Force of both fingers on the object."""
    rise_mm: Sequence[float] = ()
    """Rise of the object since the start."""
    touches: Sequence[Sequence[str]] = ()
    """What the gripper presses on."""
    frames: Sequence[GraspFrame] = ()


class GraspAnswer(Answer, frozen=True):
    """Answer to `evaluate`: a grasp by a pose and by the ground truth."""

    pose: GraspOutcome
    truth: GraspOutcome


class GoneAnswer(Answer, frozen=True):
    """What was asked for cannot be given."""

    gone: str
    """Why."""


class RefinedAnswer(Answer, frozen=True):
    """Where refining a pose ends, and what verifies it."""

    T: Pose
    """The proposed pose itself where nothing scores higher."""
    score: ScoreNumbers
    before: ScoreNumbers
    """Score of the proposed pose."""
    tone: Light
    """Whether it can stand there; grey where no support is known or physics is off."""
    words: str
    """The change in words."""


class PointAnswer(Answer, frozen=True):
    """What was measured at a pixel, in the camera frame; null where nothing was. ``obj``: whose surface is nearest."""

    point_mm: tuple[float, float, float] | None
    normal: tuple[float, float, float] | None
    residual_mm: float | None
    """Distance to the nearest surface of an object where it stands, negative inside; null beyond three times τ."""
    obj: int | None


AnyAnswer = (
    MapsAnswer | OutlinesAnswer | DoubtAnswer | ShadedAnswer | PhysicsAnswer | PointAnswer | RefinedAnswer
    | CurvesAnswer | SliceAnswer | OtherAnswer | CompareAnswer | CropsAnswer | RecordedAnswer | SequenceAnswer
    | GraspAnswer | FilmAnswer | GoneAnswer
)  # fmt: skip


class AnswerMessage(Message, frozen=True):
    """What a window asked for."""

    id: str
    """Id of the want, or of `evaluate`."""
    answer: AnyAnswer
