"""Many light frames: a built-in scene, every fourth pixel of it, written out as a BOP folder over and over."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.scenes.write_bop import write_bop
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.demo import demo_frames, demo_problem

EVERY = 4
"""Pixels: 640 × 480 becomes 160 × 120."""
SESSION = """
title = "light frames"
[scene]
source = "bop"
dataset = "{dataset}"
model_points = 300
cloud_points = 200
[hypotheses]
max_per_object = 2
rotation_deg = 10.0
translation_mm = 10.0
[method]
name = "sir"
iterations = 2
[recording]
keep = "none"
"""


def write_light_frames(folder: Path, n_frames: int, demo: str = "mug") -> Path:
    """Writes the data set and a session on it; the session's path.

    Args:
        folder: new; the data set is ``folder/light``.
        n_frames: images 0, 1, 2, … of one scene; the pictures repeat, the initial poses differ from image to image.
        demo: the built-in scene.
    """
    views = [_thinned(demo_problem(demo, SceneSettings(), HypothesesSettings(), f)) for f in demo_frames(demo)]
    dataset = write_bop(folder / "light", views)
    scene = dataset / "test" / "000000"
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        entries = json.loads((scene / name).read_text())
        repeated = {str(k): entries[str(k % len(views))] for k in range(n_frames)}
        (scene / name).write_text(json.dumps(repeated))
    for kind in ("rgb", "depth", "mask", "mask_visib"):
        for first in sorted((scene / kind).iterdir()):
            for k in _repeats(int(first.name[:6]), len(views), n_frames):
                os.link(first, first.with_name(f"{k:06d}{first.name[6:]}"))
    (dataset / "test_targets_bop19.json").unlink()
    session = folder / "light.toml"
    session.write_text(SESSION.format(dataset=dataset.absolute()))
    return session


def _repeats(view: int, n_views: int, n_frames: int) -> Iterator[int]:
    return iter(range(view + n_views, n_frames, n_views))


def _thinned(problem: Problem) -> Problem:
    """The same frame with every fourth pixel: pixel (u, v) of the new camera is (4u, 4v) of the old one."""
    observation, n = problem.observation, EVERY
    camera = observation.camera
    K = np.diag([1 / n, 1 / n, 1.0]) @ camera.K
    thin = Camera(K, len(range(0, camera.width, n)), len(range(0, camera.height, n)))
    seen = replace(
        observation,
        camera=thin,
        depth_m=observation.depth_m[::n, ::n],
        normals_cam=observation.normals_cam[::n, ::n],
        rgb=None if observation.rgb is None else observation.rgb[::n, ::n],
        object_mask=observation.object_mask[::n, ::n],
    )
    instances = tuple(replace(i, mask=i.mask[::n, ::n]) for i in problem.instances)
    return replace(problem, observation=seen, instances=instances)
