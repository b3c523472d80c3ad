"""What drawing needs to know of a problem: small enough to be kept in the recording itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import RunState
from verefine_viz.recording.entities import branch


@dataclass(frozen=True)
class Branch:
    """One object's part of the recording."""

    instance_id: int
    obj_id: int
    name: str
    """Of its entities: ``3_mug``."""
    sources: tuple[str, ...]
    """Where each hypothesis comes from."""
    initial_scores: tuple[float, ...]
    """f̄ of each hypothesis before the first iteration."""
    has_truth: bool

    @property
    def n_arms(self) -> int:
        return len(self.sources)


@dataclass(frozen=True)
class Layout:
    """All objects of the recorded problem, in order."""

    branches: tuple[Branch, ...]

    def branch(self, instance_id: int) -> Branch:
        return next(b for b in self.branches if b.instance_id == instance_id)

    def to_json(self) -> str:
        return json.dumps(asdict(self), separators=(",", ":"))


def layout_of(problem: Problem, state: RunState) -> Layout:
    """The layout of a problem, given the state before the first iteration."""
    branches: list[Branch] = []
    for instance, scores in zip(problem.instances, state.initial, strict=True):
        sources = tuple(h.source for h in instance.hypotheses)
        initial: Sequence[float] = scores.score.tolist() if scores is not None else [0.0] * len(sources)
        has_truth = instance.T_cam_obj_gt is not None
        name = branch(instance, problem)
        branches.append(Branch(instance.instance_id, instance.obj_id, name, sources, tuple(initial), has_truth))
    return Layout(tuple(branches))


def layout_from_json(text: str) -> Layout:
    """The inverse of :meth:`Layout.to_json`."""
    branches = json.loads(text)["branches"]
    return Layout(
        tuple(
            Branch(**{**b, "sources": tuple(b["sources"]), "initial_scores": tuple(b["initial_scores"])})
            for b in branches
        )
    )
