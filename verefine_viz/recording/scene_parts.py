"""The parts of a record that only whole scenes have, as a few flat columns: ids, poses, numbers, texts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import PlacedPose, SceneRecord, TreeNode, TreeStep
from verefine_viz.core.scores import PoseScore

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class SceneParts:
    """What an iteration says about other objects than the one it worked on."""

    placed: tuple[PlacedPose, ...] = ()
    scene_pass: int | None = None
    scene: SceneRecord | None = None
    tree: TreeStep | None = None


ALONE = SceneParts()
"""Of an iteration that knows one object only."""


@dataclass
class Flat:
    """Everything one after another; what is read comes back in the order in which it was written."""

    ids: list[int] = field(default_factory=list)
    poses: list[Float] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)


def flat_of(parts: SceneParts) -> Flat:
    """The columns of ``parts``; all empty for an iteration that knows one object only."""
    out = Flat()
    if parts is ALONE:
        return out
    _write_poses(out, parts.placed)
    out.ids += [-1 if parts.scene_pass is None else parts.scene_pass, parts.scene is not None, parts.tree is not None]
    if parts.scene is not None:
        _write_scene(out, parts.scene)
    if parts.tree is not None:
        _write_tree(out, parts.tree)
    return out


def parts_of(flat: Flat) -> SceneParts:
    """The inverse of :func:`flat_of`.

    Raises:
        IndexError, ValueError: the columns hold something else.
    """
    if not flat.ids:
        return ALONE
    rest = _Rest(flat)
    placed = rest.placed()
    scene_pass, has_scene, has_tree = rest.id(), rest.id(), rest.id()
    scene = _read_scene(rest) if has_scene else None
    tree = _read_tree(rest) if has_tree else None
    return SceneParts(placed, None if scene_pass < 0 else scene_pass, scene, tree)


def _write_poses(out: Flat, poses: Sequence[PlacedPose]) -> None:
    out.ids += [len(poses), *(p.instance_id for p in poses)]
    out.poses += [p.T_cam_obj for p in poses]


def _write_score(out: Flat, score: PoseScore) -> None:
    out.numbers += [score.score, score.depth_fit, score.normal_fit]
    out.ids += [score.n_pixels, score.n_rendered, *score.counts]


def _write_scene(out: Flat, scene: SceneRecord) -> None:
    _write_poses(out, scene.poses)
    _write_score(out, scene.score)
    _write_score(out, scene.best_known)
    out.numbers += [scene.reward, scene.incumbent_score]
    _write_poses(out, scene.incumbent)


def _write_tree(out: Flat, tree: TreeStep) -> None:
    out.ids += [tree.cluster, len(tree.branch), *tree.branch, tree.node is not None]
    if tree.node is not None:
        out.ids += [tree.node.node, tree.node.parent, tree.node.instance_id, tree.node.arm]
        out.numbers.append(tree.node.lcp)
        out.poses.append(tree.node.T_cam_obj)
    out.ids.append(len(tree.choices))
    out.texts += tree.choices
    _write_poses(out, tree.rollout)
    out.ids += [len(tree.rollout_arms), *tree.rollout_arms]
    out.numbers += [tree.cost_px, tree.incumbent_cost_px]
    _write_poses(out, tree.incumbent)


class _Rest:
    """What is still to be read."""

    def __init__(self, flat: Flat) -> None:
        self._ids, self._poses = iter(flat.ids), iter(flat.poses)
        self._numbers, self._texts = iter(flat.numbers), iter(flat.texts)

    def id(self) -> int:
        return int(_next(self._ids))

    def ids(self) -> tuple[int, ...]:
        return tuple(self.id() for _ in range(self.id()))

    def number(self) -> float:
        return float(_next(self._numbers))

    def pose(self) -> Float:
        return _next(self._poses)

    def texts(self) -> tuple[str, ...]:
        return tuple(_next(self._texts) for _ in range(self.id()))

    def placed(self) -> tuple[PlacedPose, ...]:
        return tuple(PlacedPose(i, self.pose()) for i in self.ids())

    def score(self) -> PoseScore:
        f, depth_fit, normal_fit = self.number(), self.number(), self.number()
        n, n_rendered = self.id(), self.id()
        return PoseScore(
            f, depth_fit, normal_fit, n, n_rendered, (self.id(), self.id(), self.id(), self.id(), self.id())
        )


def _next(values: Iterator[T]) -> T:
    try:
        return next(values)
    except StopIteration:
        raise IndexError("columns of a scene end early") from None


def _read_scene(rest: _Rest) -> SceneRecord:
    poses, score, best_known = rest.placed(), rest.score(), rest.score()
    reward, incumbent_score = rest.number(), rest.number()
    return SceneRecord(poses, score, best_known, reward, rest.placed(), incumbent_score)


def _read_tree(rest: _Rest) -> TreeStep:
    cluster, branch, node = rest.id(), rest.ids(), None
    if rest.id():
        node = TreeNode(rest.id(), rest.id(), rest.id(), rest.id(), rest.number(), rest.pose())
    choices, rollout, arms = rest.texts(), rest.placed(), rest.ids()
    cost_px, incumbent_cost_px = rest.number(), rest.number()
    return TreeStep(cluster, branch, node, choices, rollout, arms, cost_px, rest.placed(), incumbent_cost_px)
