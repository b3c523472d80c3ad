"""The methods by name, each composed from its parts; ``known_methods.py`` says what they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.protocols import Refiner, Simulator, Verifier
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.bandit import BestInitial, Policy, Turns, Ucb
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.methods.object_method import Flips, ObjectMethod
from verefine_viz.methods.per_object import PerObject, VfBreadth
from verefine_viz.methods.recorded_steps import recorded_steps
from verefine_viz.methods.single_object import Chain, PhysAfter, PhysBefore, Pir, Refine, Sir
from verefine_viz.methods.vf_depth import VfDepth


class _Parts:
    """What the methods of one session are composed from."""

    def __init__(
        self,
        s: MethodSettings,
        simulator: Simulator | None,
        refiner: Refiner,
        verifier: Verifier,
        n_steps: int,
        flips: Flips | None,
    ) -> None:
        self.s, self.simulator, self.refiner, self.verifier, self.n_steps = s, simulator, refiner, verifier, n_steps
        self.flips = flips
        self.pir = Pir(simulator, refiner, n_steps)
        self.sir = Sir(self.pir, s.sim_candidate)
        self.never_worse = s.accept == "never_worse"

    def last_pose(self, chain: Chain) -> PerObject:
        """A chain on the first hypothesis, whose last pose is the answer."""
        return PerObject(ObjectMethod(chain, self.verifier, self.s.iterations, answer_is_best_scored=False))

    def pir_by(self, policy: Policy) -> PerObject:
        """PIR of the hypothesis that a policy of the ablation chooses."""
        return PerObject(ObjectMethod(self.pir, self.verifier, self.s.iterations, policy, flips=self.flips))

    def sir_alone(self) -> ObjectMethod:
        return ObjectMethod(self.sir, self.verifier, self.s.iterations, never_worse=self.never_worse, flips=self.flips)

    def rir(self) -> ObjectMethod:
        """SIR of the hypothesis that UCB chooses (paper Sec. III-C)."""
        return replace(self.sir_alone(), policy=Ucb(self.s.exploration))

    def scene_rir(self) -> ObjectMethod:
        return replace(self.rir(), placed_may_hide=self.s.occluders == "placed")

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


MAKERS: dict[str, Callable[[_Parts], PerObject]] = {
    "refine": lambda p: p.last_pose(Refine(p.refiner)),
    "phys_before": lambda p: p.last_pose(PhysBefore(p.simulator, p.refiner, p.n_steps)),
    "phys_after": lambda p: p.last_pose(PhysAfter(p.simulator, p.refiner, p.n_steps, p.s.iterations)),
    "even": lambda p: p.pir_by(Turns()),
    "expl": lambda p: p.pir_by(BestInitial()),
    "pir": lambda p: p.last_pose(p.pir),
    "sir": lambda p: PerObject(p.sir_alone()),
    "rir": lambda p: PerObject(p.rir()),
    "vf_breadth": lambda p: VfBreadth(p.scene_rir(), p.s.carry_clusters),
    "vf_depth": _Parts.vf_depth,
    "trace": lambda p: PerObject(recorded_steps(p.verifier)),
}
"""What composes a method from the session's refiner and simulator; the tree search has its own."""
METHOD_NAMES = tuple(name for name in ALL_METHOD_NAMES if name in MAKERS)
"""Names of the methods that are composed here and solve frames."""


def make_method(
    settings: MethodSettings,
    simulator: Simulator | None,
    refiner: Refiner,
    verifier: Verifier,
    n_steps: int,
    flips: Flips | None = None,
) -> PerObject:
    """The method of that name over all instances of a frame. ``simulator`` None switches physics off; ``flips`` None
    lets no flips compete.

    Raises:
        SettingsError: there is no such method.
    """
    make = MAKERS.get(settings.name)
    if make is None:
        raise SettingsError(unknown("method", settings.name, ALL_METHOD_NAMES))
    return make(_Parts(settings, simulator, refiner, verifier, n_steps, flips))
