"""Settings by section, as keywords of the library take them. Written by `make sections` from core/settings.py."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Required, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray

from verefine_viz.library.plugins import AnyEstimator, AnyRefiner, AnySimulator, AnyVerifier

Whole: TypeAlias = int | np.integer[Any]
Number: TypeAlias = float | np.floating[Any] | np.integer[Any]
Numbers: TypeAlias = Sequence[Number] | NDArray[Any]
Flag: TypeAlias = bool | np.bool_
InputPath: TypeAlias = str | os.PathLike[str]
MethodName: TypeAlias = Literal[
    "refine",
    "phys_before",
    "phys_after",
    "even",
    "expl",
    "pir",
    "sir",
    "rir",
    "vf_breadth",
    "vf_depth",
    "physim_mcts",
]


class SceneSection(TypedDict, total=False):
    """Which frames and which objects."""

    source: Literal["bop", "demo", "folder", "labels", "layout"]
    """bop: a data set folder in BOP layout. demo: a built-in scene, no data needed. folder: traces of
    verefine_viz.trace, or a folder as FoundationPose, SAM-6D, MegaPose, DenseFusion, DeepIM or YCB-Video write them;
    which of these is recognized. layout: objects of YCB-V, rendered as they stand in a layout of the GRASPA benchmark.
    labels: the frames of a folder (bop or folder) with the objects that were labelled in them.
    """
    dataset: InputPath
    """bop, folder, labels: the folder, relative to the session file; layout: that of the YCB-V models."""
    labels: InputPath
    """Labels: the file of labels, relative to the session file."""
    models: InputPath
    """Labels: the folder of the meshes to place; none = the data set's own."""
    layout: InputPath
    """Layout: the XML file of a GRASPA layout, relative to the session file."""
    split: InputPath
    """BOP: the folder of the split below the data set (test, train_real, test_primesense, …)."""
    sensor: str
    """BOP: the sensor whose files are read where scenes have several (cam1 for scene_camera_cam1.json, depth_cam1, …);
    none = the plain names, else the first sensor with ground truth.
    """
    demo: str
    """Demo: name of the built-in scene; an unknown name lists them."""
    turned: Flag
    """Demo, layout: every object turned by half, about the vertical or an axis about which its shape hardly changes,
    and put down again where it lay. Paper Sec. V-D: half of the trials.
    """
    frames: Sequence[str]
    """Frames as "scene/image"; none = all of the targets file, else all of the split. BOP: also a list by its name:
    "linemod-paper", "ycbv-keyframes" (paper Sec. V), or a targets file of the data set.
    """
    sequence: Flag
    """Whether the frames of a scene are those of a video, in order: changes of poses between frames are then measured.
    Always so for layouts of videos, traces that are named by numbers alone, and with `method.track`.
    """
    objects: Sequence[Whole]
    """BOP object ids to solve; none = all."""
    masks: InputPath
    """mask_visib or mask (folders of the data set), or the path of a BOP detections JSON."""
    gravity: Literal["plane", "world"] | Numbers
    """Where "up" comes from: the support plane's normal, the data set's camera pose, or gravity as a vector in the
    camera frame (an IMU's reading).
    """
    seed: Whole
    """Seeds sensor noise of demo scenes, cloud and mesh sampling, and plane search."""
    cloud_points: Whole
    """Observed points per object that the refiner sees; fewer are faster, more help where details tell poses apart."""
    model_points: Whole
    """Points sampled on each model; more for objects with thin parts, which else get few."""
    model_sampling: Literal["even", "random"]
    """How these points are chosen: at random, or evenly, each the farthest from all before (as the authors' clouds)."""


