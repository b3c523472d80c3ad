"""What the 3D view is to draw, as the window that it follows says it, with what the server knows of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.records import SimulatedPath
from verefine_viz.page.branch import Branch
from verefine_viz.page.evaluator import CachedEvaluator
from verefine_viz.page.protocol import DrawnPose, Look, Pose, pose_matrix
from verefine_viz.page.wire import pose_numbers

FOCUS_OPACITY, OTHERS_OPACITY = 0.9, 0.8
"""Opacities of bodies at the end of a run."""


@dataclass(frozen=True, eq=False)
class Body:
    """An object as a solid."""

    T_cam_obj: Float
    role: str
    opacity: float


@dataclass(frozen=True, eq=False)
class ViewContent:
    """One picture of the 3D view."""

    branch: Branch
    target: Target | None
    """The object in focus; None = the frame has none, or none was chosen."""
    evaluator: CachedEvaluator
    bodies: Mapping[int, Body]
    """By instance_id; an object without one is not drawn."""
    outlines: Mapping[int, Mapping[str, Float]]
    """T_cam_obj by instance_id and role."""
    Ts_hypothesis: Float
    """(n, 4, 4) T_cam_obj of the hypotheses of the focus."""
    ranks: Float
    """(n,) ranks of the hypotheses by score in [0, 1], 1 = the highest."""
    arm: int
    Ts_allowed: Float
    """(n, 4, 4) T_cam_obj of the focus that the image allows."""
    Ts_axes: Float
    """(n, 4, 4) T_cam_obj of the focus whose axes are drawn."""
    path: SimulatedPath | None
    """The simulated path whose contacts are drawn."""
    path_moment: int | None
    """Its moment that the focus is drawn at; None = elsewhere."""

    @property
    def problem(self) -> Problem:
        return self.branch.run.problem

    @property
    def focus(self) -> int | None:
        """The instance_id of the object in focus."""
        return None if self.target is None else self.target.instance.instance_id

    @property
    def main(self) -> Body | None:
        """The body of the object in focus."""
        return None if self.focus is None else self.bodies.get(self.focus)

    @property
    def edited(self) -> Float | None:
        """The pose of the focus that has handles."""
        return self.main.T_cam_obj if self.main is not None and self.main.role == "gizmo" else None

    @property
    def placed(self) -> dict[int, Placed]:
        """All models where they stand."""
        models, instances = self.problem.models, {i.instance_id: i.obj_id for i in self.problem.instances}
        return {obj: Placed(obj, models[instances[obj]], body.T_cam_obj) for obj, body in self.bodies.items()}

    @property
    def others(self) -> tuple[Placed, ...]:
        """The models but that in focus."""
        return tuple(placed for obj, placed in self.placed.items() if obj != self.focus)


def content_of(branch: Branch, look: Look) -> ViewContent:
    """Gather what is to be drawn: without an object in focus the frame, and the bodies that are named.

    Raises:
        InputError: it names an object or an iteration that is not there (any more).
        ShapeError: a pose is not rigid.
    """
    problem = branch.run.problem
    bodies: dict[int, Body] = {}
    outlines: dict[int, dict[str, Float]] = {}
    for one in look.draw:
        problem.target(one.obj)
        T_cam_obj = pose_matrix(one.T)
        if one.opacity > 0:
            bodies[one.obj] = Body(T_cam_obj, one.role, one.opacity)
        else:
            outlines.setdefault(one.obj, {})[one.role] = T_cam_obj
    path = branch.iteration(look.path.k).path if look.path is not None else None
    at = look.path.moment if look.path is not None else None
    main = None if look.obj is None else bodies.get(look.obj)
    if look.obj is not None and path is not None and at is not None and main is not None:
        bodies[look.obj] = Body(path.Ts_cam_obj[min(at, len(path.Ts_cam_obj) - 1)], "simulated", main.opacity)
    return ViewContent(
        branch,
        None if look.obj is None else problem.target(look.obj),
        branch.evaluator_of(look.k),
        bodies,
        outlines,
        _poses(one.T for one in look.hypotheses),
        np.array([one.share for one in look.hypotheses]),
        look.arm,
        _poses(look.allowed),
        _poses(look.axes),
        path,
        at,
    )


def _poses(poses: Iterable[Pose]) -> Float:
    """(n, 4, 4)."""
    return np.array([pose_matrix(T) for T in poses]).reshape(-1, 4, 4)


def look_at_end(branch: Branch) -> Look:
    """Show the end of a run: every answer, and the true pose of the last object."""
    run = branch.run
    answers = [
        (target.instance, best.T_cam_obj)
        for target, best in zip(run.problem.targets, run.final_state.best, strict=True)
        if best is not None
    ]
    if not answers:
        return Look(branch.index)
    last = run.iterations[-1].instance_id if run.length else answers[0][0].instance_id
    focus, T_focus = next((one for one in answers if one[0].instance_id == last), answers[0])
    truth = focus.T_cam_obj_gt
    others = [
        DrawnPose(one.instance_id, pose_numbers(T), "body", OTHERS_OPACITY) for one, T in answers if one is not focus
    ]
    truths = [] if truth is None else [DrawnPose(focus.instance_id, pose_numbers(truth), "ground truth")]
    main = DrawnPose(focus.instance_id, pose_numbers(T_focus), "best", FOCUS_OPACITY)
    draw = (*others, main, *truths)
    return Look(branch.index, k=run.length + 1, obj=focus.instance_id, draw=draw)
