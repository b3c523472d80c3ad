"""Built-in scenes: problems that need no data, made by our own physics, renderer and depth sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.problem import Hypothesis, Instance, Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.observation.observed_frame import observe, segment_cloud
from verefine_viz.scenes.demo_layout import CAMERA, DemoScene, MaskFault, Picture, prepare, settled, take_picture
from verefine_viz.scenes.demo_models import demo_model, demo_obj_id
from verefine_viz.scenes.demo_scenes import FAILURES, SCENES
from verefine_viz.scenes.hypothesis_pool import perturbed, pools_of_object, results_of
from verefine_viz.scenes.segments import Segment, silhouette
from verefine_viz.scenes.sensor import sense

_ALL: dict[str, DemoScene] = {**SCENES, **FAILURES}


def demo_names() -> tuple[str, ...]:
    """All built-in scenes, the default first."""
    return tuple(_ALL)


def demo_frames(name: str) -> tuple[str, ...]:
    """The frames of a built-in scene, ``scene/image``: one per viewpoint.

    Raises:
        InputError: there is no such scene.
    """
    return tuple(f"0/{k}" for k in range(len(_scene(name).views)))


def demo_objects(name: str) -> dict[int, str]:
    """The objects of a built-in scene whose pose is asked for: id → name.

    Raises:
        InputError: there is no such scene.
    """
    return {demo_obj_id(item.model): item.model for item in _scene(name).items if item.is_asked_for}


def demo_problem(
    name: str,
    settings: SceneSettings,
    hypotheses: HypothesesSettings,
    frame: str = "0/0",
    progress: ProgressToken = NEVER_CANCELLED,
) -> Problem:
    """A frame of a built-in scene.

    Args:
        name: one of :func:`demo_names`.
        settings: seed, masks, objects, gravity and cloud sizes; the rest does not concern built-in scenes.
        hypotheses: where initial poses come from. A scene about bad initial poses brings its own, and says so in the
            problem's notes; results files win over both.
        frame: one of :func:`demo_frames`.
        progress: asked on the way; objects fall into their places when a scene is first made.

    Raises:
        InputError: no such scene or frame, none of the wanted objects is in it, or a results file cannot be read.
        SettingsError: ``masks`` is a file.
        Cancelled: nobody waits for it any more.
    """
    scene = _scene(name)
    if frame not in demo_frames(name):
        raise InputError(unknown("frame", frame, demo_frames(name)))
    if settings.masks not in ("mask_visib", "mask"):
        raise SettingsError(
            f"scene.masks is {settings.masks!r}; a built-in scene has 'mask_visib' and 'mask' only "
            '(or set scene.source to "bop")'
        )
    view = int(frame.split("/")[1])
    T_world_cam = scene.views[view].T_world_cam
    placed = _placed(scene, T_world_cam, settings, progress)
    progress.checkpoint("Taking the picture of the scene.")
    colors = take_picture(placed, T_world_cam)
    looks_through = any(item.seen_as for item in scene.items)
    seen = take_picture(_as_seen(scene, placed, settings), T_world_cam) if looks_through else colors
    depth_m = sense(seen.depth_m, seen.normals_cam, CAMERA, scene.sensor, (settings.seed, view))
    if scene.blind is not None:
        points = CAMERA.back_project(seen.depth_m)
        points_world = apply(T_world_cam, points.reshape(-1, 3)).reshape(points.shape)
        depth_m = np.where(scene.blind(seen.labels, points_world), np.float32(0), depth_m)

    progress.checkpoint()
    segments = _segments(scene, placed, seen, settings)
    observation = observe(
        CAMERA, depth_m, colors.rgb, [s.mask for s in segments], settings, R_world_cam=T_world_cam[:3, :3]
    )
    wanted = [s for s in segments if not settings.objects or s.obj_id in settings.objects]
    if not wanted:
        there = sorted({s.obj_id for s in segments})
        raise InputError(f"frame {frame} of {name!r}: {unknown('object', settings.objects[0], there)}")
    models = {p.model.obj_id: p.model for p in placed}
    pools = _pools(scene, segments, placed, T_world_cam, hypotheses, view)
    instances = tuple(
        Instance(
            s.instance_id,
            s.obj_id,
            s.mask,
            segment_cloud(depth_m, CAMERA, s.mask, settings.cloud_points, settings.seed),
            pools[s.instance_id],
            s.T_cam_obj_gt,
            s.visib_fract,
        )
        for s in wanted
    )
    used = {i.obj_id for i in instances}
    return Problem(
        0,
        view,
        observation,
        {obj_id: model for obj_id, model in models.items() if obj_id in used},
        instances,
        scene.title,
        _notes(scene, hypotheses),
    )


def _scene(name: str) -> DemoScene:
    if name not in _ALL:
        raise InputError(unknown("demo scene", name, _ALL))
    return _ALL[name]


def _placed(scene: DemoScene, T_world_cam: Float, settings: SceneSettings, progress: ProgressToken) -> list[Placed]:
    T_cam_world = inverse(T_world_cam)
    models = [demo_model(item.model, settings.model_points, settings.seed) for item in scene.items]
    prepare(scene.items, progress)
    progress.checkpoint("Letting the objects of the scene fall into their places.")
    poses = settled(scene.items)
    return [Placed(k, m, T_cam_world @ T) for k, (m, T) in enumerate(zip(models, poses, strict=True))]


def _as_seen(scene: DemoScene, placed: Sequence[Placed], settings: SceneSettings) -> list[Placed]:
    """The same scene with the parts left out that the depth sensor and the detector look through."""
    names = [item.seen_as or item.model for item in scene.items]
    models = [demo_model(name, settings.model_points, settings.seed) for name in names]
    return [Placed(p.instance_id, m, p.T_cam_obj) for p, m in zip(placed, models, strict=True)]


def _segments(
    scene: DemoScene, placed: Sequence[Placed], picture: Picture, settings: SceneSettings
) -> tuple[Segment, ...]:
    """The instances that somebody asks for, with their masks: perfect ones, or faulty where the scene says so."""
    found = []
    for k, (item, p) in enumerate(zip(scene.items, placed, strict=True)):
        visible = picture.labels == k
        if not item.is_asked_for or not visible.any():
            continue
        full = silhouette(p.model, p.T_cam_obj, CAMERA)
        mask = full if settings.masks == "mask" else _faulty(k, picture, scene.mask_faults.get(k, MaskFault()))
        found.append(Segment(k, p.model.obj_id, mask, p.T_cam_obj, float(visible.sum() / max(full.sum(), 1))))
    return tuple(found)


def _faulty(k: int, picture: Picture, fault: MaskFault) -> Mask:
    """The visible pixels of an item, as a detector with this fault would give them."""
    mask: Mask = picture.labels == k
    if fault.leaks_onto is not None:
        mask = mask | (picture.labels == fault.leaks_onto)
    if fault.grow_px > 0:
        mask = np.asarray(binary_dilation(mask, iterations=fault.grow_px), dtype=bool)
    if fault.grow_px < 0:
        mask = np.asarray(binary_erosion(mask, iterations=-fault.grow_px), dtype=bool)
    return mask


def _pools(
    scene: DemoScene,
    segments: Sequence[Segment],
    placed: Sequence[Placed],
    T_world_cam: Float,
    settings: HypothesesSettings,
    view: int,
) -> dict[int, tuple[Hypothesis, ...]]:
    """The hypotheses of every instance, by instance_id."""
    if settings.source == "results":
        files = results_of(settings)
        pools: dict[int, tuple[Hypothesis, ...]] = {}
        for model in {p.model.obj_id: p.model for p in placed}.values():
            mine = [s for s in segments if s.obj_id == model.obj_id]
            found = pools_of_object(files, 0, view, mine, model, CAMERA, settings.max_per_object)
            pools |= {s.instance_id: pool for s, pool in zip(mine, found, strict=True)}
        return pools
    if settings.source != "perturb":  # An estimator looks for them, once the frame is there.
        return {s.instance_id: () for s in segments}
    return {s.instance_id: _initial_poses(scene, placed[s.instance_id], T_world_cam, settings, view) for s in segments}


def _initial_poses(
    scene: DemoScene, truth: Placed, T_world_cam: Float, settings: HypothesesSettings, view: int
) -> tuple[Hypothesis, ...]:
    n, seed = settings.max_per_object, (settings.seed, 0, view, truth.instance_id)
    if scene.initial_poses is None:
        return perturbed(truth.T_cam_obj, n, settings.rotation_deg, settings.translation_mm, seed)
    T_cam_world = inverse(T_world_cam)
    poses = scene.initial_poses(T_world_cam @ truth.T_cam_obj, T_world_cam, np.random.default_rng(seed))
    return tuple(Hypothesis(T_cam_world @ T, 1.0 - 0.01 * k, text) for k, (T, text) in enumerate(poses[:n]))


def _notes(scene: DemoScene, settings: HypothesesSettings) -> tuple[str, ...]:
    notes = [scene.note] if scene.note else []
    if scene.initial_poses is not None and settings.source == "perturb":
        notes.append(
            "the initial poses belong to this scene; hypotheses.rotation_deg and translation_mm do not change them"
        )
    return tuple(notes)
