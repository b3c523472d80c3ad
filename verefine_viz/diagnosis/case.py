"""One failed instance: what the run did with it, and re-runs with something changed.

A re-run solves this instance alone, with the run's own method and budget, among the objects as the run had placed them.
Methods that solve several objects together (vf_depth, physim_mcts) are replaced by RIR among the placed objects, but
where the other objects decide (misplaced neighbours, starved hypotheses, the budget) the method itself runs again on
all of them. That takes as long as the run took with these objects, so that a diagnosis makes few such re-runs: one for
misplaced neighbours; one, with a single hypothesis of each object, for each of up to three hypotheses that come out
right on their own; and larger budgets where there is reason to think that it was too small.

A re-run that comes out right proves something only if re-runs with nothing changed do not. Which of the observed points
the refiner is given is a draw (``scene.seed``): a few other draws are the control, the same ones for the same run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Hypothesis, Placed, Problem, Target
from verefine_viz.core.protocols import Refiner, Simulator
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, SceneSettings
from verefine_viz.diagnosis.frame_ground_truth import FrameGroundTruth
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.methods.known_methods import method_of
from verefine_viz.methods.object_method import ObjectMethod
from verefine_viz.methods.physim_mcts import mcts_physics, mcts_tricp
from verefine_viz.methods.registry import make_method
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.physics.registry import make_simulator
from verefine_viz.refiners.trimmed_icp import TrimmedIcp
from verefine_viz.run.engine import Run

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

Pools = Mapping[int, Sequence[Hypothesis]]
"""Initial poses by instance_id, instead of an instance's own."""
ALONE = "alone"
"""Name of a re-run with nothing changed, except that RIR replaces methods of whole scenes."""
TOGETHER = "together: "
"""Beginning of the name of a re-run of all objects that are solved together."""
FAR = 0.35
"""Error of a start, as a share of the diameter, above which it is not near, whatever the refiner."""
CLEARLY = 0.8
"""Largest share of the error that may remain after a repair."""
CONTROLS, FIRST_CONTROLS = 5, 3
"""Re-runs on other samples of the observed points, with nothing changed and as many with a repair; and after how many
of them it is enough that none came out right."""
CONTROLS_TOGETHER, FIRST_CONTROLS_TOGETHER = 3, 2
"""Re-runs at once, where each solves a whole scene."""
HELPS = 0.5
"""A repair helps if re-runs with it come out right more often by this share."""
LEFT_OUT = 0.1
"""Share of points, where all are used and none can be chosen otherwise, that is left out in another sample."""


def cluster_of(problem: Problem, instance_id: int) -> tuple[int, ...]:
    """The instances of the same cluster that have a hypothesis, itself included."""
    cluster = next(c for c in problem.clusters if instance_id in c)
    return tuple(i for i in cluster if problem.target(i).instance.hypotheses)


def sampled_again(target: Target, settings: SceneSettings, sample: int) -> Target:
    """The target with other points of its segment, as another ``scene.seed`` would draw them; sample 0 is its own."""
    if not sample:
        return target
    instance, depth_m = target.instance, target.observation.depth_m
    n_pixels = int(np.count_nonzero(instance.mask & (depth_m > 0)))
    n_points = min(settings.cloud_points, int((1 - LEFT_OUT) * n_pixels))
    cloud = segment_cloud(depth_m, target.observation.camera, instance.mask, n_points, settings.seed + sample)
    return replace(target, instance=replace(instance, points_cam=cloud))


def solved_together(
    toolbox: Toolbox,
    problem: Problem,
    instance_id: int,
    pools: Pools,
    times: int = 1,
    iterations: int | None = None,
    sample: int = 0,
) -> Best | None:
    """The answer for one instance when the session's method solves its cluster again.

    Edited poses and settings changed on the way are not repeated.

    Args:
        toolbox: the run's.
        problem: the run's frame.
        instance_id: whose answer is wanted.
        pools: other initial poses.
        times: multiple of the run's budget.
        iterations: K, per hypothesis, instead of the run's; the search counts expansions, whatever the pools.
        sample: of the observed points (:func:`sampled_again`).
    """
    session = toolbox.session
    fields: dict[str, dict[str, Any]] = {}
    if method_of(session.method.name).has_tree:
        seconds = session.mcts.seconds
        fields["mcts"] = {"expansions": times * session.mcts.expansions}
        fields["mcts"] |= {"seconds": times * seconds} if seconds is not None else {}
    else:
        fields["method"] = {"iterations": iterations or times * session.method.iterations}
    # What has a part in the answer: the cluster and, where they stay in the scene, those before.
    clusters = problem.clusters
    last = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
    first = 0 if not method_of(session.method.name).has_tree and session.method.carry_clusters else last
    part = problem.only([i for cluster in clusters[first : last + 1] for i in cluster])
    targets = [sampled_again(t, session.scene, sample) for t in part.targets]
    instances = tuple(
        replace(t.instance, hypotheses=tuple(pools.get(t.instance.instance_id, t.instance.hypotheses))) for t in targets
    )
    run = Run(toolbox.restarted(fields).method, replace(part, instances=instances))
    answers = run.finish().best
    ids = [i.instance_id for i in instances]
    return answers[ids.index(instance_id)]


