"""The methods by name, each composed from its parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.protocols import Refiner, Simulator, Verifier
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.bandit import BestInitial, Turns, Ucb
from verefine_viz.methods.object_method import ObjectMethod
from verefine_viz.methods.per_object import PerObject
from verefine_viz.methods.phys_after import PhysAfter
from verefine_viz.methods.phys_before import PhysBefore
from verefine_viz.methods.pir import Pir
from verefine_viz.methods.refine import Refine
from verefine_viz.methods.sir import Sir
from verefine_viz.methods.vf_breadth import VfBreadth
from verefine_viz.methods.vf_depth import VfDepth


class _Parts:
    """What the methods of one session are composed from."""

    def __init__(
        self, s: MethodSettings, simulator: Simulator | None, refiner: Refiner, verifier: Verifier, n_steps: int
    ) -> None:
        self.s, self.simulator, self.refiner, self.verifier, self.n_steps = s, simulator, refiner, verifier, n_steps
        self.pir = Pir(simulator, refiner, n_steps)
        self.sir = Sir(self.pir, s.sim_candidate)
        self.never_worse = s.accept == "never_worse"

    def refine(self) -> ObjectMethod:
        return ObjectMethod(Refine(self.refiner), self.verifier, self.s.iterations, answer_is_best_scored=False)

    def phys_before(self) -> ObjectMethod:
        chain = PhysBefore(self.simulator, self.refiner, self.n_steps)
        return ObjectMethod(chain, self.verifier, self.s.iterations, answer_is_best_scored=False)

    def phys_after(self) -> ObjectMethod:
        chain = PhysAfter(self.simulator, self.refiner, self.n_steps, self.s.iterations)
        return ObjectMethod(chain, self.verifier, self.s.iterations, answer_is_best_scored=False)

    def pir_alone(self) -> ObjectMethod:
        return ObjectMethod(self.pir, self.verifier, self.s.iterations, answer_is_best_scored=False)

    def sir_alone(self) -> ObjectMethod:
        return ObjectMethod(self.sir, self.verifier, self.s.iterations, never_worse=self.never_worse)

    def rir(self) -> ObjectMethod:
        bandit = Ucb(self.s.exploration)
        return ObjectMethod(self.sir, self.verifier, self.s.iterations, bandit, never_worse=self.never_worse)

    def scene_rir(self) -> ObjectMethod:
        return replace(self.rir(), placed_may_hide=self.s.occluders == "placed")

    def even(self) -> ObjectMethod:
        return ObjectMethod(self.pir, self.verifier, self.s.iterations, Turns())

    def expl(self) -> ObjectMethod:
        return ObjectMethod(self.pir, self.verifier, self.s.iterations, BestInitial())

    def vf_breadth(self) -> VfBreadth:
        return VfBreadth(self.scene_rir(), self.s.carry_clusters)

    def vf_depth(self) -> VfDepth:
        return VfDepth(
            self.scene_rir(),
            discount=self.s.discount,
            reward=self.s.scene_reward,
            answer=self.s.scene_answer,
            prior=self.s.scene_prior,
            whole_frame=self.s.scene_pixels == "frame",
            carry_clusters=self.s.carry_clusters,
        )


_METHODS: dict[str, Callable[[_Parts], PerObject]] = {
    "refine": lambda parts: PerObject(parts.refine()),
    "phys_before": lambda parts: PerObject(parts.phys_before()),
    "phys_after": lambda parts: PerObject(parts.phys_after()),
    "even": lambda parts: PerObject(parts.even()),
    "expl": lambda parts: PerObject(parts.expl()),
    "pir": lambda parts: PerObject(parts.pir_alone()),
    "sir": lambda parts: PerObject(parts.sir_alone()),
    "rir": lambda parts: PerObject(parts.rir()),
    "vf_breadth": _Parts.vf_breadth,
    "vf_depth": _Parts.vf_depth,
}

SEARCH = "physim_mcts"
"""The system that the paper compares with; it has a refiner and a simulator of its own (methods/physim_mcts.py)."""

METHOD_NAMES = tuple(_METHODS)
"""Composed here from the session's refiner and simulator."""

ALL_METHOD_NAMES = (*METHOD_NAMES, SEARCH)


def make_method(
    settings: MethodSettings, simulator: Simulator | None, refiner: Refiner, verifier: Verifier, n_steps: int
) -> PerObject:
    """The method of that name over all instances of a frame. ``simulator`` None switches physics off.

    Raises:
        SettingsError: there is no such method.
    """
    if settings.name not in _METHODS:
        raise SettingsError(unknown("method", settings.name, ALL_METHOD_NAMES))
    return _METHODS[settings.name](_Parts(settings, simulator, refiner, verifier, n_steps))
