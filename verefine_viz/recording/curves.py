"""Numbers over the iterations: score, UCB and pulls per hypothesis, fit, error and physics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import accumulate

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, RGB, STAGE_COLORS
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Branch
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.row import Row

_SCALARS = rr.Scalars.descriptor_scalars()
_PURPLE: RGB = (190, 90, 220)

FIT = (("simulated", 1), ("simulated", 2), ("refined", 1), ("refined", 2))
"""Stage and column of ``Row.scores``: f_d and f_n of both candidates."""


_PHYSICS = ["simulation moved [mm]", "simulation turned [°]", "refiner moved [mm]", "refiner turned [°]"]
_PHYSICS += ["contacts", "deepest penetration [mm]"]


def curve(name: str, branch_name: str) -> str:
    """Entity of one group of curves."""
    return f"{entities.CURVES}/{name}/{branch_name}"


@lru_cache(maxsize=64)
def styles(branch_name: str, n_arms: int, has_truth: bool) -> tuple[Piece, ...]:
    """Names and colours of all curves of an object, made once for all frames that show it."""
    arms = [f"hypothesis {j + 1}" for j in range(n_arms)]
    colors = [ARM_COLORS[j % len(ARM_COLORS)] for j in range(n_arms)]
    simulated, refined = STAGE_COLORS["simulated"], STAGE_COLORS["refined"]
    looks: dict[str, tuple[list[str], list[RGB]]] = {
        "score": ([*arms, "best"], [*colors, STAGE_COLORS["best"]]),
        "ucb": (arms, colors),
        "pulls": (arms, colors),
        "fit": (
            ["f_d simulated", "f_n simulated", "f_d refined", "f_n refined"],
            [simulated, _darker(simulated), refined, _darker(refined)],
        ),
        "physics": (
            _PHYSICS,
            [simulated, _darker(simulated), refined, _darker(refined), (150, 150, 150), (220, 50, 47)],
        ),
    }
    if has_truth:
        names = ["rotation of the kept pose [°]", "translation of the kept pose [mm]", "ADD(-S) of the best pose [mm]"]
        looks["error"] = (names, [_PURPLE, (150, 150, 150), STAGE_COLORS["best"]])
    return tuple(
        chunks.fixed(
            curve(name, branch_name),
            rr.SeriesLines(
                names=names,
                colors=colours,
                widths=[2.5 if n == "best" else 1.5 for n in names],
                # What was reached holds until something else is.
                interpolation_mode="StepAfter" if name in ("score", "ucb", "pulls") else "Linear",
            ),
        )
        for name, (names, colours) in looks.items()
    )


def start(branch: Branch, before: int) -> Piece:
    """The initial scores, at the iteration before the object's first."""
    first = [*branch.initial_scores, max(branch.initial_scores)]
    return chunks.rows_of(curve("score", branch.name), [before], [columns.numbers(_SCALARS, [first])])


def curves(branch: Branch, rows: Sequence[Row], held: Float) -> Iterator[Piece]:
    """The curves of an object.

    Args:
        branch: the object.
        rows: its rows, in order.
        held: (H,) latest kept score of each hypothesis before these rows; updated in place.
    """
    iterations = [r.index for r in rows]
    scores = np.empty((len(rows), len(held) + 1))
    for k, row in enumerate(rows):
        kept = row.score(row.accepted)
        if kept == kept:
            held[row.arm] = kept
        scores[k, :-1], scores[k, -1] = held, row.best_score[0]
    drawn = {"score": scores, "fit": _fit(rows), "physics": _physics(rows)}
    if rows[0].choice.shape[1]:
        drawn |= {"ucb": np.array([r.choice[3] for r in rows]), "pulls": np.array([r.choice[0] for r in rows])}
    if branch.has_truth:
        drawn["error"] = np.array([r.errors for r in rows])
    for name, values in drawn.items():
        yield chunks.rows_of(curve(name, branch.name), iterations, [columns.numbers(_SCALARS, values)])


def _fit(rows: Sequence[Row]) -> Float:
    firsts, scores = _firsts(rows), np.concatenate([_NOT_JUDGED, *(r.scores for r in rows)])
    return np.stack([scores[_places(rows, firsts, stage)][:, column] for stage, column in FIT], axis=1)


def _physics(rows: Sequence[Row]) -> Float:
    """(n, 6) moved [mm] and turned [°] by simulation and by refiner, contacts, deepest penetration [mm]."""
    firsts, poses = _firsts(rows), np.concatenate([_NO_POSE, *(r.Ts_cam_obj for r in rows)])
    simulated, mixed, refined = (_places(rows, firsts, stage) for stage in ("simulated", "mixed", "refined"))
    current = np.array(firsts)
    simulated, mixed = np.where(simulated, simulated, current), np.where(mixed, mixed, current)
    refined = np.where(refined, refined, mixed)
    out = np.empty((len(rows), 6))
    for start, end, at in ((poses[current], poses[simulated], 0), (poses[mixed], poses[refined], 2)):
        out[:, at] = 1e3 * np.linalg.norm(end[:, :3, 3] - start[:, :3, 3], axis=1)
        cosine = (np.einsum("nij,nij->n", start[:, :3, :3], end[:, :3, :3]) - 1) / 2
        out[:, at + 1] = np.degrees(np.arccos(cosine.clip(-1, 1)))
    out[:, 4] = [len(r.contacts) for r in rows]
    out[:, 5] = [1e3 * max(r.contacts[:, 6].tolist(), default=0.0) for r in rows]
    np.maximum(out[:, 5], 0.0, out=out[:, 5])
    return out


def _firsts(rows: Sequence[Row]) -> list[int]:
    """Where the first stage of each row is among those of all rows one after another, from 1."""
    return list(accumulate((len(r.stages) for r in rows[:-1]), initial=1))


def _places(rows: Sequence[Row], firsts: Sequence[int], stage: str) -> NDArray[np.intp]:
    """The same for a stage by its name; 0 in rows without it."""
    found = [k + r.stages.index(stage) if stage in r.stages else 0 for r, k in zip(rows, firsts, strict=True)]
    return np.array(found, np.intp)


_NOT_JUDGED = np.full((1, 3), np.nan)
_NO_POSE = np.zeros((1, 4, 4))
"""What stands at place 0."""


def _darker(color: RGB) -> RGB:
    return color[0] * 6 // 10, color[1] * 6 // 10, color[2] * 6 // 10
