"""The wants that a run in a file answers: those of its iterations, its start and its answers.

``web/wants.js`` says what the page wants at a moment. This module lists the moments in a file, with every pose that can
be looked at there; ``tests/page/test_shown_moments.py`` compares both.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal

import msgspec

from verefine_viz.page.frame_messages import BranchListed, FrameMessage
from verefine_viz.page.run_messages import IterationRow, RunMessage, VerdictMessage
from verefine_viz.page.wire import Pose

Json = dict[str, Any]
"""A want as the browser writes it."""
WithMaps = Literal["end", "marked", "all"]
"""Which iterations have score maps: end = those that made the answers or that a verdict names; marked = marked ones,
too; all."""


class SharedBranch:
    """A branch as described by its messages.

    Args:
        frame: what is open.
        branch: its entry in the message ``branches``.
        run: its rows.
        verdict: on it; None while it is not over.
        maps: which iterations have score maps.
        only: instances that are shown in depth; None = all.
    """

    def __init__(
        self,
        frame: FrameMessage,
        branch: BranchListed,
        run: RunMessage,
        verdict: VerdictMessage | None,
        maps: WithMaps,
        only: Collection[int] | None = None,
    ) -> None:
        self._branch, self._rows, self._marks, self._maps = branch, run.rows, run.marks, maps
        self._objects = {o.id: o for o in frame.objects if o.id is not None and not o.left_out}
        self._focus = {obj for obj in self._objects if only is None or obj in only}
        self._is_whole = only is None
        self._starts = {obj: (run.start or {}).get(obj, o.arms) for obj, o in self._objects.items()}
        self._truths = {obj: o.gt for obj, o in self._objects.items() if o.gt is not None}
        self._doubts = frame.doubts if verdict is None else verdict.doubts
        self._results = {o.obj: o for o in verdict.objects} if verdict is not None else {}

    @cached_property
    def _answers(self) -> dict[int, Pose]:
        """The answers by object, in the frame's order."""
        results = {obj: self._results[obj].T for obj in self._objects if obj in self._results}
        return {obj: T for obj, T in results.items() if T is not None}

    def wants(self) -> Iterator[Json]:
        """Return all wants that the page may have; one may occur twice."""
        for row in self._rows:
            if row.obj in self._focus and (self._maps == "all" or row.k in self._shown):
                yield from self._of_iteration(row)
        for obj, arms in self._starts.items():
            yield {"what": "outlines", "obj": obj, "poses": self._all_poses(obj)}
            if obj in self._focus and self._maps != "end":
                yield from self._maps_of(0, obj, self._truths.get(obj), *(arm.T for arm in arms))
            if obj in self._focus and obj in self._answers:
                yield from self._of_answer(obj)
        if any(obj in self._focus for obj in self._answers):
            yield {"what": "sequence", "run": "", "scene": None, "done": 1}
        for k in range(len(self._doubts)):
            yield {"what": "doubt", "index": k, "branch": self._branch.index}
        if self._is_whole and len(self._objects) > 1:
            yield from self._together()

    @cached_property
    def _shown(self) -> set[int]:
        """Iterations that have score maps, if not all have."""
        ks = {k for o in self._results.values() for k in (o.k, *(finding.k for finding in o.findings)) if k is not None}
        if self._maps == "marked":
            ks |= {mark.k for mark in self._marks if mark.tone != "switched"}  # Those that may come at each iteration.
        return ks

    def _of_iteration(self, row: IterationRow) -> Iterator[Json]:
        k, obj, stages = row.k, row.obj, {stage.name: stage.T for stage in row.stages}
        start, truth = self._starts[obj][row.arm].T, self._truths.get(obj)
        yield from self._maps_of(k, obj, *stages.values(), row.best.T, start, truth)
        edit = next((e.T for e in self._branch.edits if (e.k, e.obj) == (k, obj)), None)
        compared = {"current": stages.get("current"), "simulated": stages.get("simulated")}
        if edit is not None:
            compared = {}
        compared |= {"accepted": stages[row.accepted], "edited": edit}
        yield self._physics(k, obj, compared, self._standing(row, edit), k)
        if "refined" in stages:
            yield {"what": "crops", "branch": self._branch.index, "k": k}

    def _of_answer(self, obj: int) -> Iterator[Json]:
        """Return the wants at the end of the run."""
        n, result, T = len(self._rows), self._results[obj], self._answers[obj]
        runner_up = result.runner_up and result.runner_up.T
        yield from self._maps_of(result.k or 0, obj, T)
        yield from self._maps_of(n, obj, self._truths.get(obj), self._starts[obj][result.arm or 0].T, runner_up, T)
        stands = [[obj, T, False] for obj, T in self._answers.items()]
        last = next((row.k for row in reversed(self._rows) if row.obj == obj), None)
        yield self._physics(n + 1, obj, {"best": T}, stands, last)
        around = {"what": "landscape", "branch": self._branch.index, "k": self._scored(n + 1), "obj": obj, "T": T}
        yield {**around, "part": "curves"}
        yield {**around, "part": "slice", "axes": [5, 0]}
        yield {**around, "part": "other"}
        if result.k or last:
            yield {"what": "crops", "branch": self._branch.index, "k": result.k or last}
        if result.film:
            moments = msgspec.to_builtins([one.drawn for one in result.film])
            yield {"what": "film", "obj": obj, "branch": self._branch.index, "moments": moments}
        yield {"what": "recorded", "branch": self._branch.index, "obj": obj, "done": n}

    def _together(self) -> Iterator[Json]:
        """Return the wants of maps of all objects in one picture: at their answers, and at the ground truth."""
        truly = {obj: self._truths.get(obj, T) for obj, T in self._answers.items()} if self._truths else {}
        for Ts in (self._answers, truly):
            poses = [[obj, T] for obj, T in Ts.items()]
            if poses:
                k = self._scored(len(self._rows))
                yield {"what": "maps", "branch": self._branch.index, "k": k, "obj": None, "poses": poses}

    def _scored(self, k: int) -> int:
        """Return the first iteration with the same settings of the score as iteration k."""
        return 1 + max((after for after in self._branch.scored if after < max(k, 1)), default=0)

    def _maps_of(self, k: int, obj: int, *poses: Pose | None) -> Iterator[Json]:
        for T in poses:
            if T is not None:
                yield {"what": "maps", "branch": self._branch.index, "k": self._scored(k), "obj": obj, "T": T}
                yield {"what": "shaded", "obj": obj, "T": T}

    def _physics(
        self, k: int, obj: int, poses: Mapping[str, Pose | None], stands: Sequence[Any], path: int | None
    ) -> Json:
        given = [(name, T) for name, T in poses.items() if T is not None]
        once = [[name, T] for i, (name, T) in enumerate(given) if T not in [other for _, other in given[i + 1 :]]]
        of = {"branch": self._branch.index, "k": self._scored(k), "obj": obj, "alone": False}
        return {"what": "physics", **of, "stands": stands, "poses": once, "path": path}

    def _standing(self, row: IterationRow, edit: Pose | None) -> list[Any]:
        """Return the pose of every object after an iteration, as ``sceneAt`` of ``web/moment.js``."""
        placed = {one.obj: one.T for one in row.placed}
        placed |= {one.obj: one.T for one in (row.tree.rollout if row.tree else ())}
        placed[row.obj] = edit or next(s.T for s in row.stages if s.name == row.accepted)
        stands = []
        for obj in self._objects:
            own = [one.best.T for one in self._rows[: row.k] if one.obj == obj]
            start = max(self._starts[obj], key=lambda arm: arm.score or 0.0, default=None)
            T = placed.get(obj) or (own[-1] if own else start and start.T)
            if T is not None:
                stands.append([obj, T, not own and obj not in placed])
        return stands

    def _all_poses(self, obj: int) -> list[Pose]:
        """Return every pose of an object that the run has, once each."""
        poses = [*(arm.T for arm in self._starts[obj]), self._truths.get(obj)]
        for row in self._rows:
            poses += [one.T for one in row.placed if one.obj == obj]
            if row.obj == obj:
                poses += [stage.T for stage in row.stages]
                poses += [row.best.T, *(arm.T for arm in row.arms)]
        if (result := self._results.get(obj)) is not None:
            poses += [result.T, result.also_fits, result.runner_up and result.runner_up.T]
            poses += result.allowed.poses if result.allowed else ()
        return list({tuple(T): T for T in poses if T is not None}.values())
