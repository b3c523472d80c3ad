"""The methods by name, each composed from its parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.protocols import Refiner, Simulator, Verifier
from verefine_viz.core.settings import MethodSettings
from verefine_viz.methods.bandit import BestInitial, Policy, Turns, Ucb
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
        """The first hypothesis, whose last pose is the answer."""
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


@dataclass(frozen=True)
class MethodInfo:
    """What a method is, for all that compose, show or evaluate its runs."""

    label: str
    """As the paper writes it."""
    make: Callable[[_Parts], PerObject] | None = None
    """Composes it from the session's refiner and simulator; None = it has its own."""
    simulates: bool = True
    """Whether physics moves the pose in its iterations."""
    chooses: bool = False
    """Whether it chooses between hypotheses (has a bandit); else an object has one hypothesis only."""
    has_ucb: bool = False
    """Whether the choice depends on the weight c of UCB's bonus."""
    verifies: bool = True
    """Whether the answer is the pose with the best score; else it is the last one."""
    knows_others: bool = False
    """Whether an object is placed among those placed before."""
    has_passes: bool = False
    """Whether objects are solved in passes, rewarded by the score of the whole scene."""
    has_tree: bool = False
    """Whether it searches a tree of scenes."""
    repeats: bool = False
    """Whether it takes the steps that another program recorded, and solves nothing itself."""

    @property
    def takes_turns(self) -> bool:
        """Whether the objects of a scene take turns and are answered together."""
        return self.has_passes or self.has_tree

    @property
    def first_only(self) -> bool:
        """Whether it works on the first hypothesis alone."""
        return not self.chooses and not self.has_tree

    @property
    def answers_best_of_all(self) -> bool:
        """Whether the answer is the pose with the highest score of any hypothesis of the object."""
        return self.chooses and self.verifies and not self.has_passes


METHODS: dict[str, MethodInfo] = {
    "refine": MethodInfo("REFINE", lambda p: p.last_pose(Refine(p.refiner)), simulates=False, verifies=False),
    "phys_before": MethodInfo(
        "PHYS_BEFORE", lambda p: p.last_pose(PhysBefore(p.simulator, p.refiner, p.n_steps)), verifies=False
    ),
    "phys_after": MethodInfo(
        "PHYS_AFTER",
        lambda p: p.last_pose(PhysAfter(p.simulator, p.refiner, p.n_steps, p.s.iterations)),
        verifies=False,
    ),
    "even": MethodInfo("EVEN", lambda p: p.pir_by(Turns()), chooses=True),
    "expl": MethodInfo("EXPL", lambda p: p.pir_by(BestInitial()), chooses=True),
    "pir": MethodInfo("PIR", lambda p: p.last_pose(p.pir), verifies=False),
    "sir": MethodInfo("SIR", lambda p: PerObject(p.sir_alone())),
    "rir": MethodInfo("RIR", lambda p: PerObject(p.rir()), chooses=True, has_ucb=True),
    "vf_breadth": MethodInfo(
        "VF_b", lambda p: VfBreadth(p.scene_rir(), p.s.carry_clusters), chooses=True, has_ucb=True, knows_others=True
    ),
    "vf_depth": MethodInfo("VF_d", _Parts.vf_depth, chooses=True, has_ucb=True, knows_others=True, has_passes=True),
    # The system that the paper compares with; it has a refiner and a simulator of its own (methods/physim_mcts.py).
    "physim_mcts": MethodInfo("PHYSIM-MCTS", knows_others=True, has_tree=True),
    # What another program did (verefine_viz/trace.py).
    "trace": MethodInfo(
        "TRACE", lambda p: PerObject(recorded_steps(p.verifier)),
        simulates=False, chooses=True, verifies=False, repeats=True,
    ),
}  # fmt: skip

ALL_METHOD_NAMES = tuple(name for name, method in METHODS.items() if not method.repeats)
"""Names of the methods that solve frames."""
METHOD_NAMES = tuple(name for name in ALL_METHOD_NAMES if METHODS[name].make is not None)
"""Composed here from the session's refiner and simulator."""
SEARCH = next(name for name, method in METHODS.items() if method.has_tree)
"""Name of the tree search."""


def method_of(name: str) -> MethodInfo:
    """What the method of that name is; an unknown one counts as a plain one."""
    return METHODS.get(name) or MethodInfo(name.upper())


def make_method(
    settings: MethodSettings,
    simulator: Simulator | None,
    refiner: Refiner,
    verifier: Verifier,
    n_steps: int,
    flips: Flips | None = None,
) -> PerObject:
    """The method of that name over all instances of a frame. ``simulator`` None switches physics off, ``flips`` None
    has none of them compete.

    Raises:
        SettingsError: there is no such method.
    """
    make = method_of(settings.name).make
    if make is None:
        raise SettingsError(unknown("method", settings.name, ALL_METHOD_NAMES))
    return make(_Parts(settings, simulator, refiner, verifier, n_steps, flips))
