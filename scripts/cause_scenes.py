"""Frames in which one thing is broken, for the causes that no built-in session shows; draw_tour.py pictures them.

Like ``verefine_viz/scenes/demo_scenes.py`` each sets up the cause, never the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import verefine_viz as vv
from verefine_viz import cli
from verefine_viz.commands.flags import given
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.causes import CAUSES, Cause
from verefine_viz.core.geometry import axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import load_session, resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes import demo
from verefine_viz.scenes.demo_layout import DemoScene, Item, OwnPoses, Viewpoint
from verefine_viz.scenes.demo_scenes import FAILURES

X, Z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])


@dataclass(frozen=True, eq=False)
class CauseScene:
    """A scene, the settings that it is solved with, and what becomes of its ground truth."""

    scene: DemoScene
    sections: Mapping[str, Any] = field(default_factory=dict)
    spoil_truth: Callable[[Float], Float | None] | None = None
    """None = it stays."""


def near(T_world_obj: Float, rng: np.random.Generator, deg: float, mm: float) -> tuple[Float, ...]:
    """Two poses that are off by so much, any way."""
    return tuple(_moved(T_world_obj, rng, deg, mm) for _ in range(2))


def _moved(T_world_obj: Float, rng: np.random.Generator, deg: float, mm: float) -> Float:
    turn = axis_angle(random_unit_vector(rng), np.deg2rad(deg))
    return transform(turn @ T_world_obj[:3, :3], T_world_obj[:3, 3] + mm * 1e-3 * random_unit_vector(rng))


def _off_by(deg: float, mm: float) -> OwnPoses:
    return lambda T_world_obj, T_world_cam, rng: near(T_world_obj, rng, deg, mm)


def _in_centimetres(T_world_obj: Float, T_world_cam: Float, rng: np.random.Generator) -> tuple[Float, ...]:
    """Good poses whose translations, in the camera's frame, are a tenth."""
    poses = (inverse(T_world_cam) @ T for T in near(T_world_obj, rng, 10, 10))
    return tuple(T_world_cam @ transform(T[:3, :3], 0.1 * T[:3, 3]) for T in poses)


def _can_at_the_duck(T_world_obj: Float, T_world_cam: Float, rng: np.random.Generator) -> tuple[Float, ...]:
    """The can, which stands on the left, is taken to be where the duck is."""
    if T_world_obj[0, 3] > 0:
        return near(T_world_obj, rng, 18, 18)
    shifts_m = ((0.110, 0.010, 0), (0.105, -0.010, 0))
    return tuple(transform(T_world_obj[:3, :3], T_world_obj[:3, 3] + shift) for shift in shifts_m)


def _rough_in_a_good_bowl(T_world_obj: Float, T_world_cam: Float, rng: np.random.Generator) -> tuple[Float, ...]:
    """Rough for the duck, which lies beside the bowl's middle."""
    return near(T_world_obj, rng, 30, 20) if T_world_obj[0, 3] > 0.004 else near(T_world_obj, rng, 6, 4)


def _handle_elsewhere(T_world_obj: Float, T_world_cam: Float, rng: np.random.Generator) -> tuple[Float, ...]:
    """Elsewhere behind the jug's body, which has 48 sides: turned by four of them it is the same."""
    turn, axis = axis_angle(Z, np.deg2rad(-30.0)), T_world_obj[:3, :3] @ np.array([-0.0251, 0, 0])
    t = T_world_obj[:3, 3] + axis - turn @ axis
    return tuple(transform(turn @ T_world_obj[:3, :3], t + 1e-3 * np.array(mm)) for mm in ((2, -1, 1), (-1, 2, 2)))


def _mirrors_but_for_an_edge(labels: NDArray[np.int32], points_world: Float) -> Mask:
    x = points_world[..., 0]
    return (labels == 0) & (x > np.quantile(x[labels == 0], 0.02))


def _mirrors(labels: NDArray[np.int32], points_world: Float) -> Mask:
    return labels == 0


