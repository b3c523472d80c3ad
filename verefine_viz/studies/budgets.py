"""Number of calls of each refiner in the paper (Sec. V): the one table that all studies read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from verefine_viz.studies.study_plan import Settings, StudyCurve

GEOMETRY = {"colour_weight": 0.0}
"""Settings of the score: the paper's Eq. 1 has depth and normals only, whatever else the session weighs."""


@dataclass(frozen=True)
class Budget:
    """One refiner with the paper's settings and numbers of iterations."""

    refiner: str
    """Its name in the settings."""
    name: str
    """Its name in the paper."""
    calls: int
    """K, refiner calls per hypothesis."""
    hypotheses: int
    """H; methods with several share out K·H calls."""
    inner: int
    """Inner iterations of a call, where the paper counts these."""
    steps: int
    """Simulation steps of an iteration."""
    source: str
    """Place of these numbers in the paper."""
    own: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Further settings by section."""
    vf_depth_exploration: float | None = None
    """c of VF_d; None = the session's."""

    @property
    def about(self) -> str:
        """In words."""
        of_call = f" of {self.inner} iterations" if self.inner > 1 else ""
        return f"{self.name}: K = {self.calls} calls{of_call} per hypothesis ({self.source})"

    @property
    def short(self) -> int:
        """Iterations per object of the methods with one hypothesis, as the paper counts them."""
        return self.calls * self.inner

    @property
    def long(self) -> int:
        """Calls of the methods with several hypotheses."""
        return self.short * self.hypotheses

    def curve(self, label: str, method: str, calls: int | None = None) -> StudyCurve:
        """A method with ``calls`` refiner calls per hypothesis, by default K."""
        of_method: dict[str, Any] = {"name": method, "refiner": self.refiner, "iterations": calls or self.calls}
        if method == "vf_depth" and self.vf_depth_exploration is not None:
            of_method["exploration"] = self.vf_depth_exploration
        return StudyCurve(label, {**self.own, "method": of_method, "physics": {"steps": self.steps}}, self.inner)

    def alone(self, label: str, iterations: int) -> StudyCurve:
        """The refiner without physics, for a number of iterations as the paper counts them: ICP runs them in one
        call.
        """
        if self.inner == 1:
            return self.curve(label, "refine", iterations)
        icp = {**self.own["icp"], "max_iterations": iterations}
        return StudyCurve(label, {**_settings(self.curve(label, "refine", 1)), "icp": icp}, iterations)

    def search(self, label: str, calls: int, most_calls: int | None = None) -> StudyCurve:
        """PHYSIM-MCTS with a number of expansions per object, or of refiner calls; time is no limit."""
        mcts = {"expansions": calls, "seconds": None}
        settings = {**_settings(self.curve(label, "physim_mcts")), "mcts": mcts}
        return StudyCurve(label, settings, self.inner, most_calls)


def _settings(curve: StudyCurve) -> Settings:
    return curve.settings or {}


BUDGETS = {
    budget.refiner: budget
    for budget in (
        Budget(
            "densefusion",
            "DF-R",
            calls=2,
            hypotheses=5,
            inner=1,
            steps=3,
            source="Sec. V, Baselines: 2 iterations over 2 PIR iterations, 3 simulation steps; Tables I, III: RIR 10",
            own={"densefusion": {"iterations": 1}, "score": GEOMETRY},
        ),
        Budget(
            "icp",
            "ICP",
            calls=5,
            hypotheses=3,
            inner=10,
            steps=3,
            source="Sec. V, Baselines: 50 iterations over 5 PIR iterations, 3 simulation steps; Table I: RIR 150",
            # The authors' PCL settings stop after 2 (docs/methods.md 1.8.22); the text has 50.
            own={"icp": {"metric": "point", "max_iterations": 10, "stop": "max_iterations"}, "score": GEOMETRY},
        ),
        Budget(
            "trimmed_icp",
            "TrICP",
            calls=2,
            hypotheses=25,
            inner=1,
            steps=60,
            source="Sec. V, Baselines: 25 hypotheses, 60 simulation steps; Table II: 150 iterations for three objects; "
            "c = 0.2 for VF_d in the authors' code",
            own={"score": GEOMETRY},
            vf_depth_exploration=0.2,
        ),
    )
}


def budget_of(refiner: str) -> Budget:
    """The paper's budget; a refiner that is not in the paper gets as many calls as DF-R."""
    calls = "none in the paper: as many calls as DF-R"
    return BUDGETS.get(refiner) or Budget(refiner, refiner, calls=2, hypotheses=5, inner=1, steps=3, source=calls)
