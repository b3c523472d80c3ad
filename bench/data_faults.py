"""Which faults of camera, depth, models and poses the checks of the data name, and how often they cry wolf.

    python -m bench.data_faults [--data ../shared/data] [--made-up 150] [--runs 40]

puts every fault into every frame (real ones of YCB-V and LM where ``--data`` has them, built-in scenes, and made-up
tables) and prints the table of docs/decisions/data-checks.md: a check stays if it names at least 60 % of the faults it
is for and warns in at most 2 % of the clean frames. ``--runs`` made-up frames are used where a run has to be made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from verefine_viz.scenes.answer_fit import _size_notes
from verefine_viz.scenes.first_fit import depth_notes, pull_notes
from verefine_viz.scenes.fit import pose_notes, truth_notes
from verefine_viz.scenes.plane_gaps import plane_notes
from verefine_viz.scenes.size_fit import size_verdict, witnesses

from bench.made_up_frames import SETTINGS, Thing, frame_of, model, standing
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.diagnosis.truth import FrameTruth
from verefine_viz.observation.frame import observe
from verefine_viz.observation.segment import segment_cloud
from verefine_viz.scenes.demo import demo_frames, demo_names, demo_problem
from verefine_viz.scenes.demo_view import Viewpoint
from verefine_viz.scenes.perturb import perturbed
from verefine_viz.scenes.pool import ResultsFile
from verefine_viz.scenes.source import open_scene
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

Fault = Callable[[Problem], Problem]
NAMES = ("can", "mug", "duck", "jug", "carton", "block", "bottle", "bracket")


CAMERA = Camera(np.array([[570.0, 0, 319.5], [0, 570.0, 239.5], [0, 0, 1]]), 640, 480)


def made_up(seed: int) -> Problem:
    """Three to six objects on a table."""
    rng = np.random.default_rng(seed)
    n, turn, things = int(rng.integers(3, 7)), rng.uniform(0, 2 * np.pi), []
    for k, name in enumerate(rng.choice(NAMES, n, replace=False)):
        m, around = model(str(name)), turn + 2 * np.pi * k / n
        T = standing(m, rng, 0.01)
        T[:2, 3] += rng.uniform(0.09, 0.14) * np.array([np.cos(around), np.sin(around)])
        things.append(Thing(m, T))
    view = Viewpoint(rng.uniform(-180, 180), rng.uniform(30, 60), rng.uniform(0.55, 0.75))
    return frame_of(things, rng, view, camera=CAMERA)


def clean_frames(data: Path, n_made_up: int) -> Iterator[tuple[str, Problem]]:
    """Kind and problem of every frame."""
    for folder in ("ycbv", "lm"):
        if (data / folder).is_dir():
            source = open_scene(
                SceneSettings(source="bop", dataset=str((data / folder).resolve())), HypothesesSettings()
            )
            yield from (("real", source.problem(frame)) for frame in source.frames)
    for name in demo_names():
        for frame in demo_frames(name):
            yield "built-in", demo_problem(name, SceneSettings(), HypothesesSettings(), frame)
    yield from (("made up", made_up(seed)) for seed in range(n_made_up))


def measured(problem: Problem, camera: Camera | None = None, depth: Float | None = None) -> Problem:
    """The frame with another camera or depth image, and the clouds of its objects that follow from it."""
    seen = problem.observation
    camera, depth_m = camera or seen.camera, (seen.depth_m if depth is None else depth).astype(np.float32)
    clouds = [segment_cloud(depth_m, camera, i.mask, SETTINGS.cloud_points, 0) for i in problem.instances]
    instances = tuple(replace(i, points_cam=cloud) for i, cloud in zip(problem.instances, clouds, strict=True))
    return replace(problem, observation=replace(seen, camera=camera, depth_m=depth_m), instances=instances)


def observed(problem: Problem) -> Problem:
    """With the normals and the support plane that camera and depth lead to, as a run needs them."""
    seen, scene = problem.observation, SceneSettings()
    masks = [i.mask for i in problem.instances]
    return replace(problem, observation=observe(seen.camera, seen.depth_m, seen.rgb, masks, scene))


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
    return lambda p: measured(p, depth=np.roll(p.observation.depth_m, right_px, axis=1) * times)


def truth(times: float) -> Fault:
    """cam_t_m2c multiplied."""

    def moved(i: Instance) -> Instance:
        T = i.T_cam_obj_gt
        return i if T is None else replace(i, T_cam_obj_gt=transform(T[:3, :3], times * T[:3, 3]))

    return lambda p: replace(p, instances=tuple(moved(i) for i in p.instances))


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


def plane(up_mm: float = 0.0, tilt_deg: float = 0.0) -> Fault:
    """The support plane at another height, or tilted."""

    def moved(p: Problem) -> Problem:
        support = p.observation.support
        if support is None:
            return p
        T = np.array(support.T_world_cam)
        angle = np.radians(tilt_deg)
        turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
        T = transform(turn, [0, 0, 0]) @ T
        T[:3, 3] -= 1e-3 * up_mm * support.normal_world
        return replace(p, observation=replace(p.observation, support=replace(support, T_world_cam=T)))

    return moved


def first_poses(times: float = 1.0, transposed: bool = False, deg: float = 15.0, mm: float = 15.0) -> Fault:
    """First poses near the truth; translations multiplied, or rotations transposed."""

    def given(p: Problem) -> Problem:
        def one(i: Instance) -> Instance:
            if i.T_cam_obj_gt is None:
                return i
            (h,) = perturbed(i.T_cam_obj_gt, 1, deg, mm, (p.scene_id, p.im_id, i.instance_id))
            R = h.T_cam_obj[:3, :3]
            T = transform(R.T if transposed else R, times * h.T_cam_obj[:3, 3])
            return replace(i, hypotheses=(replace(h, T_cam_obj=T, source="est"),))

        return replace(p, instances=tuple(one(i) for i in p.instances))

    return given


FOCAL = {f"fx and fy ×{f}": camera(f, f) for f in (0.8, 0.9, 1.1, 1.2)}
ONE_FOCAL = {f"fx ×{f}": camera(fx=f) for f in (0.8, 0.9, 1.1, 1.2)} | {f"fy ×{f}": camera(fy=f) for f in (0.8, 1.2)}
PLACE = {f"cx {px:+d} px": camera(dx=px) for px in (-40, 20)} | {f"cy {px:+d} px": camera(dy=px) for px in (-20, 40)}
IMAGE = {f"cam_K of an image ×{f}": camera(image=f) for f in (0.5, 0.8, 1.25, 2.0)}
MODELS = {f"models ×{f}": models(f) for f in (0.8, 0.9, 1.1)}
DISTANCES = {f"cam_t_m2c ×{f}": truth(f) for f in (0.8, 1.2)}
DEPTH = {f"depth ×{f}": depth(f) for f in (0.8, 0.9, 1.1)}
UNITS = {f"depth ×{f}": depth(f) for f in (0.1, 0.5, 2.0, 10.0)} | {
    f"cam_t_m2c ×{f}": truth(f) for f in (1e-3, 0.1, 10.0, 1e3)
}
MASKS = {f"masks {px:+d} px": masks(px) for px in (-30, 15)}
BESIDE = {f"depth {px:+d} px": depth(right_px=px) for px in (-30, 15)}
PLANE = {"plane 30 mm up": plane(30), "plane 60 mm down": plane(-60), "plane tilted 20°": plane(0, 20)}


def cause(problem: Problem) -> str:
    """What sizes and places in true poses tell."""
    seen = problem.observation
    known = [
        (problem.models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in problem.instances if i.T_cam_obj_gt is not None
    ]
    verdict = size_verdict(witnesses(known, seen.camera, seen.depth_m, seen.object_mask))
    return (verdict.cause or "") if verdict.advice else ""


def nowhere(problem: Problem) -> str:
    return "nowhere" if truth_notes(problem.instances, problem.models, Path(), False) else ""


def beside(problem: Problem) -> str:
    """What the registration of a diagnosis tells."""
    off = FrameTruth(problem).registration
    return "" if not off.is_off else "scale" if off.scale != 1 else "shift"


def poses_file(problem: Problem) -> str:
    (note,) = pose_notes((ResultsFile("est.csv", "est", {}),), problem.instances, problem.models) or ("",)
    return "centimetres" if "centimetres" in note else "transposed" if note else ""


def first_depth(problem: Problem) -> str:
    return "depth" if depth_notes(problem) else ""


def words(note: tuple[str, ...]) -> str:
    (text,) = note or ("",)
    return next((w for w in ("fx and fy", "fx of", "fy of", "cx", "cy", "plane") if w in text), text[:20])


BOX = Toolbox(resolve({"method": {"name": "rir", "iterations": 3}, "physics": {"enabled": False}}))


def after(problem: Problem) -> dict[str, str]:
    """What the checks of a run's answers tell, each for itself."""
    poses = [None if b is None else b.T_cam_obj for b in BOX.run(problem).finish().best]
    seen = problem.observation
    posed = [(t.model, T, t.instance.mask) for t, T in zip(problem.targets, poses, strict=True) if T is not None]
    looked = witnesses(posed, seen.camera, seen.depth_m, seen.object_mask)
    verdict = size_verdict(looked)
    return {
        "pull": words(pull_notes(problem, poses)),
        "sides": verdict.cause if verdict.cause == "one focal length" else "",
        "size": "fx and fy" if _size_notes(looked, verdict) else "",
        "plane": "plane" if plane_notes(problem, poses) else "",
    }
