"""Properties of each method, for code that shows, tabulates or evaluates runs; ``registry.py`` composes methods."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MethodInfo:
    """Properties of a method, for code that composes, shows or evaluates its runs."""

    label: str
    """As the paper writes it."""
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
    "refine": MethodInfo("REFINE", simulates=False, verifies=False),
    "phys_before": MethodInfo("PHYS_BEFORE", verifies=False),
    "phys_after": MethodInfo("PHYS_AFTER", verifies=False),
    "even": MethodInfo("EVEN", chooses=True),
    "expl": MethodInfo("EXPL", chooses=True),
    "pir": MethodInfo("PIR", verifies=False),
    "sir": MethodInfo("SIR"),
    "rir": MethodInfo("RIR", chooses=True, has_ucb=True),
    "vf_breadth": MethodInfo("VF_b", chooses=True, has_ucb=True, knows_others=True),
    "vf_depth": MethodInfo("VF_d", chooses=True, has_ucb=True, knows_others=True, has_passes=True),
    # The system that the paper compares with; it has a refiner and a simulator of its own (methods/physim_mcts.py).
    "physim_mcts": MethodInfo("PHYSIM-MCTS", knows_others=True, has_tree=True),
    # What another program did (verefine_viz/trace.py).
    "trace": MethodInfo("TRACE", simulates=False, chooses=True, verifies=False, repeats=True),
}

ALL_METHOD_NAMES = tuple(name for name, method in METHODS.items() if not method.repeats)
"""Names of the methods that solve frames."""
SEARCH = next(name for name, method in METHODS.items() if method.has_tree)
"""Name of the tree search."""


def method_of(name: str) -> MethodInfo:
    """Properties of the method of that name; the defaults for an unknown name."""
    return METHODS.get(name) or MethodInfo(name.upper())
