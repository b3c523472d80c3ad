"""Every setting, once: name, unit, default, and the paper's or the code's reading of it.

A session file (TOML) is a :class:`Session`; what only some runs need is in ``algorithm_settings`` (refiners,
estimators, the tree search, the order of objects, breakpoints). ``--help-settings`` shows the docstrings of the fields.
Where the paper can be read in two ways the choice is a field; ``presets`` has the paper's and the authors' code's.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta

from verefine_viz.core.algorithm_settings import (
    BreakpointSettings,
    DenseFusionSettings,
    DependencySettings,
    DepthNetSettings,
    GraspSettings,
    IcpSettings,
    MctsSettings,
    PcsSettings,
    PpfSettings,
    TricpSettings,
)
from verefine_viz.core.errors import ContentError
from verefine_viz.core.number_kinds import Index, Seed
from verefine_viz.core.setting_types import Count, Gravity, InputPath, Pose, Settings, Weight

ModelSampling = Literal["random", "even"]
"""How points are spread over a model's surface."""


Factor = Annotated[float, Meta(ge=1e-6, le=1e6)]
PixelShift = Annotated[int, Meta(ge=-10_000, le=10_000)]
PoseConvention = Literal["given", "inverse", "opengl", "transposed", "x90", "x-90"]
"""Convention in which initial poses are written."""
LEAST_GRAVITY = 1e-6
"""Least largest component of a vector of gravity."""


class SceneSettings(Settings, frozen=True):
    """Which frames and which objects."""

    source: Literal["bop", "demo", "folder", "layout", "labels"] = "demo"
    """bop: a data set folder in BOP layout. demo: a built-in scene, no data needed. folder: traces of
    verefine_viz.trace, or a folder as FoundationPose, SAM-6D, MegaPose, DenseFusion, DeepIM or YCB-Video write them;
    which of these is recognized. layout: objects of YCB-V, rendered as they stand in a layout of the GRASPA benchmark.
    labels: the frames of a folder (bop or folder) with the objects that were labelled in them."""
    dataset: InputPath = ""
    """bop, folder, labels: the folder, relative to the session file; layout: that of the YCB-V models."""
    labels: InputPath = ""
    """Labels: the file of labels, relative to the session file."""
    models: InputPath = ""
    """Labels: the folder of the meshes to place; none = the data set's own."""
    layout: InputPath = ""
    """Layout: the XML file of a GRASPA layout, relative to the session file."""
    split: InputPath = "test"
    """BOP: the folder of the split below the data set (test, train_real, test_primesense, …)."""
    sensor: str = ""
    """BOP: the sensor whose files are read where scenes have several (cam1 for scene_camera_cam1.json, depth_cam1, …);
    none = the plain names, else the first sensor with ground truth."""
    demo: str = "mug"
    """Demo: name of the built-in scene; an unknown name lists them."""
    turned: bool = False
    """Demo, layout: every object turned by half, about the vertical or an axis about which its shape hardly changes,
    and put down again where it lay. Paper Sec. V-D: half of the trials."""
    frames: tuple[str, ...] = ()
    """Frames as "scene/image"; none = all of the targets file, else all of the split. BOP: also a list by its name:
    "linemod-paper", "ycbv-keyframes" (paper Sec. V), or a targets file of the data set."""
    sequence: bool = False
    """Whether the frames of a scene are those of a video, in order: changes of poses between frames are then measured.
    Always so for layouts of videos, traces that are named by numbers alone, and with `method.track`."""
    objects: tuple[Index, ...] = ()
    """BOP object ids to solve; none = all."""
    masks: InputPath = "mask_visib"
    """mask_visib or mask (folders of the data set), or the path of a BOP detections JSON."""
    gravity: Gravity = "plane"
    """Where "up" comes from: the support plane's normal, the data set's camera pose, or gravity as a vector in the
    camera frame (an IMU's reading)."""
    seed: Seed = 0
    """Seeds sensor noise of demo scenes, cloud and mesh sampling, and plane search."""
    cloud_points: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    """Observed points per object that the refiner sees; fewer are faster, more help where details tell poses apart."""
    model_points: Annotated[int, Meta(ge=1, le=100_000)] = 2000
    """Points sampled on each model; more for objects with thin parts, which else get few."""
    model_sampling: ModelSampling = "random"
    """How these points are chosen: at random, or evenly, each the farthest from all before (as the authors' clouds)."""

    def __post_init__(self) -> None:
        """Raises ContentError where gravity has no direction."""
        if isinstance(self.gravity, tuple) and max(map(abs, self.gravity)) < LEAST_GRAVITY:
            raise ContentError("gravity: expected a vector that is not zero")


