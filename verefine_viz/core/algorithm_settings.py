"""Settings of refiners, estimators, tree search, dependency graph and breakpoints."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from verefine_viz.core.number_kinds import Index, Seed
from verefine_viz.core.setting_types import (
    Count,
    InputPath,
    LargeCount,
    Length,
    LengthOrNone,
    Order,
    Settings,
    Share,
    Weight,
)


class IcpSettings(Settings, frozen=True):
    """Point-to-point (or point-to-plane) ICP. docs/methods.md 4.1."""

    metric: Literal["point", "plane"] = "point"
    """Distance that a step minimises."""
    stop: Literal["published", "max_iterations", "tolerance"] = "max_iterations"
    """published: stops after 2 inner iterations, as the authors' PCL settings do. max_iterations: always runs them all.
    tolerance: until the step is below 1e-6."""
    max_iterations: Count = 10
    """Inner iterations per refiner call."""
    gate: Literal["shrinking", "published"] = "shrinking"
    """Largest distance of a correspondence. published: 0.1 × the observed cloud's largest extent, which leaves far
    starts untouched. shrinking: starts at 0.5 of it and tightens to the published gate."""
    matches: Literal["same_side", "all"] = "same_side"
    """Which correspondences within the gate count. all: every one (published). same_side: those whose observed and
    model normals lie within 90° of each other, so that the seen front is not pulled to the model's back."""


class TricpSettings(Settings, frozen=True):
    """Trimmed ICP. docs/methods.md 4.2."""

    trim: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Share of the observed points, the best matching ones, that the fit uses; 0.9-0.5 bears leaking masks better."""
    energy_ratio: Share = 0.99
    """A pass that leaves more than this share of the energy before is the last."""
    max_passes: Count = 50
    """Most passes of a call, which bounds its time; PCL has no bound."""
    explained_m: LengthOrNone = 0.008
    """Observed points closer than this to an object already placed are left out [m]; 0 keeps all."""


class DepthNetSettings(Settings, frozen=True):
    """The learned depth refiner. docs/methods.md 4.4."""

    weights: InputPath = ""
    """ONNX file of `verefine-viz train depth_net`, relative to the session file; "" = the weights of the package."""
    iterations: Annotated[int, Meta(ge=1, le=100)] = 4
    """Steps of the network per refiner call."""


class DenseFusionSettings(Settings, frozen=True):
    """DenseFusion, estimator and refiner. docs/methods.md 4.3 and 5."""

    weights: InputPath = ""
    """PoseNet: official .pth file (which needs the extra `torch` once), or ONNX file of `verefine-viz train
    densefusion`, relative to the session file; empty = the package's, trained on the objects of the built-in scenes."""
    refiner_weights: InputPath = ""
    """PoseRefineNet: a file of the same kinds, from the same training as `weights`."""
    classes: tuple[Index, ...] = ()
    """Ids of the objects in the order of the network's classes; none = as in the weights: official ones have the
    21 objects of YCB-Video or the 13 of LINEMOD, whose order and frames are known."""
    points: Annotated[int, Meta(ge=0, le=10_000)] = 0
    """Points of the mask that the networks see; 0 = as in training, official: 1000 on YCB-Video, 500 on LINEMOD."""
    iterations: Annotated[int, Meta(ge=1, le=100)] = 1
    """Steps of PoseRefineNet per refiner call. Paper Sec. V: 2 in all, shared out over 2 iterations
    (`method.iterations = 2`)."""
    seed: Seed = 0
    """Seeds the points, and the choice of their poses for the pool."""


