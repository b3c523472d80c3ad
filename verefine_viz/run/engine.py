"""A run: a method on a problem, with its whole history and a cursor in it.

It never draws, logs, sleeps or asks. Watchers see every record and change nothing. Back is a cursor move; a fork is a
new run that shares the history up to an iteration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Method, RunState, Verifier, Watcher
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.settings import Edit, Session
from verefine_viz.run.plausible_verifier import are_comparable
from verefine_viz.run.record import RunRecord
from verefine_viz.run.recorded_run import ReplayedMethod
from verefine_viz.run.run_header import header_of


@dataclass(frozen=True, eq=False)
class Plan:
    """What is done when: the method, changes of it, and edited poses."""

    method: Method[Any]
    changes: Mapping[int, Method[Any]]
    """The method that holds after iteration k."""
    edits: tuple[Edit, ...] = ()

    def method_at(self, k: int) -> Method[Any]:
        """The method that makes iteration ``k + 1``."""
        latest = max((at for at in self.changes if at <= k), default=None)
        return self.method if latest is None else self.changes[latest]

    def begun(self, problem: Problem) -> RunState:
        """The state before iteration 1."""
        method = self.method_at(0)
        return self._edited(method.start(problem), 0, method)

    def after(self, k: int, made: RunState) -> RunState:
        """The state from which iteration ``k + 1`` is made, k ≥ 1, given the one that iteration ``k`` made.

        Scores by different settings must not be weighed against one another: where they change, all are computed again.

        Raises:
            InputError: the method that takes over cannot go on with another score.
        """
        new = self.method_at(k)
        return self._edited(new.rescored(made) if self.scores_change(k) else made, k, new)

    def before(self, k: int, made: RunState) -> RunState:
        """The state by the method that made iteration ``k``: nothing is scored by the one that takes over."""
        return self._edited(made, k, self.method_at(k - 1))

    def scores_change(self, k: int) -> bool:
        """Whether settings of the score change after iteration ``k`` ≥ 1."""
        return k in self.changes and not are_comparable(self.changes[k].verifier, self.method_at(k - 1).verifier)

    def _edited(self, state: RunState, k: int, by: Method[Any]) -> RunState:
        """``state`` after iteration ``k`` with the poses that were edited there."""
        for edit in self.edits:
            if edit.after_iteration == k:
                T_cam_obj = np.array(edit.T_cam_obj).reshape(4, 4)
                state = by.edit(state, edit.instance, edit.hypothesis, T_cam_obj)
        return state


@dataclass(frozen=True, eq=False)
class _History:
    """What a run has made: states before iterations 1, 2, … and after the last one, and the iterations."""

    states: tuple[RunState, ...]
    made: tuple[RunState, ...] = ()
    iterations: tuple[Iteration, ...] = ()


class Run:
    """A method on a problem, step by step."""

    def __init__(
        self,
        method: Method[Any],
        problem: Problem,
        watchers: Sequence[Watcher[Any]] = (),
        edits: Sequence[Edit] = (),
        changes: Mapping[int, Method[Any]] | None = None,
        history: _History | None = None,
    ) -> None:
        """Scores the hypotheses; iteration 1 is not yet made, unless another run's history is given.

        Args:
            method: the algorithm.
            problem: the frame.
            watchers: see the start, every new iteration, and the end, in this order.
            edits: poses to be replaced after the iteration they name.
            changes: methods that take over after iteration k.
            history: what a fork shares with the run that it leaves.
        """
        self._plan = Plan(method, dict(changes or {}), tuple(edits))
        history = history or _History((self._plan.begun(problem),))
        self._states = list(history.states)
        self._made = list(history.made)
        """What each iteration made, before settings were changed or poses edited."""
        self._iterations = list(history.iterations)
        self._watchers = tuple(watchers)
        self._finished = False
        self._again: Callable[[], Run] | None = None
        """For a record: begins the run again."""
        self.cursor = len(history.iterations)
        """The iteration that is shown; 0 = before the first."""
        for watcher in self._watchers:
            self._show_history(watcher)
        self._finish_if_done()

    @classmethod
    def from_record(
        cls,
        record: RunRecord,
        problem: Problem,
        watchers: Sequence[Watcher[Any]] = (),
        again: Callable[[], Run] | None = None,
    ) -> Run:
        """The run of a record, as far as it goes, with the cursor before its first iteration.

        Args:
            record: what was read.
            problem: its frame.
            watchers: see all of it.
            again: begins the same run again, for a fork, which computes the shared iterations again; None = it cannot.

        Raises:
            InputError: the frame does not hold what was recorded.
        """
        run = cls(cast(Any, ReplayedMethod(record)), problem, watchers)
        run.finish()
        run.seek(0)
        run._again = again
        return run

    def record(self, session: Session, weights: Mapping[str, str]) -> RunRecord:
        """The record of the run so far; ``session`` is what it is a run of, ``weights`` as in :func:`header_of`."""
        return RunRecord(header_of(self.problem, self._states[0], session, weights), self.iterations)

    @property
    def problem(self) -> Problem:
        return self._states[0].problem

    @property
    def method(self) -> Method[Any]:
        """The method that makes the iteration after the cursor."""
        return self._plan.method_at(self.cursor)

    def method_of(self, index: int) -> Method[Any]:
        """The method that makes iteration ``index`` = 1, 2, …"""
        return self._plan.method_at(index - 1)

    @property
    def final_verifier(self) -> Verifier:
        """What the answers so far are scored by."""
        return self._plan.method_at(self.length).verifier

    @property
    def edits(self) -> tuple[Edit, ...]:
        return self._plan.edits

    @property
    def length(self) -> int:
        """Iterations made so far."""
        return len(self._iterations)

    @property
    def state(self) -> Any:
        """The state at the cursor."""
        return self._states[self.cursor]

    def state_at(self, k: int) -> Any:
        """The state after iteration ``k``; 0 = before the first."""
        return self._states[k]

    def state_scored_at(self, k: int) -> Any:
        """The state after iteration ``k`` with scores of its own settings, also where others hold from there on."""
        is_last_of_scale = k > 0 and self._plan.scores_change(k)
        return self._plan.before(k, self._made[k - 1]) if is_last_of_scale else self._states[k]

    @property
    def final_state(self) -> Any:
        """The state after the last iteration made."""
        return self._states[-1]

    @property
    def iteration(self) -> Iteration | None:
        """The record at the cursor; None before the first iteration."""
        return self._iterations[self.cursor - 1] if self.cursor else None

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """All records made so far."""
        return tuple(self._iterations)

    def iterations_of(self, instance_id: int) -> tuple[Iteration, ...]:
        """The records of one object made so far."""
        return tuple(i for i in self._iterations if i.instance_id == instance_id)

    def best_at(self, k: int) -> dict[int, Best]:
        """The answers after iteration ``k``, by instance_id; an object without hypotheses has none."""
        ids = [i.instance_id for i in self.problem.instances]
        return {i: best for i, best in zip(ids, self._states[k].best, strict=True) if best is not None}

    @property
    def n_iterations(self) -> int:
        """How many iterations the whole run will have."""
        return self._plan.method_at(self.length).n_iterations(self._states[-1])

    @property
    def is_done(self) -> bool:
        """Whether no further iteration can be made at the end of the history."""
        return self._plan.method_at(self.length).is_done(self._states[-1])

    @property
    def at_end(self) -> bool:
        """Whether the cursor is at the end of a run that is over."""
        return self.cursor == self.length and self.is_done

    def step(self) -> Iteration:
        """One iteration forward: through the history, and past its end by computing.

        Raises:
            InputError: the run is over.
        """
        if self.cursor == self.length:
            self._compute()
        self.cursor += 1
        return self._iterations[self.cursor - 1]

    def seek(self, k: int) -> Iteration | None:
        """Moves the cursor to iteration ``k`` of the history; 0 = before the first.

        Raises:
            InputError: that iteration was not made yet.
        """
        if not 0 <= k <= self.length:
            raise InputError(f"iteration {k} is not in the history; it has 0 to {self.length}")
        self.cursor = k
        return self.iteration

    def back(self) -> Iteration | None:
        """One iteration back; stays at the start."""
        return self.seek(max(self.cursor - 1, 0))

    def finish(self) -> RunState:
        """Runs to the end and gives the final state."""
        while not self.is_done:
            self._compute()
        self.cursor = self.length
        return self._states[-1]

    def fork(
        self,
        k: int,
        method: Method[Any] | None = None,
        edit: tuple[int, int, Float] | None = None,
        watchers: Sequence[Watcher[Any]] = (),
    ) -> Run:
        """A new run that shares iterations 1 … k and goes on with another method, or from an edited pose.

        Where settings of the score change, everything known is re-scored: hypotheses, their means, the best poses.

        Args:
            k: the iteration after which the runs part.
            method: takes over after ``k``; None = the same.
            edit: (instance_id, hypothesis index, T_cam_obj (4, 4)); it goes on there, before others.
            watchers: of the new run; they see the shared iterations first.

        Raises:
            InputError: there is no such iteration, or the method cannot go on with another score.
        """
        if not 0 <= k <= self.length:
            raise InputError(f"cannot fork at iteration {k}; the history has 0 to {self.length}")
        if isinstance(self._plan.method, ReplayedMethod):
            if self._again is None:
                raise InputError("a run that was read cannot go on without its data; open its session")
            run = self._again()
            for _ in range(k):
                run.step()
            return run.fork(k, method, edit, watchers)
        changes = {at: m for at, m in self._plan.changes.items() if at <= k}
        if method is not None:
            changes[k] = method
        edits = tuple(e for e in self._plan.edits if e.after_iteration <= k)
        if edit is not None:
            instance_id, arm, T_cam_obj = edit
            values = tuple(float(x) for x in np.asarray(T_cam_obj).ravel())
            edit_here = Edit(
                after_iteration=k, instance=instance_id, hypothesis=arm, T_cam_obj=values, frame=self.problem.frame
            )
            edits = (*edits, edit_here)
        plan = Plan(self._plan.method, changes, edits)
        last = plan.after(k, self._made[k - 1]) if k else plan.begun(self.problem)
        history = _History((*self._states[:k], last), tuple(self._made[:k]), tuple(self._iterations[:k]))
        return Run(plan.method, self.problem, watchers, plan.edits, plan.changes, history)

    def show(self, watchers: Sequence[Watcher[Any]]) -> None:
        """Show watchers the run so far, from its start to its end."""
        for watcher in watchers:
            self._show_history(watcher)
            watcher.on_finish(self._states[-1])

    def _show_history(self, watcher: Watcher[Any]) -> None:
        watcher.on_start(self._states[0])
        for state, iteration in zip(self._states[1:], self._iterations, strict=True):
            watcher.on_iteration(state, iteration)

    def close(self) -> None:
        """Calls the watchers' ``on_finish``, once."""
        if not self._finished:
            self._finished = True
            for watcher in self._watchers:
                watcher.on_finish(self._states[-1])

    def _compute(self) -> None:
        k = self.length
        state, iteration = self._plan.method_at(k).step(self._states[-1])
        self._made.append(state)
        state = self._plan.after(k + 1, state)
        self._states.append(state)
        self._iterations.append(iteration)
        for watcher in self._watchers:
            watcher.on_iteration(state, iteration)
        self._finish_if_done()

    def _finish_if_done(self) -> None:
        if self.is_done:
            self.close()
