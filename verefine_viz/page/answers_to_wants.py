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
    """A score with its parts, which are null for a score other than Eq. 1."""

    score: float
    depth_fit: float | None
    normal_fit: float | None
    colour_fit: float | None
    plausibility: float | None
    n: int
    """Number of pixels that count."""
    counts: dict[str, int]
    """Pixels by class."""
    err: float | None
    """ADD(-S) [mm]; null also of several objects together."""
    deg: float | None
    mm: float | None


class MapScale(Part, frozen=True):
    """What the colours of maps are relative to."""

    depth: tuple[float, float]
    """Nearest and farthest depth [m], the same for all poses of these objects."""
    tau_mm: float
    colour_weight: float


class StoredArray(Part, frozen=True, array_like=True):
    """Position of an array in a blob; ``[name, dtype, offset, n, step]``."""

    name: str
    dtype: str
    offset: int
    """In bytes."""
    n: int
    """Number of values."""
    step: float | None = None
    """In a file, arrays are stored as whole numbers of this step; the highest of the type means no value."""


class MapsAnswer(Answer, frozen=True):
    """The score of a pose, or of several together, pixel by pixel.

    Arrays over the region: rendered [m], 0 = none; angle [rad]; f_d; f_n; classes, 0 = none; counted; and for a model
    with colours, correlation and rendered_rgb, which a shared file has only where colour counts. NaN = no value.
    """

    region: Box
    """[u0, v0, width, height]."""
    score: ScoreNumbers
    scale: MapScale
    blob: str
    arrays: Sequence[StoredArray]


class OutlinesAnswer(Answer, frozen=True):
    """Polygons of each pose that was asked for."""

    outlines: Sequence[Sequence[Polygon]]
    """A polygon is [u, v, u, v, …] px, closed; pixel centres are whole."""


class DoubtShape(Part, frozen=True):
    """Layers that show a doubt: masks, edges of depth, models as the data place them and as they would fit."""

    role: DoubtRole
    label: str
    obj: int | None
    """null: of the whole frame."""
    polygons: Sequence[Polygon]


class DoubtAnswer(Answer, frozen=True):
    """The evidence of a doubt about the data in the image."""

    shapes: Sequence[DoubtShape]


class ShadedAnswer(Answer, frozen=True):
    """A model as it would look: RGBA, at the image's resolution or twice that."""

    region: Box
    """[u0, v0, width, height]."""
    url: str | None
    """null where it does not show in the image."""


class FilmAnswer(Answer, frozen=True):
    """Pictures of key moments: the photo with contours, and the map beside it."""

    urls: Sequence[str]


# physics


class PosePhysics(Part, frozen=True):
    """Geometry of a pose; null where physics is not asked, and for what only a picture needs."""

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
    """Footprint, seen from above as the three below."""
    polygon: Sequence[Point] | None = None
    """The support polygon."""
    com: Point | None = None
    """Centre of mass."""
    contacts: Sequence[Point] | None = None


class PlaneFit(Part, frozen=True):
    """How well the support plane fits."""

    share: float
    """Share of the background on the plane."""
    rms_mm: float
    tilt_deg: float
    """Between its normal and gravity."""


class UnknownSolid(Part, frozen=True):
    """An object in the depth image that no model explains."""

    number: int
    size_mm: Sequence[float]
    """Sides of its box, longest first."""
    dropped: bool
    """Whether it stops nothing."""


class SupportAround(Part, frozen=True):
    """The surroundings: what supports and stops the objects."""

    source: str
    """plane: nothing else; observed: what the depth image shows; mesh: a mesh of the surroundings."""
    plane: PlaneFit
    surfaces: int
    solids: int
    unknown: Sequence[UnknownSolid]


class OverlappingPair(Part, frozen=True):
    """An overlap of two objects."""

    first: int
    """The object that is solved later."""
    second: int
    depth_mm: float


class TouchedPartner(Part, frozen=True):
    """A body that is touched at the end of a step."""

    name: str
    n: int
    """Contact points."""
    force_n: float
    depth_mm: float
    """Depth of the deepest penetration."""


class TippingMoment(Part, frozen=True):
    """The moment at which the centre of mass leaves the support."""

    step: int
    overhang_mm: float


class SimulatedMotion(Part, frozen=True):
    """The simulation in the latest iteration of the object."""

    k: int
    n: int
    """Number of poses: one more than steps."""
    poses: Sequence[Pose]
    moved_mm: Sequence[float]
    """Distance from the first pose, at each pose."""
    turned_deg: Sequence[float]
    contacts: Sequence[Sequence[TouchedPartner]]
    """Contacts at the end of each step, the strongest first."""
    has_contacts: bool
    """Whether the simulator gives contacts."""
    tipping: TippingMoment | None
    words: str


class PhysicsAnswer(Answer, frozen=True):
    """Whether the objects' poses are stable, and what the simulation did."""

    empty: str
    """Why nothing is simulated; "" where it is."""
    doubts: Sequence[str]
    surroundings: SupportAround | None
    objects: Sequence[PosePhysics]
    """Each object at its current pose."""
    poses: Sequence[PosePhysics]
    """Examined poses of the focus: before and after, with the data for a picture."""
    overlaps: Sequence[OverlappingPair]
    """Deepest first."""
    path: SimulatedMotion | None


# landscape


