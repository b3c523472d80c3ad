"""Which hypothesis gets the next iteration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from verefine_viz.core.records import Choice
from verefine_viz.methods.arms import ObjectState


class Policy(Protocol):
    """Chooses the next arm from what is known about all of them."""

    def choose(self, state: ObjectState) -> Choice: ...


@dataclass(frozen=True)
class Ucb:
    """UCB1 (paper Eq. 2): the largest μ_j + c·sqrt(ln Σn / n_j); the first on ties."""

    c: float

    def choose(self, state: ObjectState) -> Choice:
        plays, mean = state.plays, state.means
        # The logarithm of a discounted count can be negative; an exploration term cannot (METHODS 1.8 #14).
        exploration = self.c * np.sqrt(max(np.log(plays.sum()), 0.0) / plays)
        ucb = mean + exploration
        j = int(np.argmax(ucb))
        return Choice(j, plays, mean, exploration, ucb, _why(j, mean, exploration, ucb))


@dataclass(frozen=True)
class Turns:
    """Every arm in turn (EVEN, paper Sec. IV-C)."""

    def choose(self, state: ObjectState) -> Choice:
        return _fixed_choice(state, state.n_done % len(state.arms), "in turn")


@dataclass(frozen=True)
class BestInitial:
    """Always the arm whose initial pose scored best (EXPL, paper Sec. IV-C); the first on ties."""

    def choose(self, state: ObjectState) -> Choice:
        j = int(np.argmax(state.initial.score))
        return _fixed_choice(state, j, f"its initial pose scored best, {state.initial.score[j]:.2f}")


def _fixed_choice(state: ObjectState, j: int, why: str) -> Choice:
    mean = state.means
    reason = f"hypothesis {j + 1} of {len(state.arms)}: {why}"
    return Choice(j, state.plays, mean, np.zeros_like(mean), mean, reason)


def _why(j: int, mean: np.ndarray, exploration: np.ndarray, ucb: np.ndarray) -> str:
    own = f"hypothesis {j + 1}: {mean[j]:.2f} + {exploration[j]:.2f}"
    if len(ucb) == 1:
        return f"{own}, the only one"
    bounds = ucb.tolist()
    rival = max((k for k in range(len(bounds)) if k != j), key=bounds.__getitem__)
    sign = "=" if bounds[rival] == bounds[j] else ">"
    return f"{own} {sign} hypothesis {rival + 1}: {mean[rival]:.2f} + {exploration[rival]:.2f}"
