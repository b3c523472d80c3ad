"""Which faults of camera, depth, models and poses the checks of the data name, and how often they cry wolf.

    python -m bench.data_faults [--data ../shared/data] [--made-up 150] [--every 4]

puts faults into frames (real ones of YCB-V and LM where ``--data`` has them, built-in scenes, made-up tables) and
prints the table of docs/decisions/data-checks.md: a check stays if it names at least 60 % of the faults it is for and
warns in at most 2 % of the clean frames; ``bench.right_data`` has right data of many kinds. Displaced colour images are
for frames with two or more printed objects only, so that models with textures are needed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.calibration.right_variants import estimated, off
from tests.made_up_frames import SETTINGS, Thing, frame_of, model, standing
from verefine_viz.calibration.camera_check import estimate_doubts, outline_fits, verdict
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.registration import FEWEST, colour_fits, registration_doubts
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import TO_OPENGL
from verefine_viz.core.doubt import DoubtKind
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.diagnosis.data_doubts import plane_doubts
from verefine_viz.diagnosis.frame_ground_truth import FrameGroundTruth
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo import demo_frames, demo_names, demo_problem
from verefine_viz.scenes.demo_layout import Viewpoint
from verefine_viz.scenes.hypothesis_pool import perturbed
from verefine_viz.scenes.sensor import STEREO, Sensor
from verefine_viz.scenes.source import open_scene

Fault = Callable[[Problem], Problem]
Check = Callable[[Problem], bool]
RIGHT_SCENES = ("clutter", "mug", "stack", "bowl", "duck", "bracket")
NAMES = ("can", "mug", "duck", "jug", "carton", "block", "bottle", "bracket")


CAMERA = Camera(np.array([[570.0, 0, 319.5], [0, 570.0, 239.5], [0, 0, 1]]), 640, 480)


def made_up(seed: int, camera: Camera = CAMERA, sensor: Sensor = STEREO) -> Problem:
    """Three to six objects on a table."""
    rng = np.random.default_rng(seed)
    n, turn, things = int(rng.integers(3, 7)), rng.uniform(0, 2 * np.pi), []
    for k, name in enumerate(rng.choice(NAMES, n, replace=False)):
        m, around = model(str(name)), turn + 2 * np.pi * k / n
        T = standing(m, rng, 0.01)
        T[:2, 3] += rng.uniform(0.09, 0.14) * np.array([np.cos(around), np.sin(around)])
        things.append(Thing(m, T))
    view = Viewpoint(rng.uniform(-180, 180), rng.uniform(30, 60), rng.uniform(0.55, 0.75))
    return frame_of(things, rng, view, camera=camera, sensor=sensor)


def held_out(k: int) -> Problem:
    """A frame that no threshold was set on: other seeds, cameras and sensors; every third has colour."""
    if k % 3 == 0:
        name = RIGHT_SCENES[k // 3 % len(RIGHT_SCENES)]
        frames = demo_frames(name)
        return demo_problem(name, SceneSettings(seed=5000 + k), HypothesesSettings(), frames[k % len(frames)])
    rng = np.random.default_rng(5000 + k)
    width, height = ((640, 480), (848, 480), (480, 360), (1280, 720))[k % 4]
    f = width * rng.uniform(0.7, 1.4)
    cx, cy = (size / 2 + rng.uniform(-0.04, 0.04) * size for size in (width, height))
    camera = Camera(np.array([[f, 0, cx], [0, f * rng.uniform(0.99, 1.01), cy], [0, 0, 1]]), width, height)
    noise_px, dropout = float(rng.uniform(0.02, 0.2)), float(rng.uniform(0.2, 0.9))
    sensor = Sensor(float(rng.uniform(0.03, 0.1)), noise_px, float(rng.uniform(0, 3)), edge_dropout=dropout)
    return made_up(5000 + k, camera, sensor)


def wide(seed: int) -> Problem:
    """Four objects at the edge of the image of a wide lens."""
    camera = Camera(np.array([[280.0, 0, 319.5], [0, 280.0, 239.5], [0, 0, 1]]), 640, 480)
    rng, things = np.random.default_rng(seed), []
    for k, name in enumerate(rng.permutation(("jug", "carton", "block", "bottle", "can", "mug"))[:4]):
        m = model(str(name))
        T = standing(m, rng, 0.01)
        T[:2, 3] += 0.32 * np.array([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)])
        things.append(Thing(m, T))
    view = Viewpoint(float(rng.uniform(-180, 180)), float(rng.uniform(40, 70)), 0.6)
    return frame_of(things, rng, view, camera=camera)


def clean_frames(data: Path, n_made_up: int) -> Iterator[Problem]:
    """With ground truth, and nothing wrong."""
    for folder in ("ycbv", "lm"):
        if (data / folder).is_dir():
            source = open_scene(
                SceneSettings(source="bop", dataset=str((data / folder).resolve())), HypothesesSettings()
            )
            yield from map(source.problem, source.frames)
    for name in demo_names():
        for frame in demo_frames(name):
            yield demo_problem(name, SceneSettings(), HypothesesSettings(), frame)
    yield from map(made_up, range(n_made_up))


def measured(problem: Problem, camera: Camera | None = None, depth: Float | None = None) -> Problem:
    """The frame with another camera or depth image, and the clouds of its objects that follow from it."""
    seen = problem.observation
    camera, depth_m = camera or seen.camera, (seen.depth_m if depth is None else depth).astype(np.float32)
    clouds = [segment_cloud(depth_m, camera, i.mask, SETTINGS.cloud_points, 0) for i in problem.instances]
    instances = tuple(replace(i, points_cam=cloud) for i, cloud in zip(problem.instances, clouds, strict=True))
    return replace(problem, observation=replace(seen, camera=camera, depth_m=depth_m), instances=instances)


def camera(fx: float = 1.0, fy: float = 1.0, dx: float = 0.0, dy: float = 0.0, image: float = 1.0) -> Fault:
    """cam_K with other focal lengths, principal point [px of an image 640 wide], or of an image of another size."""

    def fault(problem: Problem) -> Problem:
        c = problem.observation.camera
        unit = c.width / 640
        K = np.diag([image, image, 1.0]) @ (c.K * [[fx, 1, 1], [1, fy, 1], [1, 1, 1]])
        K[:2, 2] += [dx * unit, dy * unit]
        return measured(problem, Camera(K, c.width, c.height))

    return fault


def depth(times: float = 1.0, right_px: int = 0) -> Fault:
    """Depth of another scale, or moved beside the colour image."""
    return lambda p: measured(p, depth=times * np.roll(p.observation.depth_m.astype(np.float64), right_px, axis=1))


def colour(right_px: int, down_px: int) -> Fault:
    """The colour image displaced."""

    def fault(p: Problem) -> Problem:
        rgb = p.observation.rgb
        assert rgb is not None
        return replace(p, observation=replace(p.observation, rgb=np.roll(rgb, (down_px, right_px), axis=(0, 1))))

    return fault


def truth_by(change: Callable[[Float], Float]) -> Fault:
    """Other ground-truth poses (4, 4)."""

    def changed(i: Instance) -> Instance:
        return i if i.T_cam_obj_gt is None else replace(i, T_cam_obj_gt=change(i.T_cam_obj_gt))

    return lambda p: replace(p, instances=tuple(changed(i) for i in p.instances))


def truth(times: float) -> Fault:
    """cam_t_m2c multiplied."""
    return truth_by(lambda T: transform(T[:3, :3], times * T[:3, 3]))


def inverted_masks(p: Problem) -> Problem:
    """Masks of everything but the objects."""
    return replace(p, instances=tuple(replace(i, mask=~i.mask) for i in p.instances))


def distances(p: Problem) -> Problem:
    """Depth images of distances from the camera."""
    rays = p.observation.camera.back_project(np.ones(p.observation.camera.shape))
    return measured(p, depth=p.observation.depth_m * np.linalg.norm(rays, axis=-1))


def in_8_bits(p: Problem) -> Problem:
    """Depth in 255 steps."""
    depth_m = p.observation.depth_m.astype(np.float64)
    return measured(p, depth=np.round(depth_m / depth_m.max() * 255) * depth_m.max() / 255)


def models(times: float) -> Fault:
    """Models of another size."""

    def resized(p: Problem) -> Problem:
        made = {
            k: replace(m, vertices=m.vertices * times, points=m.points * times, diameter_m=m.diameter_m * times)
            for k, m in p.models.items()
        }
        return replace(p, models=made)

    return resized


def masks(right_px: int) -> Fault:
    """All masks displaced."""

    def displaced(p: Problem) -> Problem:
        rolled = tuple(replace(i, mask=np.roll(i.mask, right_px, axis=1)) for i in p.instances)
        union = np.any([i.mask for i in rolled], axis=0)
        return measured(replace(p, instances=rolled, observation=replace(p.observation, object_mask=union)))

    return displaced


def plane(up_mm: float) -> Fault:
    """The support plane at another height."""

    def moved(p: Problem) -> Problem:
        support = p.observation.support
        if support is None:
            return p
        T = np.array(support.T_world_cam)
        T[:3, 3] -= 1e-3 * up_mm * support.normal_world
        return replace(p, observation=replace(p.observation, support=replace(support, T_world_cam=T)))

    return moved


def initial_poses(times: float = 1.0) -> Fault:
    """Initial poses 15° and 15 mm off, their translations multiplied."""

    def one(i: Instance, p: Problem) -> Instance:
        if i.T_cam_obj_gt is None:
            return i
        (h,) = perturbed(i.T_cam_obj_gt, 1, 15, 15, (p.scene_id, p.im_id, i.instance_id))
        T = transform(h.T_cam_obj[:3, :3], times * h.T_cam_obj[:3, 3])
        return replace(i, hypotheses=(replace(h, T_cam_obj=T, source="est"),))

    return lambda p: replace(p, instances=tuple(one(i, p) for i in p.instances))


def has_cause(*causes: str) -> Check:
    """Whether sizes and places in ground-truth poses show one of these causes, or any at all where none is given."""

    def check(p: Problem) -> bool:
        known = [(p.models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in p.instances if i.T_cam_obj_gt is not None]
        seen = p.observation
        found = verdict(outline_fits(known, seen.camera, seen.depth_m, seen.object_mask))
        return bool(found.advice) and (not causes or found.cause in causes)

    return check


def is_elsewhere(p: Problem) -> bool:
    """Whether depth does not lie at the ground-truth poses."""
    return bool(data_doubts(p))


def says(words: str) -> Check:
    """Whether a doubt names what would fit."""
    return lambda p: any(words in doubt.text for doubt in data_doubts(p))


def is_not_registered(p: Problem) -> bool:
    """Whether a diagnosis calls depth shifted or scaled."""
    return FrameGroundTruth(p).registration.is_off


def is_colour_displaced(p: Problem) -> bool:
    """Whether colours of the models in their ground-truth poses lie elsewhere in the image."""
    return bool(registration_doubts(p, [t.instance.T_cam_obj_gt for t in p.targets]))


def has_prints(p: Problem) -> bool:
    """Whether the check of the colour image has evidence in this frame."""
    return len(colour_fits(p, [t.instance.T_cam_obj_gt for t in p.targets])) >= FEWEST


def is_in_centimetres(p: Problem) -> bool:
    """Whether translations of initial poses are doubted."""
    return any(doubt.kind == DoubtKind.POSE_SCALE for doubt in data_doubts(p))


def is_far_from_initial_poses(p: Problem) -> bool:
    """Whether initial poses doubt depth_scale, where no truth is known."""
    blind = tuple(replace(i, T_cam_obj_gt=None) for i in initial_poses()(p).instances)
    return bool(estimate_doubts(replace(p, instances=blind)))


def without_truth(*words: str) -> Check:
    """Whether a doubt names it where there are poses of an estimator alone, 3° and 3 mm off, if not off already."""

    def check(p: Problem) -> bool:
        blind = estimated(p, off(np.random.default_rng(p.im_id), 3, 3))
        return any(all(word in doubt.text for word in words) for doubt in data_doubts(blind))

    return check


def mirrored(p: Problem) -> Problem:
    """The colour image mirrored."""
    rgb = p.observation.rgb
    assert rgb is not None
    return replace(p, observation=replace(p.observation, rgb=np.ascontiguousarray(rgb[:, ::-1])))


def masks_by(change: Callable[[Mask, Mask], Mask]) -> Fault:
    """Other masks, of a mask and the union of all."""
    return lambda p: replace(
        p, instances=tuple(replace(i, mask=change(i.mask, p.observation.object_mask)) for i in p.instances)
    )


def transposed(T: Float) -> Float:
    """The pose with its rotation written column by column."""
    return transform(T[:3, :3].T, T[:3, 3])


BOX = Toolbox(resolve({"method": {"name": "rir", "refiner": "icp", "iterations": 3}, "physics": {"enabled": False}}))


def is_off_the_plane(p: Problem) -> bool:
    """Whether the answers of a run doubt the support plane."""
    best = BOX.run(initial_poses()(p)).finish().best
    return bool(plane_doubts(p, [b and b.T_cam_obj for b in best]))


Y_UP = transform(axis_angle(np.array([1.0, 0.0, 0.0]), np.pi / 2), np.zeros(3))
NEAR, FAR = (0.8, 0.9, 1.1, 1.2), (0.001, 0.1, 10.0, 1000.0)
CHECKS: tuple[tuple[str, Check, tuple[Fault, ...]], ...] = (
    ("fx and fy of cam_K", has_cause("focal length", "focal length or models"), tuple(camera(f, f) for f in NEAR)),
    (
        "fx or fy alone",
        has_cause("one focal length"),
        (*(camera(fx=f) for f in NEAR), camera(fy=0.8), camera(fy=1.2)),
    ),
    ("cx or cy", has_cause("principal point"), (camera(dx=-40), camera(dx=20), camera(dy=-20), camera(dy=40))),
    ("cam_K of another image size", has_cause("image"), tuple(camera(image=f) for f in (0.5, 0.8, 1.25, 2.0))),
    ("size of models", has_cause("models", "focal length or models"), tuple(models(f) for f in NEAR)),
    ("distance of ground-truth poses", has_cause("distances"), (truth(0.8), truth(1.2))),
    ("masks displaced", has_cause("masks"), (masks(-30), masks(15))),
    ("depth_scale, by ground-truth poses", has_cause("depth"), tuple(depth(f) for f in NEAR)),
    (
        "units of depth or ground-truth poses",
        is_elsewhere,
        tuple(depth(f) for f in (0.1, 0.5, 2.0, 10.0)) + tuple(truth(f) for f in FAR),
    ),
    ("models in another unit", says("models that are"), tuple(models(f) for f in FAR)),
    ("inverse poses", says("the inverse poses"), (truth_by(inverse),)),
    ("poses in OpenGL's axes", says("OpenGL"), (truth_by(lambda T: TO_OPENGL @ T),)),
    ("rotations by columns", says("transposed"), (truth_by(transposed),)),
    ("models Y-up", says("about x would fit"), (truth_by(lambda T: T @ Y_UP), truth_by(lambda T: T @ Y_UP.T))),
    ("masks inverted", says("inverted masks"), (inverted_masks,)),
    ("depth of 8 bits", says("8 bits"), (in_8_bits,)),
    ("depth beside colour (diagnosis)", is_not_registered, (depth(right_px=-30), depth(right_px=15))),
    ("results file in centimetres", is_in_centimetres, (initial_poses(0.1),)),
    ("depth_scale, by initial poses", is_far_from_initial_poses, tuple(depth(f) for f in (0.5, *NEAR, 2.0))),
    (
        "depth_scale, without truth",
        without_truth("depth"),
        tuple(depth(f) for f in (0.8, 1.25, 4.0, 5.0, 39.37, 0.1, 10.0)),
    ),
    (
        "cam_K of another camera, without truth",
        without_truth("cam_K"),
        (camera(0.63, 0.63), camera(image=0.5), camera(image=2.0)),
    ),
    ("translations of initial poses, without truth", without_truth("translations"), (truth(0.8), truth(1.25))),
    ("size of models, without truth", without_truth("models"), (models(0.8), models(1.25), models(1.5))),
    ("depth beside colour, without truth", without_truth("depth lies"), (depth(right_px=25), depth(right_px=-30))),
    ("transposed rotations, without truth", without_truth("transposed"), (truth_by(transposed),)),
    (
        "masks of all objects or everything, without truth",
        without_truth("mask", "the model is"),
        (masks_by(lambda mask, union: union), masks_by(lambda mask, union: np.ones_like(mask))),
    ),
    ("height of the support plane, by answers", is_off_the_plane, (plane(30), plane(-60))),
)
"""What may be off, whether a check names it, and the faults that are put in."""


def print_row(name: str, check: Check, faults: Sequence[Fault], clean: list[Problem], faulty: list[Problem]) -> None:
    """How many faults are named, put into ``faulty`` frames, and how often the check warns of ``clean`` ones."""
    n_false = sum(check(p) for p in clean)
    named = [check(fault(p)) for fault in faults for p in faulty]
    shares = f"{sum(named)}/{len(named)} = {np.mean(named):.0%} | {n_false}/{len(clean)} = {n_false / len(clean):.1%}"
    print(f"| {name} | {shares} |", flush=True)


def main() -> int:
    """Prints a row per check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--made-up", type=int, default=150, help="frames")
    parser.add_argument("--every", type=int, default=4, help="faults are put into every so many frames")
    arguments = parser.parse_args()
    frames = list(clean_frames(arguments.data, arguments.made_up))
    print("| what is off | named | false alarms |\n|---|---|---|")
    for name, check, faults in CHECKS:
        print_row(name, check, faults, frames, frames[:: arguments.every])
    seen_wide = [wide(seed) for seed in range(arguments.made_up * 4 // 15)]
    print_row("distances in place of depth", says("seem to hold distances"), (distances,), seen_wide, seen_wide)
    coloured = [p for p in frames if p.observation.rgb is not None]
    print_row("colour image mirrored, without truth", without_truth("mirrored"), (mirrored,), coloured, coloured)
    printed = [p for p in frames if has_prints(p)]
    if printed:
        displaced = tuple(colour(*by) for by in ((4, 0), (-3, 2), (0, -5)))
        print_row("colour image beside depth", is_colour_displaced, displaced, printed, printed)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