class PpfSettings(Settings, frozen=True):
    """Point pair features. docs/methods.md 6; defaults as measured on real frames (bench/estimators.py)."""

    step: Annotated[float, Meta(ge=0.02, lt=0.5)] = 0.05
    """Grid of model and scene points as a share of the diameter."""
    distance_bin: Annotated[float, Meta(ge=0.02, lt=0.5)] = 0.05
    """Bin of distances as a share of the diameter."""
    angle_bin_deg: Annotated[float, Meta(ge=4, le=45)] = 12.0
    """Bin of the three angles [deg]."""
    bin_limit: LargeCount = 1000
    """Most model pairs used of a bin; each then stands for several. Flat faces fill few bins with very many pairs."""
    reference_every: Count = 5
    """Every n-th scene point is a reference."""
    candidates: Count = 60
    """Clusters with most votes that are ranked by their agreement with the depth image."""
    tolerance: Annotated[float, Meta(gt=0, lt=0.5)] = 0.03
    """Depths that differ by less than this share of the diameter agree."""
    seed: Seed = 0
    """Seeds the points drawn on the model."""


class PcsSettings(Settings, frozen=True):
    """Congruent point sets (Super4PCS). docs/methods.md 3.2."""

    delta_m: Annotated[float, Meta(ge=5e-4, le=1)] = 0.0035
    """δ, distance within which two points correspond [m]; pairs, quads and fits may differ by 2δ. Larger for a
    noisier sensor."""
    grid_m: Annotated[float, Meta(ge=5e-4, le=1)] = 0.005
    """Side of the grid that thins segment and model [m]; finer for small objects."""
    part_share: Annotated[float, Meta(ge=0, lt=1)] = 0.1
    """Isolated parts of the segment with less than this share of its points are left out, as they come from leaking
    masks. 0 keeps all (published code)."""
    samples: Annotated[int, Meta(ge=1, le=2000)] = 300
    """Points of the model, spread evenly; those that lie on the segment are counted. More of them tell similar poses
    better apart, and take longer."""
    spacing_m: LengthOrNone = 0.014
    """Points that are at least so far apart make up the quads [m]; the number of quads grows with the fourth
    power of the number of points. 0 takes all (published code)."""
    bases: LargeCount = 100
    """Bases tried; the published code tries bases for 1 s, so that its results depend on the machine."""
    keep_share: Annotated[float, Meta(gt=0, le=1)] = 0.7
    """Poses whose LCP is below this share of the best one are left out. Published code: 0.2, with which the middle of a
    cluster is often no good pose."""
    seed: Seed = 0
    """Seeds bases, quads and clusters."""


class MctsSettings(Settings, frozen=True):
    """PHYSIM-MCTS, the system that the paper compares with. docs/methods.md 3."""

    expansions: LargeCount = 50
    """Budget in expansions per object."""
    seconds: Annotated[float, Meta(gt=0, le=86_400)] | None = None
    """Budget in computing time per cluster instead [s]; results then depend on the machine."""
    exploration_px: Weight = 5000.0
    """α, weight of the exploration term [px]. The cost counts pixels: choose it larger for images of more pixels."""
    explained_m: Length = 0.010
    """A pixel whose observed and rendered depth differ by more than this adds 1 to the cost [m]."""
    trim: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Share of the points that its trimmed ICP uses."""
    physics: Literal["published", "session"] = "published"
    """published: 60 steps, 10 kg, gravity 2 m/s², damping 0.99, friction 1, one hull each. session: [physics]."""


class DependencySettings(Settings, frozen=True):
    """Which objects touch, hide or carry which, and hence in which order they are solved. docs/methods.md 2."""

    rule: Literal["recommended", "published"] = "recommended"
    """recommended: contact, occlusion and support from the visible clouds. published: masks that touch when dilated by
    one pixel form a cluster, lower tops come first."""
    clusters: Literal["components", "cuthill_mckee"] = "components"
    """Which objects form a cluster. components: all that edges connect, directly or over others. cuthill_mckee: as the
    authors' code splits them, which separates some objects that edges connect."""
    order: Order = ()
    """Clusters in the order to solve them, which wins over any rule, as [[8, 2], [3]]: object ids, or "#4" for
    instance 4 where an object appears twice."""
    order_file: InputPath = ""
    """A JSON file of orders by frame, {"50/1": [[8, 2], [3]]}, relative to the session file; none = the order that
    comes with the frame, as in Extended APC, else the order of the rule."""
    cut: tuple[tuple[Index, Index], ...] = ()
    """Pairs of instances whose edges do not count."""
    contact_m: Length = 0.015
    """Visible clouds nearer than this may touch [m]."""
    occlusion_m: Length = 0.010
    """Along the common border the nearer object hides the other if it is nearer by more than this [m]."""