class DataSettings(Settings, frozen=True):
    """Corrections of a frame's data after they are read; files stay as they are.

    Set one where a doubt about the data names it as its remedy (docs/causes.md).
    """

    depth_times: Factor = 1.0
    """Factor by which depth is multiplied."""
    depth_along: Literal["z", "ray"] = "z"
    """What the depth image holds: z, or the distance from the camera along each pixel's ray."""
    depth_shift_px: tuple[PixelShift, PixelShift] = (0, 0)
    """How far to the right and down of its pixel each depth lies in the depth image [px]."""
    camera_times: tuple[Factor, Factor, Factor, Factor] = (1.0, 1.0, 1.0, 1.0)
    """Factors by which fx, fy, cx and cy of cam_K are multiplied."""
    model_times: tuple[tuple[Index, Factor], ...] = ()
    """Factors by which models are enlarged, each with its object id, as [[5, 1000]]."""
    pose_times: Factor = 1.0
    """Factor by which translations of initial poses are multiplied."""
    poses: PoseConvention = "given"
    """Convention of the initial poses. inverse: camera in the object's frame. opengl: y up, z backwards. transposed:
    rotations column by column. x90, x-90: models turned by so many degrees about x."""
    inverted_masks: tuple[Index, ...] = ()
    """Object ids whose masks cover everything but the object."""


LABELLED = "labels"
"""Scene source of frames that are labelled."""
POSES_GIVEN = ("results", "perturb", "recorded")
"""Sources of initial poses that are no estimators."""


class HypothesesSettings(Settings, frozen=True):
    """Where the initial poses come from."""

    source: str = "perturb"
    """results: BOP results files, a row per hypothesis. perturb: ground truth, disturbed as in the paper's ablation.
    recorded: all that come with source folder. Or an estimator: ppf, point pair features; pcs, congruent point sets
    (Super4PCS); densefusion, the network, with weights of yours; one of your own by its name (docs/guide.md)."""
    files: tuple[InputPath, ...] = ()
    """Results files (CSV), relative to the session file; the most trusted first: they take turns in the pool, the best
    row of each, then the second best, …"""
    max_per_object: Count = 5
    """H, hypotheses per object; further rows are left out, lowest score first."""
    rotation_deg: Annotated[float, Meta(ge=0, le=180)] = 30.0
    """perturb: angle of the disturbance about a random axis [deg]. Paper Sec. V-A."""
    translation_mm: Annotated[float, Meta(ge=0, le=10_000)] = 30.0
    """perturb: length of the disturbance in a random direction [mm]. Paper Sec. V-A."""
    seed: Seed = 0
    """perturb: seed of the disturbances."""
    flips: bool = False
    """Whether a promising pose's flips, at which the shape looks nearly the same (a box turned over, a can turned about
    its axis), compete with it: scored, without a call of the refiner. Only where colour counts, as depth alone often
    chooses the wrong one (docs/methods.md 1.11). Preset recommended: true with depth_net_icp."""
    estimate: tuple[tuple[str, Index, str], ...] = ()
    """Instances whose initial poses come from an estimator instead, each with its frame, as [["50/1", 4, "ppf"]]."""

    def __post_init__(self) -> None:
        """Raises ContentError where poses would be read twice from a file."""
        twice = next((file for file in self.files if self.files.count(file) > 1), None)
        if twice is not None and self.source == "results":
            raise ContentError(f"files: {twice} is named twice; name each file once")


