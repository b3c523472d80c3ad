"""Numbers over the iterations: score, UCB and pulls per hypothesis, fit, error and physics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, RGB, STAGE_COLORS
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.block import Block
from verefine_viz.recording.layout import Branch
from verefine_viz.recording.piece import Piece

_SCALARS = rr.Scalars.descriptor_scalars()
_PURPLE: RGB = (190, 90, 220)

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


def curves(branch: Branch, block: Block, own: Sequence[int], held: Float) -> Iterator[Piece]:
    """The curves of an object.

    Args:
        branch: the object.
        block: iterations of all objects.
        own: which of them are the object's; at least one.
        held: (H,) latest kept score of each hypothesis before them; updated in place.
    """
    iterations = [block.iterations[k] for k in own]
    scores = np.empty((len(own), len(held) + 1))
    for k, i in enumerate(iterations):
        kept = i.accepted_stage.score
        if kept is not None:
            held[i.arm] = kept.score
        scores[k, :-1] = held
    scores[:, -1] = block.best_scores[own]
    drawn = {"score": scores, "fit": block.fit[own], "physics": block.physics[own]}
    choices = [i.choice for i in iterations if i.choice is not None]
    if len(choices) == len(own):
        drawn |= {"ucb": np.array([c.ucb for c in choices]), "pulls": np.array([c.plays for c in choices])}
    if branch.has_truth:
        drawn["error"] = block.errors[own]
    indices = [i.index for i in iterations]
    for name, values in drawn.items():
        yield chunks.rows_of(curve(name, branch.name), indices, [columns.numbers(_SCALARS, values)])


def _darker(color: RGB) -> RGB:
    return color[0] * 6 // 10, color[1] * 6 // 10, color[2] * 6 // 10