class GraspSettings(Settings, frozen=True):
    """The simulated grasp: a parallel gripper as wide as the Toyota HSR's, in Bullet. docs/methods.md 8.4."""

    answers: bool = False
    """Whether a batch simulates a grasp at each answer, and at its ground truth, which recordings then show; takes
    seconds per object."""
    folder: InputPath = ""
    """Folder of annotated grasps, .npy files of 4×4 transforms [m] in the object's frame, one per object, named after
    it ("011_banana.npy", "obj_000010.npy"), relative to the session file; "" = grasps sampled on the mesh."""
    samples: Annotated[int, Meta(ge=1, le=1000)] = 64
    """Grasps that are sampled on the mesh of an object without annotated ones; more where few of them are free."""
    seed: Seed = 0
    """Seeds the sampled grasps."""
    opening_m: Annotated[float, Meta(ge=0.01, le=0.5)] = 0.135
    """Distance of the open fingers of your gripper [m]; 0.135 for the Toyota HSR."""
    force_n: Annotated[float, Meta(ge=0.1, le=1000)] = 40.0
    """Force of each closing finger [N], from your gripper's data sheet."""
    mass_kg: Annotated[float, Meta(ge=1e-3, le=100)] = 0.5
    """Mass of every object [kg]."""
    friction: Annotated[float, Meta(ge=0, le=10)] = 0.5
    """Coefficient of friction between finger and object [-]; lower for smooth fingers, higher for rubber pads."""


MOST = {"score_falls_by": 1, "jump_mm": 10_000, "jump_deg": 180, "error_grows_by_mm": 10_000}
"""The largest threshold of each breakpoint that has one; no iteration exceeds it."""


class ThresholdSettings(Settings, frozen=True):
    """Breakpoints with a threshold; unset = never."""

    score_falls_by: Annotated[float, Meta(ge=0, le=MOST["score_falls_by"])] | None = None
    """The accepted score is lower than the arm's previous one by more than this [score]."""
    jump_mm: Annotated[float, Meta(ge=0, le=MOST["jump_mm"])] | None = None
    """The accepted pose moved further than this [mm]."""
    jump_deg: Annotated[float, Meta(ge=0, le=MOST["jump_deg"])] | None = None
    """The accepted pose turned further than this [deg]."""
    error_grows_by_mm: Annotated[float, Meta(ge=0, le=MOST["error_grows_by_mm"])] | None = None
    """ADD(-S) of the accepted pose against ground truth grew by more than this [mm]."""


class BreakpointSettings(ThresholdSettings, frozen=True):
    """When a running method should stop and wait; unset = never. The page sets them: they stand in saved sessions."""

    simulated_rejected: bool = False
    """The refined pose was accepted instead of the simulated one, by any margin: the usual case."""
    refined_rejected: bool = False
    """The simulated pose was accepted instead of the refined one."""
    arm_switched: bool = False
    """The bandit chose another hypothesis than before."""
    unstable: bool = False
    """The object touches something and would tip: its centre of mass is outside its support after the simulation."""
    physics_worse: bool = False
    """The simulated pose scores at least 0.2 less than the pose it began with."""
    empty_render: bool = False
    """A pose rendered to nothing, or its score was not a number."""
    waiting: ThresholdSettings = ThresholdSettings()
    """Thresholds of breakpoints that are off, saved by the page for when they are switched on."""