class MethodSettings(Settings, frozen=True):
    """Which algorithm, and its budget."""

    name: str = "rir"
    """refine, phys_before, phys_after, even, expl, pir, sir, rir, vf_breadth, vf_depth, physim_mcts; trace: the
    steps that a trace recorded."""
    refiner: str = "icp"
    """Name of the refiner. Presets: recommended has depth_net_icp, paper and published have icp."""
    track: bool = False
    """Whether frames are those of a video: the answer of the previous frame becomes the first initial pose of its
    object in the next, moved along with the camera where the data set knows the camera's pose."""
    iterations: Count = 5
    """K, refiner calls per hypothesis; a method with H hypotheses has H·K. Paper Sec. V: 5 with ICP."""
    exploration: Weight = 0.7
    """c, weight of the exploration term in UCB [score]. The paper gives no value, the authors' code has 0.1; but
    their score spreads over a quarter of the range of this one, and measured on real frames 0.5-1.0 finds better poses
    (docs/methods.md 1.8.21)."""
    seed: Seed = 0
    """Seed of methods that draw random numbers."""
    sim_candidate: Literal["full", "rotation_only"] = "full"
    """SIR: which simulated pose is scored and may be accepted: the simulator's whole pose (authors' code), or its
    rotation with the current translation, as it enters the refiner."""
    accept: Literal["latest", "never_worse"] = "latest"
    """SIR: the next iteration starts from this iteration's better candidate even if the score fell (authors' code), or
    only if it did not fall."""
    discount: Annotated[float, Meta(ge=0, le=1)] = 0.99
    """γ, vf_depth: weight of plays of the previous pass. The paper: "a small factor"; authors' code: 0.99."""
    scene_reward: Literal["current_pass", "best_known"] = "current_pass"
    """vf_depth: the poses whose scene score rewards a hypothesis: those of this pass (authors' code), or the best of
    each object so far (the paper's text)."""
    scene_answer: Literal["incumbent", "per_object"] = "incumbent"
    """vf_depth: the answer is the combination of poses with the highest scene score seen, or for each object the pose
    with its own best score, whether or not they fit together (authors' code)."""
    scene_prior: Literal["scene", "object"] = "scene"
    """vf_depth: the first reward of a hypothesis: the score of the scene with its pose and the best initial poses of
    the other objects, on the scale of later rewards, or the score of its initial pose alone (authors' code)."""
    scene_pixels: Literal["cluster", "frame"] = "cluster"
    """vf_depth: the masks that a scene score uses: those of the cluster, or of all objects (authors' code)."""
    occluders: Literal["placed", "none"] = "placed"
    """vf_breadth, vf_depth: whether objects placed before are rendered, as they may hide the one being scored; the
    authors' code renders none."""
    carry_clusters: bool = True
    """vf_breadth, vf_depth: earlier clusters stay in simulation and rendering for later ones; the authors' code forgets
    them."""


EQ_1 = "eq_1"
"""Name of the package's own verifier."""


class ScoreSettings(Settings, frozen=True):
    """The verification score (paper Sec. III-B, Eq. 1; docs/methods.md 1.7)."""

    verifier: str = EQ_1
    """eq_1: Eq. 1 with the fields below. Else the name of a verifier of your own, which scores poses in its place
    (docs/guide.md, "Your own verifier") and may read the fields below."""
    pixels: Literal["classes", "published", "observed"] = "classes"
    """Which pixels count. published: rendered or observed depth of any object (authors' shader). observed: valid depth
    in the object's mask (the paper's text). classes: the object's own mask and rendering, with what something nearer
    hides and what was not measured left out: orders real poses best (bench/rank_real_poses.py)."""
    tau_m: Annotated[float, Meta(gt=0, le=1)] = 0.020
    """τ, depth tolerance [m]. Paper Sec. V: 20 mm."""
    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.707
    """α, tolerance of 1 − n·n̂ [-]. The authors' shader has 0.707, which cuts off at 73°; "45°" taken literally is
    0.293."""
    pixel_centre: Literal["integer", "half"] = "integer"
    """Where the camera matrix has the centre of pixel (0, 0): at (0, 0), as depth sensors are calibrated, or half a
    pixel further, as in the authors' projection."""
    colour_weight: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    """w, weight of colour: f̄ becomes (1 − w) f̄ + w max(f_c, 0), with f_c the correlation of rendered and observed
    colour (docs/methods.md 1.10). 0 = depth and normals alone, as in the paper. An object whose model, or whose part of
    the image, is of one colour has w = 0. Preset recommended: 0.1 with depth_net_icp."""
    plausibility_weight: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    """w, weight of plausibility: the score f becomes (1 − w) f + w p, with p in [0, 1] lower for a pose that floats,
    sinks into something or would fall (docs/methods.md 1.14). 0 = does not count, as in the paper. Needs a support
    plane."""
    renderer: Literal["auto", "gl", "cpu"] = "auto"
    """auto: the CPU rasteriser, or OpenGL 4.3 on a GPU where it was measured to be faster (`doctor` says which)."""
    simplify_mm: Annotated[float, Meta(ge=0, le=100)] = 0.2
    """Largest deviation of the mesh that is scored from the model's mesh [mm]; 0 keeps every triangle. 0.2 moves the
    scores of real frames by up to 0.001, and takes two thirds of the time."""


