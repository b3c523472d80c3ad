"""A branch: one run on a frame, its final settings, and the evaluators of its iterations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.doubt import Doubt
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Change, Session
from verefine_viz.diagnosis.lost_poses import Discarded, discarded
from verefine_viz.diagnosis.measured_heights import MeasuredHeights, measured_heights
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page.data_check import DataCheck
from verefine_viz.page.marks import RED, Mark, listed_marks, marks_of
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import changed
from verefine_viz.run.variants import sorted_changes

if TYPE_CHECKING:
    from verefine_viz.page.evaluator import CachedEvaluator
    from verefine_viz.run.toolbox import Toolbox

Settings = Mapping[str, Any]
"""Changed settings by dotted name, as verbs have them."""
BySection = dict[str, dict[str, Any]]
"""Changed settings by section, as session files have them."""


def group_by_section(settings: Settings) -> BySection:
    """Sort settings into sections: {"method.exploration": 0.2} as {"method": {"exploration": 0.2}}."""
    out: BySection = {}
    for name, value in settings.items():
        section, _, key = name.partition(".")
        out.setdefault(section, {})[key] = value
    return out


def merged(parts: Sequence[Mapping[str, Mapping[str, Any]]]) -> BySection:
    """Put several changes together; later ones win."""
    out: BySection = {}
    for part in parts:
        for section, values in part.items():
            out.setdefault(section, {}).update(values)
    return out


@dataclass(eq=False)
class Branch:
    """One run on a frame."""

    index: int
    """Its number, which no other branch of the session gets."""
    name: str
    run: Run
    tools: Toolbox
    data: DataCheck
    """Doubts about the frame's data."""
    start: Session
    """The settings it began with."""
    changes: tuple[Change, ...]
    """Settings changed on the way, as a session file has them."""
    evaluators: tuple[tuple[int, CachedEvaluator], ...]
    """(k, evaluator): the evaluator from iteration k + 1 on, several where settings of the score changed on the way."""
    parent: int | None = None
    """The branch that it forked from."""
    forked_at: int = 0
    recording: Path | None = None
    """The file that it was read from; None = it was computed here."""
    missing: str = ""
    """A sentence on what part of that file could not be read, or was never written; "" = none."""
    _marks: list[tuple[Mark, ...]] = field(default_factory=list)
    _discarded: dict[int, dict[int, Discarded]] = field(default_factory=dict)
    """By the number of iterations made."""
    _doubts: dict[bool, tuple[Doubt, ...]] = field(default_factory=dict)
    """By whether the run was over."""

    @cached_property
    def settings(self) -> Session:
        """The final settings: a session that was read may change them on the way."""
        return changed(self.tools.session, merged([c.settings for c in sorted_changes(self.changes)]))

    @cached_property
    def final_tools(self) -> Toolbox:
        """The tools with the final settings."""
        return self.tools.changed(merged([c.settings for c in sorted_changes(self.changes)]))

    def refiner_of(self, index: int) -> Refiner | None:
        """Return the refiner of iteration ``index``; that of a recording is made again, as only its poses are recorded.

        Raises:
            SettingsError: this program does not have the refiner of a recording.
        """
        return self.run.method_of(index).refiner if self.recording is None else self.tools.refiner_of(index)

    def evaluator_of(self, k: int) -> CachedEvaluator:
        """Return the evaluator with the settings of iteration ``k``; of the first iteration where ``k`` is 0."""
        return next(evaluator for after, evaluator in reversed(self.evaluators) if after < max(k, 1))

    def iteration(self, k: int) -> Iteration:
        """Return iteration ``k``.

        Raises:
            InputError: it was not made.
        """
        if not 1 <= k <= self.run.length:
            raise InputError(f"iteration {k} was not made; the run has {self.run.length}")
        return self.run.iterations[k - 1]

    @property
    def final_evaluator(self) -> CachedEvaluator:
        """The evaluator with the settings after the last iteration made."""
        return self.evaluator_of(self.run.length + 1)

    @property
    def is_over(self) -> bool:
        """Whether the run is over and complete."""
        return self.run.is_done and self.run.length > 0 and not self.missing

    def marks(self) -> tuple[Mark, ...]:
        """Mark the iterations that are worth a look."""
        run, evaluator = self.run, self.evaluator_of(1)
        for iteration in run.iterations[len(self._marks) :]:
            target = run.problem.target(iteration.instance_id)
            before = evaluator.errors(target, iteration.stages[0].T_cam_obj)
            after = evaluator.errors(target, iteration.accepted_stage.T_cam_obj)
            growth = after.add_s_mm - before.add_s_mm if before and after else None
            self._marks.append(marks_of(iteration, growth))
        marks = listed_marks(list(zip(run.iterations, self._marks, strict=False)))
        given_up = [
            Mark(d.given_up, own, "discarded", d.describe(run.problem.target(own).model.name), RED)
            for own, d in self.discarded().items()
        ]
        return tuple(sorted((*marks, *given_up), key=lambda mark: mark.k))

    def discarded(self) -> dict[int, Discarded]:
        """Find the correct poses that the finished run discarded for wrong answers, by instance_id."""
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
        errors = self.final_evaluator.errors(target, T_cam_obj)
        return errors is not None and errors.is_correct

    def measured_heights(self) -> MeasuredHeights | None:
        """Bias of the objects' heights in the depth image, as the answers show it; None before the end, or where there
        is none.
        """
        return measured_heights(self.run.problem, self.run.final_state.best) if self.is_over else None

    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about the data: those that show without a run, and those by its answers."""
        problem, run = self.run.problem, self.run
        if of_frame := self.data.doubts():
            return of_frame
        if run.is_done not in self._doubts:
            from verefine_viz.diagnosis.data_doubts import answer_doubts  # Loads what draws models.

            answers = run.final_state.best if run.is_done else [None] * len(problem.targets)
            poses = [best and best.T_cam_obj for best in answers]
            self._doubts[run.is_done] = answer_doubts(problem, poses, self.settings.score.colour_weight)
        return self._doubts[run.is_done]
