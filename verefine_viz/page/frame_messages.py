"""What is open: the frame with its objects and settings, and its branches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.problem import EdgeKind, EdgeState
from verefine_viz.page.wire import Message, Part, Pose

Box = tuple[int, int, int, int]
Polygon = Sequence[float]
"""[u, v, u, v, …] px, closed; pixel centres are whole."""


class Camera(Part, frozen=True):
    """The pinhole camera of the frame."""

    w: int
    """Pixels across."""
    h: int
    K: tuple[float, float, float, float, float, float, float, float, float]
    """The intrinsic matrix by rows."""


class InitialPose(Part, frozen=True):
    """A pose with which a hypothesis begins; errors are null without ground truth."""

    T: Pose
    score: float
    err: float | None
    """ADD(-S) [mm]."""
    deg: float | None
    mm: float | None
    """Error of the translation."""
    plays: float
    mean: float
    """Mean reward with which the hypothesis begins."""
    source: str
    """Its source: an estimator, a results file, disturbed ground truth."""
    confidence: float | None
    """Score by its source, on that source's own scale."""


class FrameObject(Part, frozen=True):
    """An instance of the frame; one that is left out has neither mask nor poses."""

    id: int | None
    """null where one that is left out has none."""
    obj_id: int
    label: str
    color: str
    cluster: int
    """Number of its group in ``order``, from 1; 0 = left out."""
    diameter_mm: float | None
    symmetric: bool
    has_gt: bool
    gt: Pose | None
    gt_score: float | None
    """Score of the ground-truth pose."""
    visible: float | None
    """Visible share, 0 to 1, where the data set gives it."""
    box: Box | None
    """[u0, v0, u1, v1] of the mask, u1 and v1 beyond it."""
    mask: Sequence[Polygon]
    arms: Sequence[InitialPose]
    recorded: int
    """Steps that another program recorded."""
    left_out: str
    """Why it is not solved; "" where it is."""


class SupportPlane(Part, frozen=True):
    """The plane that objects stand on."""

    source: str
    """Where gravity comes from: plane, world or given."""
    inlier_share: float
    rms_mm: float
    tilt_deg: float
    """Between its normal and gravity."""
    unknown: Sequence[int]
    """Numbers of the unknown objects around."""
    outline: Polygon
    """Outline of the part that was seen, in the image."""
    inliers: str
    """Blob of uint8 h×w, 1 = a pixel of the background that lies on it."""


class OrderEdge(Part, frozen=True):
    """Two instances that depend on each other."""

    kind: EdgeKind
    """contact: they may touch. occlusion: `first` hides part of `second`. support: `first` supports `second`."""
    first: int
    second: int
    strength: float
    evidence: str
    """In words, with numbers."""
    state: EdgeState
    """ambiguous: left out of the order, as part of a cycle. cut: left out by the user or the setting."""


class SolvingOrder(Part, frozen=True):
    """The order in which objects are solved, and why."""

    clusters: Sequence[Sequence[int]]
    """Groups of instances that are solved together, each group in its order."""
    source: str
    """The rule: recommended, published or given."""
    notes: Sequence[str]
    edges: Sequence[OrderEdge]


class MethodChoice(Part, frozen=True):
    """A method that can be chosen."""

    name: str
    label: str
    verifies: bool
    """Whether it accepts the best pose, rather than the last."""


class EditableSetting(Part, frozen=True):
    """A setting that a run can be restarted with."""

    name: str
    """Dotted, as in a session file."""
    kind: Literal["bool", "choice", "int", "float", "text"]
    value: bool | int | float | str
    standard: bool | int | float | str
    """Value in the preset."""
    choices: Sequence[bool | int | float | str] | None
    common: bool
    """Whether it is one of the settings that are changed most."""
    can_fork: bool
    """Whether it may change during a run."""
    help: str


