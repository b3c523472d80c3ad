"""One unit of a study: a frame at one x and seed, solved by every curve of the panel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec import Struct, structs

from verefine_viz.batch.summary import answer_errors, object_facts
from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.settings import Session
from verefine_viz.grasping.grasp_answer import GraspScene
from verefine_viz.run.record import Answer
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.studies.study_plan import Metric, Panel, StudyCurve, Unit


class UnitAnswer(Struct, frozen=True, kw_only=True):
    """The answer of one curve for one object."""

    panel: str
    x: float
    scene: str
    curve: str
    answer: Answer
    """The answer as in a batch: object, frame, seed, pose, errors and recalls. Failed where the curve's refiner lacks
    its weights, or these do not know the object; the message says which."""
    ms: float = 0.0
    """Time of the whole frame, shared equally by its objects, without one-time compilation."""
    refiner_calls: float = 0.0
    """Refiner calls of the whole frame, shared equally, times the weight of a call; those of a tree search include
    roll-outs."""
    grasp: str = ""
    """How a grasp with the answer ends, where it was tried; "no answer" without one."""

    @property
    def missing(self) -> str:
        """Why the curve has no answer at all; empty where it was solved."""
        return self.answer.message if self.answer.status == "failed" else ""

    def recall(self, metric: Metric) -> float:
        """The share of BOP's thresholds that the answer passes; 0 without an answer."""
        return getattr(self.answer, metric) or 0.0


