"""One run on a frame, and the runs that a frame has."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Change, Session
from verefine_viz.session.engine import Run
from verefine_viz.session.files import changed
from verefine_viz.viewer.changes import in_order, merged
from verefine_viz.viewer.judge import Judge
from verefine_viz.viewer.marks import Mark, marks_of, once_per_object
from verefine_viz.viewer.sides import Sides
from verefine_viz.viewer.tools import Tools


@dataclass
class Branch:
    """One run on a frame, and the settings it ended up with."""

    name: str
    run: Run
    tools: Tools
    start: Session
    """The settings it began with."""
    changes: tuple[Change, ...]
    """Settings changed on the way, as a session file keeps them."""
    judges: tuple[tuple[int, Judge], ...]
    """(k, judge): from iteration k + 1 on it judges, where settings of the score changed on the way."""
    recording: Path | None = None
    """The file that it was read from; None = it was computed here."""
    _marks: list[tuple[Mark, ...]] = field(default_factory=list)
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
    def judge(self) -> Judge:
        """Judges by the settings of the iteration that is looked at; at the end of a finished run by its last ones."""
        return self.judge_of(self.run.cursor + self.run.at_end)

    @property
    def final_judge(self) -> Judge:
        """Judges by the settings that hold after the last iteration made."""
        return self.judge_of(self.run.length + 1)

    @property
    def state(self) -> Any:
        """The state at the cursor, with scores of the settings that :attr:`judge` judges by."""
        return self.run.state if self.run.at_end else self.run.state_scored_at(self.run.cursor)

    def judge_of(self, index: int) -> Judge:
        """Judges by the settings of an iteration; of the first where ``index`` is 0."""
        return next(judge for k, judge in reversed(self.judges) if k < max(index, 1))

    def marks(self, instance_id: int | None = None) -> tuple[Mark, ...]:
        """All marks of the history, or those of one object."""
        for iteration in self.run.iterations[len(self._marks) :]:
            target = next(t for t in self.run.problem.targets if t.instance.instance_id == iteration.instance_id)
            before = self.judge.errors(target, iteration.stages[0].T_cam_obj)
            after = self.judge.errors(target, iteration.accepted_stage.T_cam_obj)
            growth = after.add_s_mm - before.add_s_mm if before and after else None
            self._marks.append(marks_of(iteration, growth))
        pairs = zip(self.run.iterations, self._marks, strict=False)
        return once_per_object([(i, marks) for i, marks in pairs if instance_id in (None, i.instance_id)])

    def doubts(self) -> tuple[str, ...]:
        """What of the data does not fit together: as true poses show it, else its first poses and then its answers."""
        problem, run = self.run.problem, self.run
        if problem.doubts:
            return problem.doubts
        if run.is_done not in self._doubts:
            from verefine_viz.diagnosis.data_doubts import answer_doubts  # Loads what draws models.

            answers = run.final_state.best if run.is_done else [None] * len(problem.targets)
            self._doubts[run.is_done] = answer_doubts(problem, [best and best.T_cam_obj for best in answers])
        return self._doubts[run.is_done]


@dataclass
class FrameWork:
    """A frame with its runs."""

    branches: list[Branch]
    index: int = 0
    sides: Sides | None = None
    """The comparison of the open branch with another; None = it is looked at alone."""

    @property
    def branch(self) -> Branch:
        return self.branches[self.index]

    @property
    def problem(self) -> Problem:
        """What the open branch solves; others of the frame may have other first poses, or another order."""
        return self.branch.run.problem
