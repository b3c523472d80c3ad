"""One iteration as a recording keeps it: every number exact, nothing that has to be computed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import (
    TIMING,
    Choice,
    Contacts,
    Iteration,
    PlacedPose,
    SceneRecord,
    SimulatedPath,
    TreeStep,
)
from verefine_viz.recording.entry import Entry

_UNKNOWN = (np.nan, np.nan, np.nan)
_NO_PIXELS = (-1,) * 7
NO_PATH = np.zeros((0, 4, 4), np.float32)
NO_CONTACTS = np.zeros((0, 9), np.float32)


@dataclass(frozen=True, eq=False)
class SceneParts:
    """What an iteration says about other objects than the one it worked on."""

    placed: tuple[PlacedPose, ...] = ()
    scene_pass: int | None = None
    scene: SceneRecord | None = None
    tree: TreeStep | None = None


ALONE = SceneParts()
"""Of an iteration that knows one object only."""


@dataclass(frozen=True, eq=False)
class Row:
    """An iteration as flat columns, the same when read back.

    Poses are the run's float64 bits. Contacts and the way between the first and the last simulated pose are there to be
    drawn and are kept in single precision.
    """

    index: int
    """1, 2, … over the whole run."""
    instance_id: int
    obj_id: int
    arm: int
    arm_iteration: int
    stages: tuple[str, ...]
    """Names of the n poses of this iteration, in the order they came about."""
    accepted: str
    Ts_cam_obj: Float
    """(n, 4, 4) [m]."""
    scores: Float
    """(n, 3) f̄, mean f_d, mean f_n; NaN where the method did not judge the pose."""
    pixels: NDArray[np.int64]
    """(n, 7) N, rendered pixels, the five classes; −1 where the method did not judge the pose."""
    best_arm: int
    best_iteration: int
    best_stage: str
    T_best: Float
    """(4, 4) best pose of this object so far [m]."""
    best_score: Float
    """(3,) as a row of ``scores``."""
    best_pixels: NDArray[np.int64]
    """(7,) as a row of ``pixels``."""
    path: NDArray[np.float32]
    """(S + 1, 4, 4) simulated poses [m]; empty without a simulation."""
    contacts: NDArray[np.float32]
    """(k, 9) at the end of the simulation: point [m], normal, depth [m], force [N], partner."""
    choice: Float
    """(4, H) plays, mean, exploration, UCB of each arm; (4, 0) where the method does not choose."""
    reason: str
    """Why this arm, in one sentence."""
    event_kinds: tuple[str, ...]
    event_texts: tuple[str, ...]
    errors: Float
    """(3,) against ground truth: rotation [deg] and translation [mm] of the kept pose, ADD(-S) of the best pose [mm];
    NaN where there is no ground truth."""
    ms: NDArray[np.float32] = field(metadata=TIMING)
    """(n + 1,) time for each pose, then for all scores [ms]."""
    packed: bytes = field(metadata=TIMING)
    """All of it, as an ``Entry``; its times differ from run to run."""
    parts: SceneParts = ALONE
    """What it says about other objects and the scene."""

    def pose(self, stage: str) -> Float | None:
        """The pose (4, 4) of that stage, or None."""
        return self.Ts_cam_obj[self.stages.index(stage)] if stage in self.stages else None

    def score(self, stage: str) -> float:
        """f̄ of that stage; NaN where there is none."""
        return float(self.scores[self.stages.index(stage), 0]) if stage in self.stages else float("nan")

    @property
    def T_accepted(self) -> Float:
        """The pose that was kept (4, 4) [m]."""
        return self.Ts_cam_obj[self.stages.index(self.accepted)]


def row_of(iteration: Iteration, errors: Float) -> Row:
    """The columns of a record, with the ``errors`` (3,) that :class:`Row` describes."""
    return rows_of([Entry.of(iteration, errors)])[0]


def rows_of(entries: Sequence[Entry]) -> list[Row]:
    """The columns of records."""
    if not entries:
        return []
    iterations = [entry.iteration for entry in entries]
    # Arrays of all of them are made at once and cut: many small arrays are what costs.
    judged = [score for i in iterations for score in (*[s.score for s in i.stages], i.best.score)]
    scores = np.array([_UNKNOWN if s is None else (s.score, s.depth_fit, s.normal_fit) for s in judged])
    pixels = np.array([_NO_PIXELS if s is None else (s.n_pixels, s.n_rendered, *s.counts) for s in judged], np.int64)
    poses = np.concatenate([T for i in iterations for T in (*[s.T_cam_obj for s in i.stages], i.best.T_cam_obj)])
    poses = poses.reshape(-1, 4, 4)
    ms = np.array([t for i in iterations for t in (*[s.ms for s in i.stages], i.score_ms)], np.float32)
    paths = _paths([i.path for i in iterations])
    contacts = _contacts([last_contacts(i) for i in iterations])
    choices = _choices([i.choice for i in iterations])
    rows: list[Row] = []
    start = 0
    for entry, path, touching, choice in zip(entries, paths, contacts, choices, strict=True):
        i, best = entry.iteration, entry.iteration.best
        end = start + len(i.stages)
        row = Row(
            index=i.index,
            instance_id=i.instance_id,
            obj_id=i.obj_id,
            arm=i.arm,
            arm_iteration=i.arm_iteration,
            stages=tuple([s.name for s in i.stages]),
            accepted=i.accepted,
            Ts_cam_obj=poses[start:end],
            scores=scores[start:end],
            pixels=pixels[start:end],
            best_arm=best.arm,
            best_iteration=best.iteration,
            best_stage=best.stage,
            T_best=poses[end],
            best_score=scores[end],
            best_pixels=pixels[end],
            path=path,
            contacts=touching,
            choice=choice,
            reason="" if i.choice is None else i.choice.reason,
            event_kinds=tuple([e.kind for e in i.events]),
            event_texts=tuple([e.text for e in i.events]),
            errors=entry.errors,
            ms=ms[start : end + 1],
            packed=entry.packed,
            parts=parts_of(i),
        )
        rows.append(row)
        start = end + 1
    return rows


def parts_of(iteration: Iteration) -> SceneParts:
    """What it says about other objects and the scene."""
    i = iteration
    if not i.placed and i.scene_pass is None and i.scene is None and i.tree is None:
        return ALONE
    return SceneParts(i.placed, i.scene_pass, i.scene, i.tree)


def last_contacts(iteration: Iteration) -> Contacts | None:
    """The contacts at the end of its simulation."""
    path = iteration.path
    return path.contacts[-1] if path is not None and path.contacts else None


def _paths(paths: Sequence[SimulatedPath | None]) -> list[NDArray[np.float32]]:
    """``Row.path`` of each."""
    known = [NO_PATH if path is None else path.Ts_cam_obj for path in paths]
    together = np.concatenate(known, dtype=np.float32, casting="same_kind")
    sizes = [len(path) for path in known]
    return [together[end - n : end] for n, end in zip(sizes, accumulate(sizes), strict=True)]


def _choices(choices: Sequence[Choice | None]) -> list[Float]:
    """``Row.choice`` of each."""
    columns = [x for c in choices if c is not None for x in (c.plays, c.mean, c.exploration, c.ucb)]
    together = np.concatenate(columns) if columns else np.zeros(0)
    sizes = [0 if c is None else 4 * len(c.plays) for c in choices]
    return [together[end - n : end].reshape(4, n // 4) for n, end in zip(sizes, accumulate(sizes), strict=True)]


def _contacts(of_rows: Sequence[Contacts | None]) -> list[NDArray[np.float32]]:
    """``Row.contacts`` of each."""
    known = [contacts for contacts in of_rows if contacts is not None]
    sizes = [0 if c is None else len(c.depths_m) for c in of_rows]
    out = np.empty((sum(sizes), 9), np.float32)
    if known:
        out[:, :3] = np.concatenate([c.points_cam for c in known])
        out[:, 3:6] = np.concatenate([c.normals_cam for c in known])
        out[:, 6] = np.concatenate([c.depths_m for c in known])
        out[:, 7] = np.concatenate([c.forces_n for c in known])
        out[:, 8] = np.concatenate([c.others for c in known])
    return [out[end - n : end] for n, end in zip(sizes, accumulate(sizes), strict=True)]