class Lab:
    """The parts that re-runs use, each built once."""

    def __init__(self, toolbox: Toolbox) -> None:
        session = toolbox.session
        self.toolbox = toolbox
        self.name = session.method.name
        self.traits = method_of(self.name)
        self.physics: PhysicsSettings = session.physics
        self.refiner: Refiner
        self.method_settings: MethodSettings = session.method
        if self.traits.has_tree:
            self.physics = mcts_physics(session.mcts, session.physics)
            self.refiner = TrimmedIcp(mcts_tricp(session.mcts, session.tricp))
            self.method_settings = structs.replace(session.method, name="vf_breadth")
        else:
            self.refiner = toolbox.refiner
        self.verifier = toolbox.verifier
        self.n_reruns = 0
        self._simulators: dict[PhysicsSettings, Simulator | None] = {}
        if toolbox.simulator is not None:
            self._simulators[session.physics] = toolbox.simulator

    @property
    def simulator(self) -> Simulator | None:
        """The run's own."""
        return self.simulator_with(self.physics)

    def simulator_with(self, physics: PhysicsSettings) -> Simulator | None:
        """One with other settings; None where they switch physics off."""
        if physics not in self._simulators:
            self._simulators[physics] = make_simulator(physics)
        return self._simulators[physics]

    def method(
        self, simulator: Simulator | None, refiner: Refiner | None = None, iterations: int | None = None
    ) -> ObjectMethod:
        """The run's method for one object, with other parts or another budget per hypothesis."""
        made = make_method(
            self.method_settings,
            simulator,
            refiner or self.refiner,
            self.verifier,
            self.physics.steps,
            self.toolbox.flips,
        ).method
        return replace(made, iterations=iterations or made.iterations)


@dataclass(frozen=True, eq=False)
class Rerun:
    """The result of a re-run."""

    best: Best | None
    error: float
    """ADD(-S) as a share of the diameter; infinite where there is no answer."""
    repaired: bool
    """Whether the answer is right now, and clearly better than it was."""
    what: str
    """Name of the change, by which its control is found."""


@dataclass(frozen=True)
class Control:
    """How often re-runs on other samples of the observed points come out right."""

    n_right: int
    n: int


Again = Callable[[int], Best | None]
"""Makes a re-run on the n-th sample of the observed points; sample 0 is the run's own."""


