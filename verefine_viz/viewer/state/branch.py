"""One run on a frame with its settings, and the runs that a frame has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.settings import Change, Session
from verefine_viz.diagnosis.lost_poses import Discarded, discarded
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.methods.registry import method_of
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import changed
from verefine_viz.viewer.commands import Changes, SidePose
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator
from verefine_viz.viewer.state.timeline_marks import RED, Mark, marks_of, once_per_object
from verefine_viz.viewer.state.view_options import STAGES

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

# Changed settings in their two forms: by dotted name, as commands have them, and by section, as session files do.


def in_order(changes: Sequence[Change]) -> list[Change]:
    """The earliest first."""
    return sorted(changes, key=lambda change: change.after_iteration)


def nested(changes: Changes) -> dict[str, dict[str, Any]]:
    """(("method.exploration", 0.2),) as {"method": {"exploration": 0.2}}."""
    out: dict[str, dict[str, Any]] = {}
    for name, value in changes:
        section, _, key = name.partition(".")
        out.setdefault(section, {})[key] = value
    return out


def merged(parts: Sequence[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Several nested changes as one; later ones win."""
    out: dict[str, dict[str, Any]] = {}
    for part in parts:
        for section, values in part.items():
            out.setdefault(section, {}).update(values)
    return out


def current_values(session: Session, names: Sequence[str]) -> Mapping[str, Any]:
    """The values of settings by dotted name."""
    values = {}
    for name in names:
        section, _, key = name.partition(".")
        values[name] = getattr(getattr(session, section), key)
    return values


# A comparison as a choice: which branch is B, and how both are shown.

OF_ONE_RUN = frozenset(STAGES) - {"ground truth", "edited"} | {"hypotheses", "contacts", "path", "others", "overlaps"}
"""Layers that show the open run only."""


@dataclass(frozen=True)
class ComparisonChoice:
    """The open branch is A; this is what stands beside it."""

    b: int
    """Index of B among the frame's branches."""
    moment: tuple[int, int] | None = None
    """(instance_id, n): both after their n-th iteration on that object; None = where A's cursor is."""
    poses: SidePose = "best"
    shown: frozenset[str] = frozenset("AB")
    """Whose poses are drawn in 3D."""
    hidden: frozenset[str] = OF_ONE_RUN
    """Layers that are put away meanwhile; asked for, they come back."""


@dataclass
class Branch:
    """One run on a frame, and the settings it ended up with."""

    name: str
    run: Run
    tools: Toolbox
    start: Session
    """The settings it began with."""
    changes: tuple[Change, ...]
    """Settings changed on the way, as a session file keeps them."""
    evaluators: tuple[tuple[int, CachedEvaluator], ...]
    """(k, evaluator): from iteration k + 1 on it evaluates, where settings of the score changed on the way."""
    recording: Path | None = None
    """The file that it was read from; None = it was computed here."""
    missing: str = ""
    """What of that file could not be read, or was never written, a sentence; "" = nothing."""
    _marks: list[tuple[Mark, ...]] = field(default_factory=list)
    _discarded: dict[int, dict[int, Discarded]] = field(default_factory=dict)
    """By the number of iterations made."""
    _doubts: dict[bool, tuple[str, ...]] = field(default_factory=dict)
    """By whether the run was over."""

    @cached_property
    def settings(self) -> Session:
        """Those that it ends up with: a session that was read may change them on the way."""
        return changed(self.tools.session, merged([c.settings for c in in_order(self.changes)]))

    def exploration_after(self, index: int) -> float:
        """The weight c of UCB's bonus in the choice that follows iteration ``index``."""
        c = self.start.method.exploration
        for change in in_order(self.changes):
            if change.after_iteration <= index:
                c = change.settings.get("method", {}).get("exploration", c)
        return c

    @property
    def evaluator(self) -> CachedEvaluator:
        """Evaluates by the settings of the iteration at the cursor; at the end of a finished run by its last ones."""
        return self.evaluator_of(self.run.cursor + self.run.at_end)

    @property
    def final_evaluator(self) -> CachedEvaluator:
        """Evaluates by the settings that hold after the last iteration made."""
        return self.evaluator_of(self.run.length + 1)

    @property
    def state(self) -> Any:
        """The state at the cursor, with scores of the settings that :attr:`evaluator` evaluates by."""
        return self.run.state if self.run.at_end else self.run.state_scored_at(self.run.cursor)

    def evaluator_of(self, index: int) -> CachedEvaluator:
        """Evaluates by the settings of an iteration; of the first where ``index`` is 0."""
        return next(evaluator for k, evaluator in reversed(self.evaluators) if k < max(index, 1))

    def marks(self, instance_id: int | None = None) -> tuple[Mark, ...]:
        """All marks of the history, or those of one object."""
        for iteration in self.run.iterations[len(self._marks) :]:
            target = next(t for t in self.run.problem.targets if t.instance.instance_id == iteration.instance_id)
            before = self.evaluator.errors(target, iteration.stages[0].T_cam_obj)
            after = self.evaluator.errors(target, iteration.accepted_stage.T_cam_obj)
            growth = after.add_s_mm - before.add_s_mm if before and after else None
            self._marks.append(marks_of(iteration, growth))
        pairs = zip(self.run.iterations, self._marks, strict=False)
        marks = once_per_object([(i, marks) for i, marks in pairs if instance_id in (None, i.instance_id)])
        given_up = [
            Mark(d.given_up, "discarded", d.in_words(self.run.problem.target(own).model.name), RED)
            for own, d in self.discarded().items()
            if instance_id in (None, own)
        ]
        return tuple(sorted((*marks, *given_up), key=lambda mark: mark.iteration)) if given_up else marks

    def discarded(self) -> dict[int, Discarded]:
        """The correct poses that the finished run gave up for wrong answers, by instance_id; empty before its end."""
        run = self.run
        if not run.is_done or not method_of(self.settings.method.name).verifies:
            return {}
        if run.length not in self._discarded:
            given_up: dict[int, Discarded] = {}
            for target, answer in zip(run.problem.targets, run.final_state.best, strict=True):
                own = run.iterations_of(target.instance.instance_id)
                of_object = discarded(own, answer, partial(self._is_correct, target))
                if of_object is not None:
                    given_up[target.instance.instance_id] = of_object
            self._discarded[run.length] = given_up
        return self._discarded[run.length]

    def _is_correct(self, target: Target, T_cam_obj: Float) -> bool:
        errors = self.evaluator.errors(target, T_cam_obj)
        return errors is not None and errors.relative < CORRECT

    def doubts(self) -> tuple[str, ...]:
        """What of the data does not fit together: by ground truth, else by the initial poses and then the answers."""
        problem, run = self.run.problem, self.run
        if problem.doubts:
            return problem.doubts
        if run.is_done not in self._doubts:
            from verefine_viz.diagnosis.data_doubts import answer_doubts  # Loads what draws models.

            answers = run.final_state.best if run.is_done else [None] * len(problem.targets)
            poses = [best and best.T_cam_obj for best in answers]
            self._doubts[run.is_done] = answer_doubts(problem, poses, self.settings.score.colour_weight)
        return self._doubts[run.is_done]


@dataclass
class FrameWork:
    """A frame with its runs."""

    branches: list[Branch]
    index: int = 0
    comparison: ComparisonChoice | None = None
    """The comparison of the open branch with another; None = nothing is compared."""

    @property
    def branch(self) -> Branch:
        return self.branches[self.index]

    @property
    def problem(self) -> Problem:
        """What the open branch solves; others of the frame may have other initial poses, or another order."""
        return self.branch.run.problem