class ScoreCurve(Part, frozen=True):
    """The score along one axis."""

    axis: int
    frame: str
    """Frame of the axis."""
    kind: Literal["shift", "turn"]
    words: str
    unit: Literal["mm", "°"]
    offsets: Sequence[float]
    scores: Sequence[float]
    low: float
    """Range of offsets that the score cannot distinguish."""
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
    """The least certain axis, in words."""
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
    """A distant pose that fits as well."""

    T: Pose
    score: float
    score_of_answer: float
    noise: float
    """Difference of both scores that the noise of the image explains."""
    apart_mm: float
    words: str


class OtherAnswer(Answer, frozen=True):
    """Answer to `landscape`: distant poses that fit as well."""

    other: OtherPose | None
    near: Sequence[str]
    """Turns after which the shape looks nearly the same, in words."""


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
    """The first difference of B from A."""

    place: int
    """Number of the pair, from 1; 0 = before iteration 1."""
    kind: str
    text: str
    """What B does, as a phrase that follows "B"."""
    a: int | None
    b: int | None


class ComparedAnswer(Part, frozen=True):
    """One run's answer for an object."""

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
    """The run nearer to the ground truth or, without it, of the higher score; null where this is open."""


class RunEffort(Part, frozen=True):
    """Cost of a run so far."""

    iterations: int
    planned: int
    refiner_calls: int
    rollout_calls: int
    """Refiner calls that only complete a scene."""
    ms: float


class BothEfforts(Part, frozen=True):
    """Costs of both runs so far."""

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
    """The first differing action, and the first differing score."""
    words: str
    """Where they diverge, in words."""
    rows: Sequence[ObjectInBoth]
    frame: tuple[float, float] | None
    """Scores of A's answers and of B's, each set as one scene; null for a single object."""
    effort: BothEfforts


# crops, recorded, track


class RefinerStepShown(Part, frozen=True):
    """One step of a refiner."""

    url: str
    """What it saw, as a PNG."""
    words: Sequence[str]


class CropsAnswer(Answer, frozen=True):
    """Inputs and outputs of a learned refiner in an iteration."""

    k: int | None
    """The latest iteration on the object; null = none."""
    empty: str
    """Why there are no steps."""
    steps: Sequence[RefinerStepShown] = ()
    refiner: str = ""
    start: str = ""
    """How far from the ground truth it began, and how far it was trained for, in words."""


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
    """How it moves; "" where the frames are not a sequence."""


class SequenceMark(Part, frozen=True, array_like=True):
    """A mark; ``[lane, frame, kind]``, both by index."""

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
    """All scenes."""
    frames: Sequence[str]
    lanes: Sequence[SequenceLane]
    marks: Sequence[SequenceMark]
    reference: Literal["world", "camera"]
    """Frame of reference of the motions."""
    legend: dict[str, str]
    """Meaning of each kind of mark; empty where the frames are not a sequence."""
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
    """How a simulated grasp went and ended; empty where none was carried out."""

    verdict: str
    good: bool
    source: str
    """Source of the grasps: annotated or sampled."""
    free: int
    """Grasps in which the gripper hits nothing."""
    blocked: int
    words: str
    """Why none was carried out."""
    n: int = 0
    """Moments."""
    stages: Sequence[str] = ()
    """One per moment, as all below."""
    gap_mm: Sequence[float] = ()
    """Between the fingers."""
    force_n: Sequence[Sequence[float]] = ()
    """Force of both fingers on the object."""
    rise_mm: Sequence[float] = ()
    """Rise of the object since the start."""
    touches: Sequence[Sequence[str]] = ()
    """Bodies that the gripper presses on."""
    frames: Sequence[GraspFrame] = ()


class GraspAnswer(Answer, frozen=True):
    """Answer to `evaluate`: a grasp by a pose and by the ground truth."""

    pose: GraspOutcome
    truth: GraspOutcome


class GoneAnswer(Answer, frozen=True):
    """An answer that cannot be given."""

    gone: str
    """Why."""


class RefinedAnswer(Answer, frozen=True):
    """The result of refining a pose, with its verification."""

    T: Pose
    """The proposed pose itself where nothing scores higher."""
    score: ScoreNumbers
    before: ScoreNumbers
    """Score of the proposed pose."""
    tone: Light
    """Whether the pose is stable; grey where no support is known or physics is off."""
    words: str
    """The change in words."""


class PointAnswer(Answer, frozen=True):
    """The point measured at a pixel, in the camera frame; null where nothing was measured. ``obj``: the object with the
    nearest surface.
    """

    point_mm: tuple[float, float, float] | None
    normal: tuple[float, float, float] | None
    residual_mm: float | None
    """Distance to the nearest surface of an object at its pose, negative inside; null beyond three times τ."""
    obj: int | None


AnyAnswer = (
    MapsAnswer | OutlinesAnswer | DoubtAnswer | ShadedAnswer | PhysicsAnswer | PointAnswer | RefinedAnswer
    | CurvesAnswer | SliceAnswer | OtherAnswer | CompareAnswer | CropsAnswer | RecordedAnswer | SequenceAnswer
    | GraspAnswer | FilmAnswer | GoneAnswer
)  # fmt: skip


class AnswerMessage(Message, frozen=True):
    """The answer to a want of a window."""

    id: str
    """Id of the want, or of `evaluate`."""
    answer: AnyAnswer