@dataclass(frozen=True, eq=False)
class Case:
    """One instance whose answer is further from ground truth than ``threshold``."""

    trace: Run
    lab: Lab
    target: Target
    T_gt: Float
    frame: FrameGroundTruth
    threshold: float
    answer: Best | None
    """The answer; None = there is none."""
    placed: tuple[Placed, ...]
    """Other objects as they were placed when this one was last worked on."""
    reruns: dict[str, Rerun] = field(default_factory=dict)
    """Re-runs made so far, by what was changed."""
    _again: dict[str, Again] = field(default_factory=dict)
    """The same re-runs as functions of the sample."""
    _controls: dict[str, Control] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.target.model.name

    @property
    def instance_id(self) -> int:
        return self.target.instance.instance_id

    @cached_property
    def error_of(self) -> ErrorOf:
        return ErrorOf(self.target.model, self.T_gt)

    @cached_property
    def error(self) -> float:
        """Error of the answer, as a share of the diameter; infinite where there is none."""
        return float("inf") if self.answer is None else self.error_of(self.answer.T_cam_obj)

    @cached_property
    def allowed(self) -> AllowedPoses:
        """What the image allows beside ground truth, where there is an answer."""
        assert self.answer is not None
        placed = self.placed if self.lab.method(None).placed_may_hide else ()
        return allowed_poses(
            self.lab.verifier, self.target, self.T_gt, placed, self.trace.iterations, [self.answer.T_cam_obj]
        )

    @cached_property
    def own(self) -> tuple[Iteration, ...]:
        """The iterations of this instance."""
        return self.trace.iterations_of(self.instance_id)

    @cached_property
    def initial_errors(self) -> Float:
        """(H,) errors of the hypotheses."""
        return np.array([self.error_of(h.T_cam_obj) for h in self.target.instance.hypotheses])

    @property
    def at_gt(self) -> Placed:
        return Placed(self.instance_id, self.target.model, self.T_gt)

    @cached_property
    def placed_at_gt(self) -> tuple[Placed, ...]:
        """The other objects at ground truth; those without it as they were placed."""
        return tuple(self.frame.placed.get(p.instance_id, p) for p in self.placed)

    def rerun(
        self,
        what: str,
        target: Target | None = None,
        fixed: Sequence[Placed] | None = None,
        method: ObjectMethod | None = None,
    ) -> Rerun:
        """Solve the instance again with something changed, once for each change.

        Args:
            what: names the change.
            target: instead of its own: another mask, depth, plane or pool.
            fixed: instead of the objects as they were placed.
            method: instead of the run's.
        """
        return self._made(what, self._solving(target or self.target, fixed, method))

    def _solving(
        self, target: Target, fixed: Sequence[Placed] | None = None, method: ObjectMethod | None = None
    ) -> Again:
        return lambda sample: solved(
            method or self.lab.method(self.lab.simulator),
            sampled_again(target, self.lab.toolbox.session.scene, sample),
            self.placed if fixed is None else fixed,
        )

    @cached_property
    def group(self) -> tuple[int, ...]:
        """Instances that the method solved together with it, itself included; none where it was solved alone."""
        cluster, traits = cluster_of(self.trace.problem, self.instance_id), self.lab.traits
        return cluster if traits.has_tree or (traits.takes_turns and len(cluster) > 1) else ()

    def rerun_together(self, what: str, pools: Pools, times: int = 1, iterations: int | None = None) -> Rerun:
        """Solve the instance and its group again by the session's own method; see :func:`solved_together`."""
        return self._made(f"{TOGETHER}{what}", self._solving_together(pools, times, iterations))

    def _solving_together(self, pools: Pools, times: int = 1, iterations: int | None = None) -> Again:
        toolbox, problem = self.lab.toolbox, self.trace.problem
        return lambda sample: solved_together(toolbox, problem, self.instance_id, pools, times, iterations, sample)

    def _made(self, what: str, again: Again) -> Rerun:
        if what not in self.reruns:
            self._again[what] = again
            self.lab.n_reruns += 1
            best = again(0)
            error = self._error_of_best(best)
            repaired = error < self.threshold and error < CLEARLY * self.error
            self.reruns[what] = Rerun(best, error, repaired, what)
        return self.reruns[what]

    def _error_of_best(self, best: Best | None) -> float:
        return float("inf") if best is None else self.error_of(best.T_cam_obj)

    def unchanged(self, like: str) -> Control:
        """How often the run comes out right by itself, solved in the way that the re-run ``like`` was."""
        if like.startswith(TOGETHER):
            return self._control(f"{TOGETHER}{ALONE}", FIRST_CONTROLS_TOGETHER, CONTROLS_TOGETHER)
        return self._control(ALONE, FIRST_CONTROLS, CONTROLS)

    def repeated(self, what: str) -> Control:
        """How often a change that was re-run before comes out right."""
        n = CONTROLS_TOGETHER if what.startswith(TOGETHER) else CONTROLS
        return self._control(what, n, n)

    def _control(self, what: str, first: int, n: int) -> Control:
        """How many of ``n`` re-runs come out right; only ``first`` of them are made if none of those does."""
        if what not in self._controls:
            n_made, n_right = first, self.n_right(what, range(1, first + 1))
            if n_right and n > first:
                n_made, n_right = n, n_right + self.n_right(what, range(first + 1, n + 1))
            self._controls[what] = Control(n_right, n_made)
        return self._controls[what]

    def n_right(self, what: str, samples: Sequence[int]) -> int:
        """On how many samples of the observed points a re-run comes out right that was made before, or changes nothing.

        Args:
            what: its name; one that changes nothing is called :data:`ALONE`.
            samples: see :func:`sampled_again`.
        """
        if what == f"{TOGETHER}{ALONE}":
            again = self._solving_together({})
        else:
            again = self._solving(self.target) if what == ALONE else self._again[what]
        self.lab.n_reruns += len(samples)
        return sum(self._error_of_best(again(sample)) < self.threshold for sample in samples)

    def with_pool(self, *poses: Float) -> Target:
        """The target with these initial poses instead."""
        pool = tuple(Hypothesis(T, 1.0, f"re-run {k + 1}") for k, T in enumerate(poses))
        return replace(self.target, instance=replace(self.target.instance, hypotheses=pool))


def solved(method: ObjectMethod, target: Target, fixed: Sequence[Placed]) -> Best | None:
    """The answer of a method for one object; None where the pool is empty."""
    state = method.start(target, fixed)
    if state is None:
        return None
    k = 0
    while not method.is_done(state):
        k += 1
        state, _ = method.step(state, k, fixed)
    return state.best