MUG, DUCK = Item("mug", yaw_deg=-125), Item("duck", yaw_deg=-60)
VIEW = (Viewpoint(elevation_deg=38, distance_m=0.5),)
ICP = {"name": "rir", "refiner": "icp", "iterations": 3}
ORDER = {"order": [["#0", "#1"]]}
SCENES: dict[Cause, CauseScene] = {
    Cause.GROUND_TRUTH: CauseScene(
        DemoScene("A mug whose poses are about a mesh with y up", (MUG,), VIEW, initial_poses=_off_by(10, 10)),
        {"method": ICP}, lambda T_cam_obj_gt: T_cam_obj_gt @ transform(axis_angle(X, np.pi / 2), np.zeros(3)),
    ),
    Cause.UNIT: CauseScene(DemoScene("A duck", (DUCK,), VIEW, initial_poses=_in_centimetres), {"method": ICP}),
    Cause.DEPTH: CauseScene(
        DemoScene("A duck that mirrors", (DUCK,), VIEW, initial_poses=_off_by(20, 25), blind=_mirrors_but_for_an_edge),
        {"method": ICP},
    ),
    Cause.NEIGHBOUR: CauseScene(
        DemoScene(
            "A can that mirrors, and a duck", (Item("can", -0.06), Item("duck", 0.05, yaw_deg=-50)),
            (Viewpoint(elevation_deg=45, distance_m=0.6),), initial_poses=_can_at_the_duck, blind=_mirrors,
        ),
        {
            "method": {"name": "vf_breadth", "refiner": "trimmed_icp", "iterations": 2}, "physics": {"steps": 25},
            "dependency": ORDER, "hypotheses": {"seed": 1},
        },
    ),
    Cause.COLLIDER: CauseScene(
        DemoScene(
            "A duck in a bowl", (Item("bowl"), Item("duck", 0.02, yaw_deg=30, drop_m=0.06)),
            (Viewpoint(elevation_deg=48, distance_m=0.55),), initial_poses=_rough_in_a_good_bowl,
        ),
        {
            "method": {**ICP, "name": "vf_breadth"}, "physics": {"collider": "hull", "steps": 80},
            "dependency": ORDER,
        },
    ),
    Cause.AMBIGUOUS: CauseScene(
        DemoScene(
            "A jug from behind", (Item("jug", yaw_deg=90),), (Viewpoint(elevation_deg=18, distance_m=0.52),),
            initial_poses=_handle_elsewhere,
        ),
        {"method": ICP, "physics": {"enabled": False}},
    ),
    Cause.NO_HYPOTHESIS: CauseScene(
        DemoScene("A mug", (MUG,), VIEW, initial_poses=lambda *given: ()), {"method": ICP}
    ),
    Cause.IMPOSSIBLE: CauseScene(
        FAILURES["failure_mask_leaks"], {"method": {**ICP, "name": "pir"}}, lambda T_cam_obj_gt: None
    ),
}  # fmt: skip


def session_of(cause: Cause, folder: Path) -> Session:
    """A failure of this cause: that of its command with options, else its scene.

    Args:
        cause: what is to be broken.
        folder: where a frame is written whose ground truth is another.
    """
    words = commands().get(cause)
    if words is not None:
        view = cli.parse(words)
        assert isinstance(view, ViewCommand)
        return load_session(None, given(view.settings, words))
    one, name = SCENES[cause], f"cause_{cause}"
    demo._ALL[name] = one.scene
    session = resolve({"title": one.scene.title, "scene": {"demo": name}, **one.sections})
    if one.spoil_truth is None:
        return session
    frame = _with_truth(Toolbox(session).problem("0/0"), one.spoil_truth, folder)
    scene = {"source": "folder", "dataset": str(frame)}
    return resolve({"title": session.title, "scene": scene, "hypotheses": {"source": "recorded"}, **one.sections})


def commands() -> dict[Cause, list[str]]:
    """The commands with options in docs/causes.md, as words, by the cause that they show."""
    return {cause: known.command.split() for cause, known in CAUSES.items() if known.command.startswith("view --")}


def _with_truth(problem: Problem, spoil_truth: Callable[[Float], Float | None], folder: Path) -> Path:
    """A frame of one object, saved with another ground truth."""
    (target,) = problem.targets
    model, instance, seen = target.model, target.instance, problem.observation
    assert instance.T_cam_obj_gt is not None
    mesh = folder / f"{model.name}.ply"
    trimesh.Trimesh(model.vertices, model.faces, process=False).export(mesh)
    frame = vv.Frame(seen.camera.K, seen.depth_m, seen.rgb)
    poses = np.array([hypothesis.T_cam_obj for hypothesis in instance.hypotheses])
    frame.add(model.name, mesh, instance.mask, poses, T_cam_obj_gt=spoil_truth(instance.T_cam_obj_gt))
    return frame.save(folder / "frame")