class DataSection(TypedDict, total=False):
    """Corrections of a frame's data after they are read; files stay as they are. Set one where a doubt about the data
    names it as its remedy (docs/causes.md).
    """

    depth_times: Number
    """Factor by which depth is multiplied."""
    depth_along: Literal["ray", "z"]
    """What the depth image holds: z, or the distance from the camera along each pixel's ray."""
    depth_shift_px: Sequence[Whole]
    """How far to the right and down of its pixel each depth lies in the depth image [px]."""
    camera_times: Numbers
    """Factors by which fx, fy, cx and cy of cam_K are multiplied."""
    model_times: Sequence[Sequence[Whole | Number]]
    """Factors by which models are enlarged, each with its object id, as [[5, 1000]]."""
    pose_times: Number
    """Factor by which translations of initial poses are multiplied."""
    poses: Literal["given", "inverse", "opengl", "transposed", "x-90", "x90"]
    """Convention of the initial poses. inverse: camera in the object's frame. opengl: y up, z backwards. transposed:
    rotations column by column. x90, x-90: models turned by so many degrees about x.
    """
    inverted_masks: Sequence[Whole]
    """Object ids whose masks cover everything but the object."""


class HypothesesSection(TypedDict, total=False):
    """Where the initial poses come from."""

    source: AnyEstimator
    """results: BOP results files, a row per hypothesis. perturb: ground truth, disturbed as in the paper's ablation.
    recorded: all that come with source folder. Or an estimator: ppf, point pair features; pcs, congruent point sets
    (Super4PCS); densefusion, the network, with weights of yours; one of your own by its name (docs/guide.md).
    """
    files: Sequence[InputPath]
    """Results files (CSV), relative to the session file; the most trusted first: they take turns in the pool, the best
    row of each, then the second best, …
    """
    max_per_object: Whole
    """H, hypotheses per object; further rows are left out, lowest score first."""
    rotation_deg: Number
    """perturb: angle of the disturbance about a random axis [deg]. Paper Sec. V-A."""
    translation_mm: Number
    """perturb: length of the disturbance in a random direction [mm]. Paper Sec. V-A."""
    seed: Whole
    """perturb: seed of the disturbances."""
    flips: Flag
    """Whether a promising pose's flips, at which the shape looks nearly the same (a box turned over, a can turned about
    its axis), compete with it: scored, without a call of the refiner. Only where colour counts, as depth alone often
    chooses the wrong one (docs/methods.md 1.11). Preset recommended: true with depth_net_icp.
    """
    estimate: Sequence[Sequence[str | Whole]]
    """Instances whose initial poses come from an estimator instead, each with its frame, as [["50/1", 4, "ppf"]]."""


class MethodSection(TypedDict, total=False):
    """Which algorithm, and its budget."""

    name: MethodName
    """refine, phys_before, phys_after, even, expl, pir, sir, rir, vf_breadth, vf_depth, physim_mcts; trace: the steps
    that a trace recorded.
    """
    refiner: AnyRefiner
    """Name of the refiner. Presets: recommended has depth_net_icp, paper and published have icp."""
    track: Flag
    """Whether frames are those of a video: the answer of the previous frame becomes the first initial pose of its
    object in the next, moved along with the camera where the data set knows the camera's pose.
    """
    iterations: Whole
    """K, refiner calls per hypothesis; a method with H hypotheses has H·K. Paper Sec. V: 5 with ICP."""
    exploration: Number
    """c, weight of the exploration term in UCB [score]. The paper gives no value, the authors' code has 0.1; but their
    score spreads over a quarter of the range of this one, and measured on real frames 0.5-1.0 finds better poses
    (docs/methods.md 1.8.21).
    """
    seed: Whole
    """Seed of methods that draw random numbers."""
    sim_candidate: Literal["full", "rotation_only"]
    """SIR: which simulated pose is scored and may be accepted: the simulator's whole pose (authors' code), or its
    rotation with the current translation, as it enters the refiner.
    """
    accept: Literal["latest", "never_worse"]
    """SIR: the next iteration starts from this iteration's better candidate even if the score fell (authors' code), or
    only if it did not fall.
    """
    discount: Number
    """γ, vf_depth: weight of plays of the previous pass. The paper: "a small factor"; authors' code: 0.99."""
    scene_reward: Literal["best_known", "current_pass"]
    """vf_depth: the poses whose scene score rewards a hypothesis: those of this pass (authors' code), or the best of
    each object so far (the paper's text).
    """
    scene_answer: Literal["incumbent", "per_object"]
    """vf_depth: the answer is the combination of poses with the highest scene score seen, or for each object the pose
    with its own best score, whether or not they fit together (authors' code).
    """
    scene_prior: Literal["object", "scene"]
    """vf_depth: the first reward of a hypothesis: the score of the scene with its pose and the best initial poses of
    the other objects, on the scale of later rewards, or the score of its initial pose alone (authors' code).
    """
    scene_pixels: Literal["cluster", "frame"]
    """vf_depth: the masks that a scene score uses: those of the cluster, or of all objects (authors' code)."""
    occluders: Literal["none", "placed"]
    """vf_breadth, vf_depth: whether objects placed before are rendered, as they may hide the one being scored; the
    authors' code renders none.
    """
    carry_clusters: Flag
    """vf_breadth, vf_depth: earlier clusters stay in simulation and rendering for later ones; the authors' code forgets
    them.
    """


