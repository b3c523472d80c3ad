"""Built-in scenes: problems that need no data, made by our own physics, renderer and depth sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis, Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.observation.observed_frame import observe
from verefine_viz.scenes.demo_layout import CAMERA, DemoScene, OwnPoses, Picture, prepare, settled, take_picture
from verefine_viz.scenes.demo_models import demo_model, demo_obj_id
from verefine_viz.scenes.demo_scenes import FAILURES, SCENES
from verefine_viz.scenes.hypothesis_pool import pools_of_frame, results_of
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
        settings: seed, masks, objects, turned, gravity and cloud sizes; the rest does not concern built-in scenes.
        hypotheses: where initial poses come from. A scene about bad initial poses brings its own, which a note of the
            problem names; results files and estimators win over both.
        frame: one of :func:`demo_frames`.
        progress: checked on the way; objects fall into their places when a scene is first made.

    Raises:
        InputError: no such scene or frame, none of the wanted objects is in it, or a results file cannot be read.
        SettingsError: ``masks`` is a file.
        Cancelled: ``progress`` was cancelled.
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
    seen = take_picture(_visible_scene(scene, placed, settings), T_world_cam) if looks_through else colors
    depth_m = sense(seen.depth_m, seen.normals_cam, CAMERA, (settings.seed, view))
    if scene.blind is not None:
        points = CAMERA.back_project(seen.depth_m)
        points_world = apply(T_world_cam, points.reshape(-1, 3)).reshape(points.shape)
        depth_m = np.where(scene.blind(seen.labels, points_world), np.float32(0), depth_m)

    progress.checkpoint()
    segments = _segments(scene, placed, seen, settings)
    observation = observe(
        CAMERA, depth_m, colors.rgb, [s.mask for s in segments], settings, T_world_cam[:3, :3], T_world_cam
    )
    wanted = [s for s in segments if not settings.objects or s.obj_id in settings.objects]
    if not wanted:
        there = sorted({s.obj_id for s in segments})
        raise InputError(f"frame {frame} of {name!r}: {unknown('object', settings.objects[0], there)}")
    models = {p.model.obj_id: p.model for p in placed}
    own_poses = _own_poses(scene, hypotheses)
    if own_poses is not None:
        pools = _own_pools(own_poses, segments, T_world_cam, hypotheses, view)
    else:
        pools = pools_of_frame(results_of(hypotheses), (0, view), segments, models, CAMERA, hypotheses)
    instances = tuple(s.instance(depth_m, CAMERA, pools[s.instance_id], settings) for s in wanted)
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
    models = [_model(item.model, settings) for item in scene.items]
    prepare(scene.items, progress)
    progress.checkpoint("Letting the objects of the scene fall into their places.")
    poses = settled(scene.items, settings.turned)
    return [Placed(k, m, T_cam_world @ T) for k, (m, T) in enumerate(zip(models, poses, strict=True))]


def _model(name: str, settings: SceneSettings) -> ObjectModel:
    return demo_model(name, settings.model_points, settings.seed, settings.model_sampling)


def _visible_scene(scene: DemoScene, placed: Sequence[Placed], settings: SceneSettings) -> list[Placed]:
    """The scene without the parts that the depth sensor and the detector look through."""
    names = [item.seen_as or item.model for item in scene.items]
    models = [_model(name, settings) for name in names]
    return [Placed(p.instance_id, m, p.T_cam_obj) for p, m in zip(placed, models, strict=True)]


def _segments(
    scene: DemoScene, placed: Sequence[Placed], picture: Picture, settings: SceneSettings
) -> tuple[Segment, ...]:
    """The instances that are asked for, with their masks: perfect ones, or leaking where the scene has it so."""
    segments = []
    for k, (item, p) in enumerate(zip(scene.items, placed, strict=True)):
        visible = picture.labels == k
        if not item.is_asked_for or not visible.any():
            continue
        full = silhouette(p.model, p.T_cam_obj, CAMERA)
        seen = visible | (picture.labels == scene.leaks[k]) if k in scene.leaks else visible
        mask = full if settings.masks == "mask" else seen
        segments.append(Segment(k, p.model.obj_id, mask, p.T_cam_obj, float(visible.sum() / max(full.sum(), 1))))
    return tuple(segments)


def _own_poses(scene: DemoScene, hypotheses: HypothesesSettings) -> OwnPoses | None:
    """How the scene makes initial poses; None where they come from elsewhere."""
    return scene.initial_poses if hypotheses.source == "perturb" else None


def _own_pools(
    own_poses: OwnPoses, segments: Sequence[Segment], T_world_cam: Float, hypotheses: HypothesesSettings, view: int
) -> dict[int, tuple[Hypothesis, ...]]:
    """The hypotheses of every instance, by instance_id."""
    T_cam_world = inverse(T_world_cam)
    pools: dict[int, tuple[Hypothesis, ...]] = {}
    for s in segments:
        assert s.T_cam_obj_gt is not None
        rng = np.random.default_rng((hypotheses.seed, 0, view, s.instance_id))
        poses = own_poses(T_world_cam @ s.T_cam_obj_gt, T_world_cam, rng)[: hypotheses.max_per_object]
        # A source says nothing about the pose: what is wrong is for the user to see.
        pools[s.instance_id] = tuple(
            Hypothesis(T_cam_world @ T, 1.0 - 0.01 * k, "estimator") for k, T in enumerate(poses)
        )
    return pools


def _notes(scene: DemoScene, hypotheses: HypothesesSettings) -> tuple[str, ...]:
    standard = HypothesesSettings()
    asked = (hypotheses.rotation_deg, hypotheses.translation_mm) != (standard.rotation_deg, standard.translation_mm)
    if not asked or _own_poses(scene, hypotheses) is None:
        return ()
    return ("the initial poses belong to this scene; hypotheses.rotation_deg and translation_mm do not change them",)