class Choices(Part, frozen=True):
    """The settings and their choices."""

    methods: Sequence[MethodChoice]
    refiners: Sequence[str]
    presets: Sequence[str]
    estimators: Sequence[str]
    settings: Sequence[EditableSetting]
    """Those changed most first."""


class TitledSession(Part, frozen=True):
    """A session file that lies at hand."""

    path: str
    title: str
    demo: str
    """The built-in scene that it is about; "" where it is another."""


class DoubtShown(Part, frozen=True):
    """A doubt: frame data that do not fit together."""

    kind: str
    title: str
    """For a badge."""
    text: str
    """What was seen and what to check."""
    objs: Sequence[int]
    """The objects that show it; empty: the whole frame."""
    picture: str
    """How it shows in the image: poses, edges, depth; scene: only in 3D."""
    put_right: Mapping[str, Any] | None
    """Settings by dotted name with which a restart corrects the data; null where there are none."""


class FrameMessage(Message, frozen=True):
    """The open frame; sent again when another frame or session is opened, which replaces all that the page knew."""

    id: int
    """New each time something is opened."""
    title: str
    frame: str
    """As `scene/image`, such as 50/1."""
    frames: Sequence[str]
    """All of the session."""
    source: str
    dataset: str
    """A folder, or the name of the built-in scene."""
    run: str
    """The batch run that is open; "" = none."""
    preset: str
    method: str
    method_label: str
    refiner: str
    tau_m: float
    """The threshold of the depth fit."""
    colour_weight: float
    camera: Camera
    rgb: str | None
    """Blob of the photo."""
    depth: str
    """Blob of float32 h×w [m], 0 = not measured."""
    smoothed: str | None
    """Blob of uint8 h×w×3, the photo as the colour term sees it; null where no model has colours."""
    objects: Sequence[FrameObject]
    """In solving order, those left out last."""
    support: SupportPlane | None
    order: SolvingOrder | None
    notes: Sequence[str]
    doubts: Sequence[DoubtShown]
    """Empty where they are not known yet; `doubts` brings them."""
    as_read: Mapping[str, Any]
    """Settings by dotted name that switch off all corrections of the data; empty where there are none."""
    session_file: str | None
    recording: str | None
    demos: Sequence[str]
    """Built-in scenes that can be opened."""
    sessions: Sequence[TitledSession]
    breakpoints: BreakpointSettings
    choices: Choices


class SettingsChange(Part, frozen=True):
    """Settings that changed on the way."""

    k: int
    """The settings hold after this iteration."""
    settings: dict[str, Any]
    """Values by dotted name."""


class MovedPose(Part, frozen=True):
    """A pose that was edited, and how far it is from the hypothesis's initial pose."""

    k: int
    obj: int
    arm: int
    T: Pose
    mm: float | None
    deg: float | None


class BranchListed(Part, frozen=True):
    """One run of the frame."""

    index: int
    name: str
    parent: int | None
    from_: int
    """The parent's iteration after which it forks."""
    scored: Sequence[int]
    """Iterations after which settings of the score changed, beginning with 0."""
    recording: str | None
    missing: str
    """What its recording lacks, in words; "" where it is complete."""
    done: int
    """Iterations made so far."""
    total: int
    """Iterations at its end."""
    over: bool
    method: str
    explains: bool
    """Whether its refiner can show what it saw."""
    settings: dict[str, Any]
    """Those that differ from the first branch's, by dotted name."""
    changes: Sequence[SettingsChange]
    edits: Sequence[MovedPose]
    elsewhere: Sequence[str]
    """Edits of other frames, in words."""


class ComparedBranches(Part, frozen=True):
    """Two branches side by side."""

    a: int
    b: int


class BranchesMessage(Message, frozen=True):
    """The branches, the oldest first."""

    list: Sequence[BranchListed]
    compare: ComparedBranches | None


class BreakpointsMessage(Message, frozen=True):
    """When a run stops and waits."""

    breakpoints: BreakpointSettings