class IcpSection(TypedDict, total=False):
    """Point-to-point (or point-to-plane) ICP. docs/methods.md 4.1."""

    metric: Literal["plane", "point"]
    """Distance that a step minimises."""
    stop: Literal["max_iterations", "published", "tolerance"]
    """published: stops after 2 inner iterations, as the authors' PCL settings do. max_iterations: always runs them all.
    tolerance: until the step is below 1e-6.
    """
    max_iterations: Whole
    """Inner iterations per refiner call."""
    gate: Literal["published", "shrinking"]
    """Largest distance of a correspondence. published: 0.1 × the observed cloud's largest extent, which leaves far
    starts untouched. shrinking: starts at 0.5 of it and tightens to the published gate.
    """
    matches: Literal["all", "same_side"]
    """Which correspondences within the gate count. all: every one (published). same_side: those whose observed and
    model normals lie within 90° of each other, so that the seen front is not pulled to the model's back.
    """


class TricpSection(TypedDict, total=False):
    """Trimmed ICP. docs/methods.md 4.2."""

    trim: Number
    """Share of the observed points, the best matching ones, that the fit uses; 0.9-0.5 bears leaking masks better."""
    energy_ratio: Number
    """A pass that leaves more than this share of the energy before is the last."""
    max_passes: Whole
    """Most passes of a call, which bounds its time; PCL has no bound."""
    explained_m: Number
    """Observed points closer than this to an object already placed are left out [m]; 0 keeps all."""


class DepthNetSection(TypedDict, total=False):
    """The learned depth refiner. docs/methods.md 4.4."""

    weights: InputPath
    """ONNX file of `verefine-viz train depth_net`, relative to the session file; "" = the weights of the package."""
    iterations: Whole
    """Steps of the network per refiner call."""


class DenseFusionSection(TypedDict, total=False):
    """DenseFusion, estimator and refiner. docs/methods.md 4.3 and 5."""

    weights: InputPath
    """PoseNet: official .pth file (which needs the extra `torch` once), or ONNX file of `verefine-viz train
    densefusion`, relative to the session file; empty = the package's, trained on the objects of the built-in scenes.
    """
    refiner_weights: InputPath
    """PoseRefineNet: a file of the same kinds, from the same training as `weights`."""
    classes: Sequence[Whole]
    """Ids of the objects in the order of the network's classes; none = as in the weights: official ones have the 21
    objects of YCB-Video or the 13 of LINEMOD, whose order and frames are known.
    """
    points: Whole
    """Points of the mask that the networks see; 0 = as in training, official: 1000 on YCB-Video, 500 on LINEMOD."""
    iterations: Whole
    """Steps of PoseRefineNet per refiner call. Paper Sec. V: 2 in all, shared out over 2 iterations (`method.iterations
    = 2`).
    """
    seed: Whole
    """Seeds the points, and the choice of their poses for the pool."""