BULLET = "bullet"
"""Name of the package's own simulator."""


class PhysicsSettings(Settings, frozen=True):
    """The simulator. Paper Sec. V: Bullet, 1/60 s, 10 solver iterations, 4 sub-steps, 1 kg, 3 steps."""

    enabled: bool = True
    """Off: simulated pose = current pose. For objects that nothing supports, as in a hand."""
    simulator: str = BULLET
    """bullet, or a simulator of your own (docs/guide.md); colliders and solver below are Bullet's."""
    steps: Count = 3
    """Steps per iteration; 60 for the Extended APC experiments."""
    step_s: Annotated[float, Meta(ge=1e-5, le=1)] = 1 / 60
    """Duration of one step [s]."""
    substeps: Annotated[int, Meta(ge=1, le=1000)] = 4
    """Bullet sub-steps per step."""
    solver_iterations: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Bullet constraint solver iterations."""
    mass_kg: Annotated[float, Meta(ge=1e-6, le=1e6)] = 1.0
    """Mass of every object [kg]."""
    friction: Annotated[float, Meta(ge=0, le=100)] = 0.5
    """Lateral friction of objects; the plane has 1.0. Lower for glass, higher for rubber."""
    collider: Literal["decomposition", "hull"] = "decomposition"
    """Convex decomposition keeps bowls and mugs hollow; the authors use one hull per object."""
    collider_folder: InputPath = ""
    """Folder of convex parts in place of `collider`: obj_000005.obj for object 5, with a part in each of the file's
    objects (as V-HACD writes them); models without a file follow `collider`."""
    collider_unit_m: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    """One unit of these files [m]; 0.001 for millimetres."""
    inertia: Literal["mesh", "box"] = "mesh"
    """Moments of inertia of an object about the mesh's centre of mass: those of its mesh, or of its bounding box along
    the axes of the model (authors' code: Bullet's default)."""
    margin_m: Annotated[float, Meta(ge=0, le=0.1)] = 1e-4
    """Collision margin [m]; Bullet's default for meshes is 1e-3, which leaves objects 1 mm above the plane."""
    gravity_m_s2: Annotated[float, Meta(ge=0, le=1000)] = 9.81
    """Strength of gravity [m/s²]; lower lets objects move less in a step; PHYSIM-MCTS has 2."""
    damping: Annotated[float, Meta(ge=0, le=1)] = 0.04
    """Linear and angular damping of objects, the share of speed lost in a second [-]; Bullet's default is 0.04."""
    placed: Literal["static", "dynamic"] = "static"
    """Objects already placed stay where they are, or are pushed (authors' code)."""
    support: Literal["plane", "observed", "mesh"] = "plane"
    """What supports and stops the objects. plane: the support plane alone (paper Sec. III-A). observed: all that the
    depth image shows outside of the masks; docs/methods.md 7.4. mesh: the file in `physics.mesh`."""
    dropped: tuple[tuple[str, Index], ...] = ()
    """observed: unknown objects that stop nothing, each with its frame, as [["50/1", 2]]."""
    mesh: InputPath = ""
    """mesh: the file of the surroundings (PLY, OBJ, STL, …), relative to the session file."""
    mesh_unit_m: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    """mesh: one unit of the file [m]; 0.001 for millimetres."""
    mesh_frame: Literal["world", "camera"] = "world"
    """mesh: the frame that `mesh_pose` is given in: the data set's world (cam_R_w2c and cam_t_w2c of the frame), or the
    camera's."""
    mesh_pose: Annotated[tuple[float, ...], Meta(max_length=16)] = ()
    """mesh: where the file's frame is in that frame, 4×4 row by row, lengths in metres; none = the same frame."""


