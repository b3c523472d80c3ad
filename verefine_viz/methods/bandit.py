"""Which hypothesis gets the next iteration: UCB (paper Sec. III-C, Eq. 2), and the ablation's policies (Sec. V-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from msgspec import structs

from verefine_viz.core.records import Choice
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.methods.arms import ObjectState

Numbers = list[float]
"""One per arm. For a handful of arms, plain floats are faster than numpy."""


class Policy(Protocol):
    """Chooses the next arm."""

    def choose(self, state: ObjectState) -> Choice: ...


@dataclass(frozen=True)
class Ucb:
    """UCB1 (paper Sec. III-C, Eq. 2): the largest μ_j + c·sqrt(ln Σn / n_j); the first on ties."""

    c: float

    def choose(self, state: ObjectState) -> Choice:
        plays, mean = state.plays, state.means
        never_played = math.inf if self.c > 0.0 else 0.0
        # ln p of Eq. 2, p = Σn. The logarithm of a discounted count can be negative; an exploration term cannot be
        # (docs/methods.md 1.8.14).
        log_total = math.log(max(sum(plays), 1.0))
        exploration = [self.c * math.sqrt(log_total / n) if n > 0.0 else never_played for n in plays]
        # Eq. 2: ucb_j = μ_j + c·sqrt(ln p / n_j).
        ucb = [m + e for m, e in zip(mean, exploration, strict=True)]
        # Sec. III-C: the arm with maximal ucb_j is selected.
        j = ucb.index(max(ucb))
        return _choice(j, plays, mean, exploration, ucb, _reason(j, mean, exploration, ucb))


@dataclass(frozen=True)
class Turns:
    """Every arm in turn (EVEN, paper Sec. V-A): the one with the fewest iterations, the first on ties."""

    def choose(self, state: ObjectState) -> Choice:
        spent = [arm.n_iterations for arm in state.arms]
        return fixed_choice(state, spent.index(min(spent)), "in turn")


@dataclass(frozen=True)
class BestInitial:
    """Always the arm whose initial pose scored best (EXPL, paper Sec. V-A); the first on ties."""

    def choose(self, state: ObjectState) -> Choice:
        first = [arm.entries_since_edit[0] for arm in state.arms]
        j = int(np.argmax([entry.score.score for entry in first]))
        return fixed_choice(state, j, f"its {first[j].stage} pose scored best, {first[j].score.score:.2f}")


def next_choice(policy: Policy, state: ObjectState) -> Choice:
    """The arm that the policy chooses; an edited arm is played before all others; the numbers stay unchanged."""
    choice = policy.choose(state)
    if not state.edited_arms:
        return choice
    j = state.edited_arms[0]
    return structs.replace(choice, arm=j, reason=f"hypothesis {j + 1}: its pose was edited and is played first")


def fixed_choice(state: ObjectState, j: int, why: str) -> Choice:
    """Choice of hypothesis ``j`` for another reason than the bandit's numbers."""
    plays, mean = state.plays, state.means
    reason = f"hypothesis {j + 1} of {len(state.arms)}: {why}"
    return _choice(j, plays, mean, [0.0] * len(mean), mean, reason)


def _choice(j: int, plays: Numbers, mean: Numbers, exploration: Numbers, ucb: Numbers, reason: str) -> Choice:
    columns = np.array([plays, mean, exploration, ucb])
    columns.flags.writeable = False
    return Choice(j, *columns, reason=reason)


def _reason(j: int, mean: Numbers, exploration: Numbers, ucb: Numbers) -> str:
    if len(ucb) == 1:
        return f"hypothesis {j + 1}: {mean[j]:.2f} + {exploration[j]:.2f}, the only one"
    rival = max((k for k in range(len(ucb)) if k != j), key=ucb.__getitem__)
    sign = "=" if ucb[rival] == ucb[j] else ">"
    digits = distinguishing_digits(ucb[j] - ucb[rival])
    own, other = (f"hypothesis {k + 1}: {mean[k]:.{digits}f} + {exploration[k]:.{digits}f}" for k in (j, rival))
    return f"{own} {sign} {other}"