class MctsSection(TypedDict, total=False):
    """PHYSIM-MCTS, the system that the paper compares with. docs/methods.md 3."""

    expansions: Whole
    """Budget in expansions per object."""
    seconds: Number | None
    """Budget in computing time per cluster instead [s]; results then depend on the machine."""
    exploration_px: Number
    """α, weight of the exploration term [px]. The cost counts pixels: choose it larger for images of more pixels."""
    explained_m: Number
    """A pixel whose observed and rendered depth differ by more than this adds 1 to the cost [m]."""
    trim: Number
    """Share of the points that its trimmed ICP uses."""
    physics: Literal["published", "session"]
    """published: 60 steps, 10 kg, gravity 2 m/s², damping 0.99, friction 1, one hull each. session: [physics]."""


class DependencySection(TypedDict, total=False):
    """Which objects touch, hide or carry which, and hence in which order they are solved. docs/methods.md 2."""

    rule: Literal["published", "recommended"]
    """recommended: contact, occlusion and support from the visible clouds. published: masks that touch when dilated by
    one pixel form a cluster, lower tops come first.
    """
    clusters: Literal["components", "cuthill_mckee"]
    """Which objects form a cluster. components: all that edges connect, directly or over others. cuthill_mckee: as the
    authors' code splits them, which separates some objects that edges connect.
    """
    order: Sequence[Sequence[Whole | str]]
    """Clusters in the order to solve them, which wins over any rule, as [[8, 2], [3]]: object ids, or "#4" for instance
    4 where an object appears twice.
    """
    order_file: InputPath
    """A JSON file of orders by frame, {"50/1": [[8, 2], [3]]}, relative to the session file; none = the order that
    comes with the frame, as in Extended APC, else the order of the rule.
    """
    cut: Sequence[Sequence[Whole]]
    """Pairs of instances whose edges do not count."""
    contact_m: Number
    """Visible clouds nearer than this may touch [m]."""
    occlusion_m: Number
    """Along the common border the nearer object hides the other if it is nearer by more than this [m]."""


class PpfSection(TypedDict, total=False):
    """Point pair features. docs/methods.md 6; defaults as measured on real frames (bench/estimators.py)."""

    step: Number
    """Grid of model and scene points as a share of the diameter."""
    distance_bin: Number
    """Bin of distances as a share of the diameter."""
    angle_bin_deg: Number
    """Bin of the three angles [deg]."""
    bin_limit: Whole
    """Most model pairs used of a bin; each then stands for several. Flat faces fill few bins with very many pairs."""
    reference_every: Whole
    """Every n-th scene point is a reference."""
    candidates: Whole
    """Clusters with most votes that are ranked by their agreement with the depth image."""
    tolerance: Number
    """Depths that differ by less than this share of the diameter agree."""
    seed: Whole
    """Seeds the points drawn on the model."""


class PcsSection(TypedDict, total=False):
    """Congruent point sets (Super4PCS). docs/methods.md 3.2."""

    delta_m: Number
    """δ, distance within which two points correspond [m]; pairs, quads and fits may differ by 2δ. Larger for a noisier
    sensor.
    """
    grid_m: Number
    """Side of the grid that thins segment and model [m]; finer for small objects."""
    part_share: Number
    """Isolated parts of the segment with less than this share of its points are left out, as they come from leaking
    masks. 0 keeps all (published code).
    """
    samples: Whole
    """Points of the model, spread evenly; those that lie on the segment are counted. More of them tell similar poses
    better apart, and take longer.
    """
    spacing_m: Number
    """Points that are at least so far apart make up the quads [m]; the number of quads grows with the fourth power of
    the number of points. 0 takes all (published code).
    """
    bases: Whole
    """Bases tried; the published code tries bases for 1 s, so that its results depend on the machine."""
    keep_share: Number
    """Poses whose LCP is below this share of the best one are left out. Published code: 0.2, with which the middle of a
    cluster is often no good pose.
    """
    seed: Whole
    """Seeds bases, quads and clusters."""