SURROUNDINGS = ("support", "dropped", "mesh", "mesh_unit_m", "mesh_frame", "mesh_pose")
"""Fields of [physics] that describe the surroundings: they hold from the start of a run."""


class RecordingSettings(Settings, frozen=True):
    """Rerun recordings."""

    keep: Literal["sample", "all", "failures", "none"] = "sample"
    """Which frames of a batch keep their recording (about 3 MB each); failures: final error above 10 % of the
    diameter, or no answer; sample: all of up to 200 frames, of more the failures and about 200 others. `replay RUN
    --draw` makes any recording from its run file."""
    maps: bool = True
    """Log depth and score maps of every iteration (about 0.05 MB each), else numbers and poses only."""


class Edit(Settings, frozen=True):
    """An edited pose."""

    after_iteration: Index
    """The iteration after which it was edited; 0 = before the first."""
    instance: Index
    """instance_id."""
    hypothesis: Index
    """Index of the hypothesis, from 0."""
    T_cam_obj: Pose
    """The new pose, row by row [m]."""
    frame: str = ""
    """The frame in which it was edited, as "scene/image"; "" = every frame that has the hypothesis."""


class TrackedPose(Settings, frozen=True):
    """The answer of an earlier frame as an initial pose of a later one."""

    frame: str
    """The later frame, as "scene/image"."""
    instance: Index
    """instance_id there."""
    T_cam_obj: Pose
    """The pose in the later frame, row by row [m]."""
    answered_in: str
    """The earlier frame."""


class StartPose(Settings, frozen=True):
    """A pose that is an object's only hypothesis."""

    frame: str
    """The frame, as "scene/image"."""
    instance: Index
    """instance_id."""
    T_cam_obj: Pose
    """The pose, row by row [m]."""


class Change(Settings, frozen=True):
    """Settings that were changed in the middle of a run."""

    after_iteration: Index
    """The iteration after which they hold; 0 = before the first."""
    settings: dict[str, dict[str, Any]]
    """Changed fields by section: {"method": {"exploration": 0.2}}; sections of `DURING_A_RUN`."""


class Session(Settings, frozen=True):
    """Everything that defines a run."""

    title: str = ""
    """Shown on the page and in recordings."""
    preset: Literal["recommended", "paper", "published"] = "recommended"
    """recommended: the choices that are right most often on real frames; colour and flips only with its own refiner.
    paper: every choice of the paper's text, and its budget for the refiner. published: the choices of the authors'
    public code. Fields given explicitly win over it. docs/methods.md 1.8."""
    scene: SceneSettings = SceneSettings()
    data: DataSettings = DataSettings()
    hypotheses: HypothesesSettings = HypothesesSettings()
    method: MethodSettings = MethodSettings()
    icp: IcpSettings = IcpSettings()
    tricp: TricpSettings = TricpSettings()
    depth_net: DepthNetSettings = DepthNetSettings()
    densefusion: DenseFusionSettings = DenseFusionSettings()
    mcts: MctsSettings = MctsSettings()
    dependency: DependencySettings = DependencySettings()
    ppf: PpfSettings = PpfSettings()
    pcs: PcsSettings = PcsSettings()
    score: ScoreSettings = ScoreSettings()
    physics: PhysicsSettings = PhysicsSettings()
    grasp: GraspSettings = GraspSettings()
    breakpoints: BreakpointSettings = BreakpointSettings()
    recording: RecordingSettings = RecordingSettings()
    edits: tuple[Edit, ...] = ()
    """Edited poses, so that a saved session repeats them."""
    tracked: tuple[TrackedPose, ...] = ()
    """With `method.track`, the poses with which frames of this run began, so that a recording or a saved session
    repeats them without solving the frames before."""
    starts: tuple[StartPose, ...] = ()
    """Poses with which objects begin in place of `[hypotheses]`, one per object, so that a saved session repeats what
    "Refine this pose" of the page began."""
    changes: tuple[Change, ...] = ()
    """Settings changed during the run, so that a saved session repeats them."""
