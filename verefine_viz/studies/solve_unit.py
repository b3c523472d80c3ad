"""One unit of a study: a frame as it is at one x and seed, solved by every curve of the panel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache

import msgspec
import numpy as np
from msgspec import Struct, structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.clock import clock
from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.averages import average_recalls
from verefine_viz.evaluation.bop_model import EvalModel, eval_model
from verefine_viz.evaluation.ground_truth import GtImage, GtInstance
from verefine_viz.evaluation.pair_errors import DrawnTruth, pair_errors
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.evaluation.vsd import DELTA_MM
from verefine_viz.grasping.grasp_answer import GraspScene
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.studies.study_plan import Panel, StudyCurve, Unit


class Quality(Struct, frozen=True):
    """How good an answer is: the shares of BOP's thresholds that it passes, and its errors. No answer passes none."""

    ar_vsd: float = 0.0
    ar_mssd: float = 0.0
    ar_mspd: float = 0.0
    add_s_mm: float | None = None
    relative: float | None = None
    """ADD(-S) as a share of the diameter."""
    rotation_deg: float | None = None
    translation_mm: float | None = None

    @property
    def ar(self) -> float:
        """Mean of the three recalls; over many objects, BOP's average recall."""
        return (self.ar_vsd + self.ar_mssd + self.ar_mspd) / 3


def quality(target: Target, T_est: Float | None, problem: Problem) -> Quality:
    """Quality of the answer ``T_est`` (4, 4) [m], or None; ``problem``, with all its depth, says what is visible.

    Source: Hodan et al., BOP challenge 2019.
    """
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None, "studies are about objects with ground truth only"
    if T_est is None:
        return Quality()
    instance, observation = target.instance, problem.observation
    gt = GtInstance(instance.instance_id, instance.obj_id, T_gt[:3, :3], T_gt[:3, 3] * 1e3, 1.0)
    image = GtImage(observation.camera.K, observation.camera.width, observation.depth_m * np.float32(1e3), (gt,))
    estimate = T_est[:3, :3], T_est[:3, 3] * 1e3
    pair = pair_errors(DrawnTruth(image), _model(target.model), [estimate], [gt], DELTA_MM)
    recalls = average_recalls(pair.kinds[:, 0])
    errors = pose_errors(target.model, T_est, T_gt)
    return Quality(
        ar_vsd=recalls.ar_vsd,
        ar_mssd=recalls.ar_mssd,
        ar_mspd=recalls.ar_mspd,
        add_s_mm=errors.add_s_mm,
        relative=errors.relative,
        rotation_deg=errors.rotation_deg,
        translation_mm=errors.translation_mm,
    )


@lru_cache(maxsize=64)
def _model(model: ObjectModel) -> EvalModel:
    return eval_model(model)


class UnitAnswer(Struct, frozen=True, kw_only=True):
    """The answer of one curve for one object."""

    panel: str
    x: float
    seed: int
    scene: str
    frame: str
    curve: str
    instance_id: int
    obj_id: int
    quality: Quality
    ms: float
    """Time of the whole frame, shared equally by its objects; without what is compiled once."""
    refiner_calls: float
    """Calls of the whole frame, shared equally, times what a call counts as; of a tree search with its roll-outs."""
    name: str = ""
    """The object's."""
    grasp: str = ""
    """How a grasp with the answer ends, where it was tried; "no answer" without one."""
    missing: str = ""
    """Why the curve has no answer: its refiner lacks its weights, or they do not know the object."""