class ScoreSection(TypedDict, total=False):
    """The verification score (paper Sec. III-B, Eq. 1; docs/methods.md 1.7)."""

    verifier: AnyVerifier
    """eq_1: Eq. 1 with the fields below. Else the name of a verifier of your own, which scores poses in its place
    (docs/guide.md, "Your own verifier") and may read the fields below.
    """
    pixels: Literal["classes", "observed", "published"]
    """Which pixels count. published: rendered or observed depth of any object (authors' shader). observed: valid depth
    in the object's mask (the paper's text). classes: the object's own mask and rendering, with what something nearer
    hides and what was not measured left out: orders real poses best (bench/rank_real_poses.py).
    """
    tau_m: Number
    """τ, depth tolerance [m]. Paper Sec. V: 20 mm."""
    alpha: Number
    """α, tolerance of 1 − n·n̂ [-]. The authors' shader has 0.707, which cuts off at 73°; "45°" taken literally is
    0.293.
    """
    pixel_centre: Literal["half", "integer"]
    """Where the camera matrix has the centre of pixel (0, 0): at (0, 0), as depth sensors are calibrated, or half a
    pixel further, as in the authors' projection.
    """
    colour_weight: Number
    """w, weight of colour: f̄ becomes (1 − w) f̄ + w max(f_c, 0), with f_c the correlation of rendered and observed
    colour (docs/methods.md 1.10). 0 = depth and normals alone, as in the paper. An object whose model, or whose part of
    the image, is of one colour has w = 0. Preset recommended: 0.1 with depth_net_icp.
    """
    plausibility_weight: Number
    """w, weight of plausibility: the score f becomes (1 − w) f + w p, with p in [0, 1] lower for a pose that floats,
    sinks into something or would fall (docs/methods.md 1.14). 0 = does not count, as in the paper. Needs a support
    plane.
    """
    renderer: Literal["auto", "cpu", "gl"]
    """auto: the CPU rasteriser, or OpenGL 4.3 on a GPU where it was measured to be faster (`doctor` says which)."""
    simplify_mm: Number
    """Largest deviation of the mesh that is scored from the model's mesh [mm]; 0 keeps every triangle. 0.2 moves the
    scores of real frames by up to 0.001, and takes two thirds of the time.
    """


class PhysicsSection(TypedDict, total=False):
    """The simulator. Paper Sec. V: Bullet, 1/60 s, 10 solver iterations, 4 sub-steps, 1 kg, 3 steps."""

    enabled: Flag
    """Off: simulated pose = current pose. For objects that nothing supports, as in a hand."""
    simulator: AnySimulator
    """bullet, or a simulator of your own (docs/guide.md); colliders and solver below are Bullet's."""
    steps: Whole
    """Steps per iteration; 60 for the Extended APC experiments."""
    step_s: Number
    """Duration of one step [s]."""
    substeps: Whole
    """Bullet sub-steps per step."""
    solver_iterations: Whole
    """Bullet constraint solver iterations."""
    mass_kg: Number
    """Mass of every object [kg]."""
    friction: Number
    """Lateral friction of objects; the plane has 1.0. Lower for glass, higher for rubber."""
    collider: Literal["decomposition", "hull"]
    """Convex decomposition keeps bowls and mugs hollow; the authors use one hull per object."""
    collider_folder: InputPath
    """Folder of convex parts in place of `collider`: obj_000005.obj for object 5, with a part in each of the file's
    objects (as V-HACD writes them); models without a file follow `collider`.
    """
    collider_unit_m: Number
    """One unit of these files [m]; 0.001 for millimetres."""
    inertia: Literal["box", "mesh"]
    """Moments of inertia of an object about the mesh's centre of mass: those of its mesh, or of its bounding box along
    the axes of the model (authors' code: Bullet's default).
    """
    margin_m: Number
    """Collision margin [m]; Bullet's default for meshes is 1e-3, which leaves objects 1 mm above the plane."""
    gravity_m_s2: Number
    """Strength of gravity [m/s²]; lower lets objects move less in a step; PHYSIM-MCTS has 2."""
    damping: Number
    """Linear and angular damping of objects, the share of speed lost in a second [-]; Bullet's default is 0.04."""
    placed: Literal["dynamic", "static"]
    """Objects already placed stay where they are, or are pushed (authors' code)."""
    support: Literal["mesh", "observed", "plane"]
    """What supports and stops the objects. plane: the support plane alone (paper Sec. III-A). observed: all that the
    depth image shows outside of the masks; docs/methods.md 7.4. mesh: the file in `physics.mesh`.
    """
    dropped: Sequence[Sequence[str | Whole]]
    """observed: unknown objects that stop nothing, each with its frame, as [["50/1", 2]]."""
    mesh: InputPath
    """mesh: the file of the surroundings (PLY, OBJ, STL, …), relative to the session file."""
    mesh_unit_m: Number
    """mesh: one unit of the file [m]; 0.001 for millimetres."""
    mesh_frame: Literal["camera", "world"]
    """mesh: the frame that `mesh_pose` is given in: the data set's world (cam_R_w2c and cam_t_w2c of the frame), or the
    camera's.
    """
    mesh_pose: Numbers
    """mesh: where the file's frame is in that frame, 4×4 row by row, lengths in metres; none = the same frame."""


