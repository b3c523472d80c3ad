"""The composition root: builds the real simulator, refiner, verifier, method and scene from a session."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any

from msgspec import structs

from verefine_viz.calibration.corrected_data import corrected
from verefine_viz.core.errors import InputError, ShapeError, VerefineError, unknown
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.own_parts import NO_PARTS, OwnParts
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Estimator, Method, Refiner, Simulator, Verifier, Watcher
from verefine_viz.core.settings import BULLET, EQ_1, Session, StartPose, TrackedPose
from verefine_viz.core.side_by_side import side_by_side
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.methods.known_methods import method_of
from verefine_viz.methods.object_method import Flips
from verefine_viz.methods.physim_mcts import make_physim_mcts, mcts_physics, mcts_tricp
from verefine_viz.methods.registry import make_method
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.physics.colliders import Collider
from verefine_viz.physics.plausibility import centre_of_mass, plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.physics.registry import make_simulator
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.refiners.registry import make_refiner
from verefine_viz.refiners.trimmed_icp import TrimmedIcp
from verefine_viz.rendering.colour import ColourStore
from verefine_viz.rendering.explained import ExplainedPixels
from verefine_viz.rendering.registry import make_verifier
from verefine_viz.rendering.simplify import scoring_mesh
from verefine_viz.run.edits import check_edits, edits_elsewhere, edits_of
from verefine_viz.run.engine import Run
from verefine_viz.run.plausible_verifier import Check, PlausibleVerifier
from verefine_viz.run.session_file import AT_ITS_START, changed
from verefine_viz.run.session_parts import estimators_of
from verefine_viz.run.solids_ahead import SolidsAhead
from verefine_viz.run.start_poses import with_starts
from verefine_viz.run.track import EarlierPose, Track, answers_of, tracked_poses, with_tracked
from verefine_viz.scenes.frame_surroundings import AROUND, with_surroundings
from verefine_viz.scenes.hypothesis_pool import asked_estimators
from verefine_viz.scenes.instance_notes import is_about_initial_poses, within_reach
from verefine_viz.scenes.source import SceneSource, open_scene

PICTURED = 0.1
"""Weight of colour in maps that are looked at where the score has none; its maps do not depend on it."""


class Toolbox:
    """Everything a session needs, built when it is first asked for. Belongs to one thread (OpenGL does).

    Args:
        session: what is needed for.
        progress: has checkpoints before and during anything that may take seconds. What is cancelled can be repeated.
        source: where the frames come from; None = what the session's scene names.
        verifier: what scores; None = what the session names.
        simulator: what simulates; None = what the session names.
        refiner: what refines, also in the roll-outs of a tree search; None = what the session names.
        own: parts of the caller, which come before others of their names.
    """

    def __init__(
        self,
        session: Session,
        progress: ProgressToken = NEVER_CANCELLED,
        source: SceneSource | None = None,
        *,
        verifier: Verifier | None = None,
        simulator: Simulator | None = None,
        refiner: Refiner | None = None,
        own: OwnParts = NO_PARTS,
    ) -> None:
        self.session, self._own = session, own
        self._progress = progress
        self._source, self._verifier, self._simulator, self._refiner = source, verifier, simulator, refiner

    @cached_property
    def source(self) -> SceneSource:
        return self._source or open_scene(self.session.scene, self.session.hypotheses)

    @cached_property
    def verifier(self) -> Verifier:
        if self._verifier is not None:
            return self._verifier
        verifier = make_verifier(self.session.score, self._progress, self._own)
        if self.session.score.plausibility_weight == 0:
            return verifier
        return PlausibleVerifier(verifier, self._plausible_share, self.session.physics)

    @cached_property
    def picture_verifier(self) -> Verifier:
        """Draws the maps that are looked at: those of colour too, where the score does without it."""
        score = self.session.score
        if score.colour_weight > 0 or score.verifier != EQ_1:
            return self.verifier
        return make_verifier(structs.replace(score, colour_weight=PICTURED), self._progress)

    @cached_property
    def _plausible_share(self) -> Check:
        """What the score has of plausibility."""
        tau_m, physics, surfaces, progress = self.session.score.tau_m, self.session.physics, Surfaces(), self._progress
        com_of = cache(lambda model: centre_of_mass(model, physics, progress=progress))

        def share(one: Placed, others: Sequence[Placed], support: Support) -> float:
            known = com_of(one.model)
            checked = plausibility(one, others, support, physics, surface_of=surfaces, progress=progress, com_obj=known)
            return checked.share(tau_m)

        return share

    @cached_property
    def simulator(self) -> Simulator | None:
        """None where the session switches physics off."""
        return self._simulator or make_simulator(self.session.physics, self._progress, self._own)

    @cached_property
    def surfaces(self) -> Surfaces:
        """Surfaces of the models, for plausibility."""
        return Surfaces()

    @cached_property
    def refiner(self) -> Refiner:
        return self._refiner or make_refiner(self.session.method.refiner, self.session, self._own)

    @cached_property
    def estimators(self) -> Mapping[str, Estimator]:
        """Estimators that the session's initial poses come from, by name.

        Raises:
            SettingsError: there is none of that name.
        """
        names = sorted(estimators_of(self.session))
        return {name: make_estimator(name, self.session, self._own) for name in names}

    @cached_property
    def point_pairs(self) -> Estimator:
        """What looks for objects that a person marks, wherever the session's initial poses come from."""
        return make_estimator("ppf", self.session)

    @cached_property
    def method(self) -> Method[Any]:
        s = self.session
        if method_of(s.method.name).has_tree:
            physics, tricp = mcts_physics(s.mcts, s.physics), mcts_tricp(s.mcts, s.tricp)
            refiner = self._refiner or TrimmedIcp(tricp)
            pixels = ExplainedPixels(s.mcts.explained_m, s.score, progress=self._progress)
            return make_physim_mcts(
                s.mcts,
                make_simulator(physics, self._progress, self._own),
                refiner,
                self.verifier,
                pixels,
                physics.steps,
            )
        return make_method(s.method, self.simulator, self.refiner, self.verifier, s.physics.steps, self.flips)

    @cached_property
    def flips(self) -> Flips | None:
        """For each model the turns after which it looks nearly the same; None where the session wants no flips."""
        if not self.session.hypotheses.flips:
            return None
        return cache(lambda model: flips(near_symmetries(model, progress=self._progress)))

    @property
    def frames(self) -> tuple[str, ...]:
        """Every frame the session names, as "scene/image"."""
        return self.source.frames

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the choice of frames and objects."""
        return (*self.source.notes, *edits_elsewhere(self.session.edits, self.frames))

    def problem(
        self,
        frame: str,
        preparing: Callable[[], AbstractContextManager[object]] = nullcontext,
        ahead: SolidsAhead | None = None,
    ) -> Problem:
        """The frame with its instances, their hypotheses, and the order in which they depend on each other.

        Args:
            frame: "scene/image".
            preparing: entered while its models are read and prepared; measures the time of it.
            ahead: makes the solids that are not known yet; None = they are waited for.

        Raises:
            VerefineError: the frame cannot be used, or lacks what the session names in it.
            Cancelled: it is not wanted any more.
        """
        problem = self.source.problem(frame, replace(self._progress, preparing=preparing))
        problem = corrected(problem, self.session.data, self.session.scene)
        with preparing():
            problem = self._solvable(problem, ahead)
        problem = with_tracked(self._with_estimates(problem), self._tracked(problem))
        problem = with_starts(problem, self.session.starts, not self.session.scene.objects)
        notes = check_edits(self.session.edits, problem, len(self.frames) == 1, not self.session.scene.objects)
        notes += self._without_terms(problem)
        problem = replace(problem, notes=(*problem.notes, *notes)) if notes else problem
        return self.surrounded(self.ordered(_within_reach(problem)))

    def _tracked(self, problem: Problem) -> tuple[TrackedPose, ...]:
        """Answers of earlier frames as initial poses: those that the session states, else as they are solved now."""
        stated = tuple(pose for pose in self.session.tracked if pose.frame == problem.frame)
        if stated or not self.session.method.track:
            return stated
        return tracked_poses(problem, self.track.before(problem.frame))

    @cached_property
    def track(self) -> Track:
        """The answers of earlier frames; solves a frame where nothing knows its answers."""
        return Track(self.frames, self._solved, self._progress)

    def _solved(self, frame: str) -> tuple[EarlierPose, ...]:
        run = self.run(self.problem(frame))
        run.finish()
        return answers_of(run)

    def _without_terms(self, problem: Problem) -> tuple[str, ...]:
        """Terms of the score that are asked for and cannot be had, and why; colour only of models that have some."""
        score = self.session.score
        without: tuple[str, ...] = ()
        if score.plausibility_weight > 0 and problem.observation.support is None:
            without = ("poses are scored without plausibility: no support plane is known",)
        if score.colour_weight == 0:
            return without
        colours = ColourStore(score.colour_weight)
        why = {
            f"{t.model.name} ({t.model.obj_id})": colours.off_reason(t) for t in problem.targets if t.model.has_colors
        }
        return (*without, *(f"{name} is scored without colour: {reason}" for name, reason in why.items() if reason))

    def ordered(self, problem: Problem) -> Problem:
        """The problem with the order that this session's settings lead to."""
        graph = dependency_graph(problem, self.session.dependency)
        before = problem.dependencies.notes if problem.dependencies is not None else ()
        notes = tuple(note for note in problem.notes if note not in before)
        return replace(problem, dependencies=graph, notes=(*notes, *graph.notes))

    def surrounded(self, problem: Problem) -> Problem:
        """The problem in the world that this session's settings lead to.

        Raises:
            VerefineError: the mesh of the surroundings cannot be used.
        """
        observation, own = with_surroundings(problem.observation, problem.frame, self.session.physics)
        notes = tuple(note for note in problem.notes if not note.startswith(AROUND))
        return replace(problem, observation=observation, notes=(*notes, *own))

    def _solvable(self, problem: Problem, ahead: SolidsAhead | None) -> Problem:
        """The problem without instances whose mesh makes no solid for the simulator; each is noted and left out. Solids
        that are not as they were asked for are noted.

        Raises:
            InputError: none is left.
        """
        broken, makeshift = self._solids(problem, ahead)
        if not (broken or makeshift):
            return problem
        instances = tuple(i for i in problem.instances if i.obj_id not in broken)
        notes = tuple(f"object {obj_id} is left out: {why}" for obj_id, why in broken.items())
        if not instances:
            raise InputError(f"no instance of frame {problem.frame} can be solved: {'; '.join(notes)}")
        left_out = tuple(
            t.left_out(broken[t.instance.obj_id], is_unreadable=True)
            for t in problem.targets
            if t.instance.obj_id in broken
        )
        return replace(
            problem,
            instances=instances,
            notes=(*problem.notes, *notes, *makeshift),
            left_out=(*problem.left_out, *left_out),
        )

    def _solids_for(self, problem: Problem) -> Callable[[ObjectModel, ProgressToken], Collider] | None:
        """What makes the solids of its objects. None where Bullet simulates nothing: what repeats recorded steps opens
        at once, and a fork to a method that simulates makes the solids when it begins.
        """
        is_solved = not method_of(self.session.method.name).repeats and problem.observation.support is not None
        is_bullets = is_solved and self.session.physics.simulator == BULLET
        return self.simulator.collider if is_bullets and isinstance(self.simulator, BulletSimulator) else None

    def _solids(self, problem: Problem, ahead: SolidsAhead | None) -> tuple[dict[int, str], tuple[str, ...]]:
        """Objects of which no collider can be built, with the reason, and notes on those that are built; building takes
        seconds, once per model. Meshes to score and near-symmetries, which take about as long, are made beside them.
        """
        broken: dict[int, str] = {}
        notes: list[str] = []
        solid_of: Callable[[ObjectModel, ProgressToken], Collider | None] | None = self._solids_for(problem)
        if solid_of is not None and ahead is not None and ahead.makes(self.session.physics):
            solid_of = ahead.solid_of
        if solid_of is not None:
            models = list(problem.models.values())
            solids = [partial(solid_of, model) for model in models]
            meshes = [partial(_score_mesh, model, self.session.score.simplify_mm) for model in models]
            has_flips = self.flips is not None and self.session.score.colour_weight > 0
            turns = [partial(_near_symmetries, model) for model in models if has_flips and model.has_colors]
            prepared = side_by_side([*solids, *meshes, *turns], self._progress)
            if ahead is not None:
                ahead.begin()
            for model, solid in zip(models, prepared, strict=False):
                if isinstance(solid, ShapeError):
                    broken[model.obj_id] = str(solid)
                elif isinstance(solid, VerefineError):
                    raise solid
                elif solid is not None and solid.note:
                    notes.append(f"object {model.obj_id} ({model.name}): {solid.note}")
        return broken, tuple(notes)

    def _with_estimates(self, problem: Problem) -> Problem:
        """The problem with the pools of the estimators, without notes on those before; an instance whose estimator
        finds no pose is noted.

        Raises:
            InputError: one is asked for an instance that the frame does not have.
        """
        h = self.session.hypotheses
        wanted = {i: name for (frame, i), name in asked_estimators(h).items() if frame == problem.frame}
        instances, notes = list(problem.instances), list(problem.notes)
        there = [i.instance_id for i in instances]
        absent = wanted.keys() - there - {o.instance_id for o in problem.left_out}
        if absent and not self.session.scene.objects:
            raise InputError(f"hypotheses.estimate: {unknown('instance', min(absent), there)} (frame {problem.frame})")
        notes += [f"hypotheses.estimate: instance {i} is none of the objects to solve" for i in sorted(absent)]
        for k, target in enumerate(problem.targets):
            instance = target.instance
            name = wanted.get(instance.instance_id, h.source)
            if name in self.estimators:
                who = f"{target.model.name} (#{instance.instance_id})"
                self._progress.checkpoint(f"Looking for initial poses of {who} with {name}.")
                pool = self.estimators[name].hypotheses(target, h.max_per_object, self._progress)
                instances[k] = replace(instance, hypotheses=pool)
                notes = [note for note in notes if not is_about_initial_poses(note, instance, target.model)]
                if not pool:
                    notes.append(f"{who} has no hypothesis: {name} found none in its {len(instance.points_cam)} points")
        return replace(problem, instances=tuple(instances), notes=tuple(notes))

    def changed(self, settings: dict[str, dict[str, Any]]) -> Toolbox:
        """A toolbox with some settings replaced that can change during a run; what did not change is shared."""
        return self._sharing(changed(self.session, settings))

    def restarted(self, settings: dict[str, dict[str, Any]], starts: tuple[StartPose, ...] = ()) -> Toolbox:
        """A toolbox for what can change at the start of a run: without edited poses and settings changed during it, and
        with other ``starts``.
        """
        session = changed(self.session, settings, AT_ITS_START)
        return self._sharing(structs.replace(session, edits=(), changes=(), tracked=(), starts=starts))

    def _sharing(self, session: Session) -> Toolbox:
        score, has_same_physics = self.session.score, session.physics == self.session.physics
        has_same_score = session.score == score and (has_same_physics or score.plausibility_weight == 0)
        return Toolbox(
            session,
            self._progress,
            self.source,
            verifier=self.verifier if has_same_score else None,
            simulator=self.simulator if has_same_physics else None,
            own=self._own,
        )

    def refined_by(self, refiner: Refiner) -> Toolbox:
        """Return a toolbox of this session with another refiner; all else is shared."""
        return Toolbox(
            self.session,
            self._progress,
            self.source,
            verifier=self.verifier,
            simulator=self.simulator,
            refiner=refiner,
            own=self._own,
        )

    @cached_property
    def _later(self) -> tuple[tuple[int, Toolbox], ...]:
        """(k, what takes over after iteration k), in order."""
        later: list[tuple[int, Toolbox]] = []
        toolbox = self
        for change in sorted(self.session.changes, key=lambda c: c.after_iteration):
            toolbox = toolbox.changed(change.settings)
            later.append((change.after_iteration, toolbox))
        return tuple(later)

    def verifier_of(self, index: int) -> Verifier:
        """What scores iteration ``index`` = 1, 2, … of a run of this session."""
        return next((t for k, t in reversed(self._later) if k < index), self).verifier

    def refiner_of(self, index: int) -> Refiner | None:
        """What refines in iteration ``index`` = 1, 2, … of a run of this session."""
        return next((t for k, t in reversed(self._later) if k < index), self).method.refiner

    def prepare(self, problem: Problem) -> None:
        """Builds what is built once per model and cached on disk, so that no iteration waits for it (seconds each).

        Raises:
            ShapeError: a mesh from which no solid can be made.
        """
        solid_of = self._solids_for(problem)
        if solid_of is not None:
            for target in problem.targets:
                solid_of(target.model, self._progress)

    def run(self, problem: Problem, watchers: Sequence[Watcher[Any]] = (), is_prepared: bool = False) -> Run:
        """A run of the session's method on ``problem``, with its frame's edits and the changes of the session.

        Args:
            problem: the frame.
            watchers: see all of it.
            is_prepared: what is built once per model is there, or a step may wait for it; else it is built first.
        """
        if not is_prepared:
            self.prepare(problem)
        changes = {k: toolbox.method for k, toolbox in self._later}
        edits = edits_of(self.session.edits, problem, is_only_frame=len(self.frames) == 1) if self.session.edits else ()
        return Run(self.method, problem, watchers, edits, changes)


def _score_mesh(model: ObjectModel, simplify_mm: float, progress: ProgressToken) -> None:
    """Has the mesh to score in the cache, where the verifier finds it."""
    scoring_mesh(model, simplify_mm, progress=progress)


def _near_symmetries(model: ObjectModel, progress: ProgressToken) -> None:
    """Has the model's near-symmetries in the cache."""
    near_symmetries(model, progress=progress)


def _within_reach(problem: Problem) -> Problem:
    """The problem without initial poses that are too far away to be any; each instance's are noted."""
    checked = [within_reach(target.instance, target.model) for target in problem.targets]
    notes = tuple(note for _, own in checked for note in own)
    if not notes:
        return problem
    return replace(problem, instances=tuple(instance for instance, _ in checked), notes=(*problem.notes, *notes))