class Solver:
    """Solves units of one study; caches the scenes, and the last frame it has read. Belongs to one process."""

    def __init__(self, sessions: Mapping[str, Session], panels: Sequence[Panel]) -> None:
        self._toolboxes = {name: Toolbox(session) for name, session in sessions.items()}
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
                outcomes += _unrefined(unit, curve, problem, frame, grasping)
                continue
            changed = toolbox.changed({section: dict(fields) for section, fields in curve.settings.items()})
            try:
                refiner = self._ready(changed, problem)
            except (InputError, UnavailableError) as error:
                if not panel.may_lack:
                    raise
                outcomes += _missing(unit, curve, problem, str(error))
                continue
            outcomes += _outcomes(unit, curve, changed, refiner, problem, frame, grasping)
        return tuple(outcomes)

    def _grasping(self, unit: Unit, frame: Problem) -> GraspScene:
        """The frame with the gripper, made once as long as frames do not change; checked before anything is solved.

        Raises:
            InputError: the gripper fits no object of the frame.
        """
        if self._grasp_scene is None or self._grasp_scene[0] is not frame:
            scene = GraspScene(frame, self._toolboxes[unit.scene].session.grasp)
            scene.check_any_grasp()
            self._grasp_scene = frame, scene
        return self._grasp_scene[1]

    def _ready(self, toolbox: Toolbox, problem: Problem) -> Refiner:
        """The curve's refiner, which has seen every object: what is built once per model is not counted as time.

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
        """The toolbox's, shared by all curves with the same settings: its index of each model takes long to build."""
        # A refiner reads the section of its own, whatever that is called; curves differ in these three besides.
        own = Session()
        shared = structs.replace(toolbox.session, method=own.method, score=own.score, physics=own.physics)
        key = toolbox.session.method.refiner, msgspec.json.encode(shared)
        return self._refiners.setdefault(key, toolbox.refiner)

    def _frame(self, scene: str, frame: str) -> Problem:
        if self._last is None or self._last[0] != (scene, frame):
            self._last = (scene, frame), self._toolboxes[scene].problem(frame)
        return self._last[1]


def _outcomes(
    unit: Unit,
    curve: StudyCurve,
    toolbox: Toolbox,
    refiner: Refiner,
    problem: Problem,
    frame: Problem,
    grasping: GraspScene | None,
) -> list[UnitAnswer]:
    """One for each object; ``frame`` is ``problem`` before it was disturbed."""
    counted = _Counted(refiner)
    toolbox = toolbox.refined_by(counted)
    began = clock()
    best = _answers(toolbox, problem, counted, curve.most_calls)
    ms = 1e3 * (clock() - began)
    n = max(len(problem.targets), 1)
    return [
        UnitAnswer(
            **asdict(unit),
            curve=curve.label,
            instance_id=target.instance.instance_id,
            obj_id=target.instance.obj_id,
            quality=quality(target, answer, frame),
            ms=ms / n,
            refiner_calls=curve.inner * counted.calls / n,
            name=target.model.name,
            grasp=_grasp(target, answer, grasping),
        )
        for target in problem.targets
        for answer in (best.get(target.instance.instance_id),)
    ]


def _answers(toolbox: Toolbox, problem: Problem, counted: _Counted, most_calls: int | None) -> dict[int, Float]:
    """The answered poses by instance.

    Args:
        toolbox: with the method.
        problem: what is solved.
        counted: its refiner.
        most_calls: of a tree search, whose clusters do not know of each other: no iteration begins after so many
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


def _missing(unit: Unit, curve: StudyCurve, problem: Problem, why: str) -> list[UnitAnswer]:
    """One for each object, all without an answer."""
    return [
        UnitAnswer(
            **asdict(unit),
            curve=curve.label,
            instance_id=target.instance.instance_id,
            obj_id=target.instance.obj_id,
            quality=Quality(),
            ms=0.0,
            refiner_calls=0.0,
            name=target.model.name,
            missing=why,
        )
        for target in problem.targets
    ]


def _unrefined(
    unit: Unit, curve: StudyCurve, problem: Problem, frame: Problem, grasping: GraspScene | None
) -> list[UnitAnswer]:
    """One for each object, whose first initial pose is taken as it is."""
    return [
        UnitAnswer(
            **asdict(unit),
            curve=curve.label,
            instance_id=target.instance.instance_id,
            obj_id=target.instance.obj_id,
            quality=quality(target, target.instance.hypotheses[0].T_cam_obj, frame),
            ms=0.0,
            refiner_calls=0.0,
            name=target.model.name,
            grasp=_grasp(target, target.instance.hypotheses[0].T_cam_obj, grasping),
        )
        for target in problem.targets
    ]


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