class GraspSection(TypedDict, total=False):
    """The simulated grasp: a parallel gripper as wide as the Toyota HSR's, in Bullet. docs/methods.md 8.4."""

    answers: Flag
    """Whether a batch simulates a grasp at each answer, and at its ground truth, which recordings then show; takes
    seconds per object.
    """
    folder: InputPath
    """Folder of annotated grasps, .npy files of 4×4 transforms [m] in the object's frame, one per object, named after
    it ("011_banana.npy", "obj_000010.npy"), relative to the session file; "" = grasps sampled on the mesh.
    """
    samples: Whole
    """Grasps that are sampled on the mesh of an object without annotated ones; more where few of them are free."""
    seed: Whole
    """Seeds the sampled grasps."""
    opening_m: Number
    """Distance of the open fingers of your gripper [m]; 0.135 for the Toyota HSR."""
    force_n: Number
    """Force of each closing finger [N], from your gripper's data sheet."""
    mass_kg: Number
    """Mass of every object [kg]."""
    friction: Number
    """Coefficient of friction between finger and object [-]; lower for smooth fingers, higher for rubber pads."""


class ThresholdSection(TypedDict, total=False):
    """Breakpoints with a threshold; unset = never."""

    score_falls_by: Number | None
    """The accepted score is lower than the arm's previous one by more than this [score]."""
    jump_mm: Number | None
    """The accepted pose moved further than this [mm]."""
    jump_deg: Number | None
    """The accepted pose turned further than this [deg]."""
    error_grows_by_mm: Number | None
    """ADD(-S) of the accepted pose against ground truth grew by more than this [mm]."""


class BreakpointSection(TypedDict, total=False):
    """When a running method should stop and wait; unset = never. The page sets them: they stand in saved sessions."""

    score_falls_by: Number | None
    """The accepted score is lower than the arm's previous one by more than this [score]."""
    jump_mm: Number | None
    """The accepted pose moved further than this [mm]."""
    jump_deg: Number | None
    """The accepted pose turned further than this [deg]."""
    error_grows_by_mm: Number | None
    """ADD(-S) of the accepted pose against ground truth grew by more than this [mm]."""
    simulated_rejected: Flag
    """The refined pose was accepted instead of the simulated one, by any margin: the usual case."""
    refined_rejected: Flag
    """The simulated pose was accepted instead of the refined one."""
    arm_switched: Flag
    """The bandit chose another hypothesis than before."""
    unstable: Flag
    """The object touches something and would tip: its centre of mass is outside its support after the simulation."""
    physics_worse: Flag
    """The simulated pose scores at least 0.2 less than the pose it began with."""
    empty_render: Flag
    """A pose rendered to nothing, or its score was not a number."""
    waiting: ThresholdSection
    """Thresholds of breakpoints that are off, saved by the page for when they are switched on."""