class Solver:
    """Solves units of one study; caches the scenes and the last frame read. Belongs to one process."""

    def __init__(
        self, sessions: Mapping[str, Session], panels: Sequence[Panel], progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        self._toolboxes = {name: Toolbox(session, progress) for name, session in sessions.items()}
        self._panels = {panel.name: panel for panel in panels}
        self._refiners: dict[tuple[str, bytes], Refiner] = {}
        self._grasp_scene: tuple[Problem, GraspScene] | None = None
        self._last: tuple[tuple[str, str], Problem] | None = None

    def solve(self, unit: Unit) -> tuple[UnitAnswer, ...]:
        """A row per curve and object.

        Raises:
            VerefineError: the frame cannot be read or has no ground truth.
        """
        panel, toolbox = self._panels[unit.panel], self._toolboxes[unit.scene]
        frame = self._frame(unit.scene, unit.frame)
        problem = panel.prepare(frame, unit.x, unit.seed)
        outcomes: list[UnitAnswer] = []
        grasping = self._grasping(unit, frame) if panel.is_grasped else None
        for curve in panel.curves:
            if curve.settings is None:
                point = _Point(unit, curve, "", problem, frame, grasping)
                outcomes += point.answers({i.instance_id: i.hypotheses[0].T_cam_obj for i in problem.instances})
                continue
            changed = toolbox.changed({section: dict(fields) for section, fields in curve.settings.items()})
            point = _Point(unit, curve, changed.session.method.name, problem, frame, grasping)
            try:
                refiner = self._ready(changed, problem)
            except (InputError, UnavailableError) as error:
                if not panel.may_lack:
                    raise
                outcomes += point.missing(str(error))
                continue
            counted = _Counted(refiner)
            began = clock()
            poses = _poses(changed.refined_by(counted), problem, counted, curve.most_calls)
            ms = 1e3 * (clock() - began)
            outcomes += point.answers(poses, ms, curve.inner * counted.calls)
        return tuple(outcomes)

    def _grasping(self, unit: Unit, frame: Problem) -> GraspScene:
        """The frame with the gripper, made once per frame; checked before anything is solved.

        Raises:
            InputError: the gripper fits no object of the frame.
        """
        if self._grasp_scene is None or self._grasp_scene[0] is not frame:
            scene = GraspScene(frame, self._toolboxes[unit.scene].session.grasp)
            scene.check_any_grasp()
            self._grasp_scene = frame, scene
        return self._grasp_scene[1]

    def _ready(self, toolbox: Toolbox, problem: Problem) -> Refiner:
        """The curve's refiner, warmed up on every object, so that building once per model does not count as time.

        Raises:
            InputError, UnavailableError: its weights are missing, or do not know an object.
        """
        refiner = self._refiner(toolbox)
        toolbox.prepare(problem)
        for target in problem.targets:
            assert target.instance.T_cam_obj_gt is not None
            refiner.refine(target, target.instance.T_cam_obj_gt)
            toolbox.verifier.score(target, target.instance.T_cam_obj_gt[None])
        return refiner

    def _refiner(self, toolbox: Toolbox) -> Refiner:
        """The toolbox's refiner, shared by all curves with the same settings, as its index of each model takes long to
        build.
        """
        # A refiner reads its own section, whatever its name; besides, curves differ in these three.
        own = Session()
        shared = structs.replace(toolbox.session, method=own.method, score=own.score, physics=own.physics)
        key = toolbox.session.method.refiner, msgspec.json.encode(shared)
        return self._refiners.setdefault(key, toolbox.refiner)

    def _frame(self, scene: str, frame: str) -> Problem:
        if self._last is None or self._last[0] != (scene, frame):
            self._last = (scene, frame), self._toolboxes[scene].problem(frame)
        return self._last[1]


@dataclass(frozen=True)
class _Point:
    """The data that all answers of a curve in one unit share."""

    unit: Unit
    curve: StudyCurve
    method: str
    problem: Problem
    frame: Problem
    """The problem before it was disturbed, with all its depth."""
    grasping: GraspScene | None

    def answers(self, poses: Mapping[int, Float], ms: float = 0.0, refiner_calls: float = 0.0) -> list[UnitAnswer]:
        """One for each object.

        Args:
            poses: answered ones by instance.
            ms: for all objects together.
            refiner_calls: of all objects together.
        """
        n = max(len(self.problem.targets), 1)
        return [
            self._row(self._answer(target, T), ms / n, refiner_calls / n, _grasp(target, T, self.grasping))
            for target in self.problem.targets
            for T in (poses.get(target.instance.instance_id),)
        ]

    def missing(self, why: str) -> list[UnitAnswer]:
        """An outcome for each object, all without an answer."""
        return [
            self._row(Answer(**self._facts(target), status="failed", message=why)) for target in self.problem.targets
        ]

    def _row(self, answer: Answer, ms: float = 0.0, refiner_calls: float = 0.0, grasp: str = "") -> UnitAnswer:
        return UnitAnswer(
            panel=self.unit.panel,
            x=self.unit.x,
            scene=self.unit.scene,
            curve=self.curve.label,
            answer=answer,
            ms=ms,
            refiner_calls=refiner_calls,
            grasp=grasp,
        )

    def _answer(self, target: Target, T_cam_obj: Float | None) -> Answer:
        if T_cam_obj is None:
            return Answer(**self._facts(target), status="no_answer")
        errors = answer_errors(target, T_cam_obj, self.frame.observation)
        return Answer(**self._facts(target), status="ok", T_cam_obj=T_cam_obj, **errors)

    def _facts(self, target: Target) -> dict[str, Any]:
        return {**object_facts(self.problem, target, self.method), "seed": self.unit.seed, "has_truth": True}


def _poses(toolbox: Toolbox, problem: Problem, counted: _Counted, most_calls: int | None) -> dict[int, Float]:
    """The answered poses by instance.

    Args:
        toolbox: with the method.
        problem: what is solved.
        counted: its refiner.
        most_calls: of a tree search, whose clusters do not know of each other: no iteration begins after this many
            refiner calls per object.
    """
    parts = [problem] if most_calls is None else [problem.only(cluster) for cluster in problem.clusters]
    best: dict[int, Float] = {}
    for part in parts:
        most = math.inf if most_calls is None else counted.calls + most_calls * len(part.instances)
        run = toolbox.run(part)
        while not run.is_done and (counted.calls < most or run.length == 0):
            run.step()
        best |= {instance_id: answer.T_cam_obj for instance_id, answer in run.best_at(run.length).items()}
    return best


def _grasp(target: Target, T_cam_obj: Float | None, grasping: GraspScene | None) -> str:
    if grasping is None:
        return ""
    return "no answer" if T_cam_obj is None else grasping.attempt(target.instance.instance_id, T_cam_obj).verdict


class _Counted:
    """A refiner that counts its calls."""

    def __init__(self, inner: Refiner) -> None:
        self._inner = inner
        self.calls = 0

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        self.calls += 1
        return self._inner.refine(target, T_cam_obj, fixed)