class RecordingSection(TypedDict, total=False):
    """Rerun recordings."""

    keep: Literal["all", "failures", "none", "sample"]
    """Which frames of a batch keep their recording (about 3 MB each); failures: final error above 10 % of the diameter,
    or no answer; sample: all of up to 200 frames, of more the failures and about 200 others. `replay RUN --draw` makes
    any recording from its run file.
    """
    maps: Flag
    """Log depth and score maps of every iteration (about 0.05 MB each), else numbers and poses only."""


class EditSection(TypedDict, total=False):
    """An edited pose."""

    after_iteration: Required[Whole]
    """The iteration after which it was edited; 0 = before the first."""
    instance: Required[Whole]
    """instance_id."""
    hypothesis: Required[Whole]
    """Index of the hypothesis, from 0."""
    T_cam_obj: Required[Numbers]
    """The new pose, row by row [m]."""
    frame: str
    """The frame in which it was edited, as "scene/image"; "" = every frame that has the hypothesis."""


class TrackedPoseSection(TypedDict, total=False):
    """The answer of an earlier frame as an initial pose of a later one."""

    frame: Required[str]
    """The later frame, as "scene/image"."""
    instance: Required[Whole]
    """instance_id there."""
    T_cam_obj: Required[Numbers]
    """The pose in the later frame, row by row [m]."""
    answered_in: Required[str]
    """The earlier frame."""


class StartPoseSection(TypedDict, total=False):
    """A pose that is an object's only hypothesis."""

    frame: Required[str]
    """The frame, as "scene/image"."""
    instance: Required[Whole]
    """instance_id."""
    T_cam_obj: Required[Numbers]
    """The pose, row by row [m]."""


class ChangeSection(TypedDict, total=False):
    """Settings that were changed in the middle of a run."""

    after_iteration: Required[Whole]
    """The iteration after which they hold; 0 = before the first."""
    settings: Required[Mapping[str, Mapping[str, Any]]]
    """Changed fields by section: {"method": {"exploration": 0.2}}; sections of `DURING_A_RUN`."""


class OtherSections(TypedDict, total=False):
    """Settings beside those that `solve` has arguments for."""

    title: str
    """Shown on the page and in recordings."""
    scene: SceneSection
    data: DataSection
    hypotheses: HypothesesSection
    icp: IcpSection
    tricp: TricpSection
    depth_net: DepthNetSection
    densefusion: DenseFusionSection
    mcts: MctsSection
    dependency: DependencySection
    ppf: PpfSection
    pcs: PcsSection
    score: ScoreSection
    physics: PhysicsSection
    grasp: GraspSection
    breakpoints: BreakpointSection
    recording: RecordingSection
    edits: Sequence[EditSection]
    """Edited poses, so that a saved session repeats them."""
    tracked: Sequence[TrackedPoseSection]
    """With `method.track`, the poses with which frames of this run began, so that a recording or a saved session
    repeats them without solving the frames before.
    """
    starts: Sequence[StartPoseSection]
    """Poses with which objects begin in place of `[hypotheses]`, one per object, so that a saved session repeats what
    "Refine this pose" of the page began.
    """
    changes: Sequence[ChangeSection]
    """Settings changed during the run, so that a saved session repeats them."""


class Sections(OtherSections, total=False):
    """All settings that define a run."""

    preset: Literal["paper", "published", "recommended"]
    """recommended: the choices that are right most often on real frames; colour and flips only with its own refiner.
    paper: every choice of the paper's text, and its budget for the refiner. published: the choices of the authors'
    public code. Fields given explicitly win over it. docs/methods.md 1.8.
    """
    method: MethodSection
