"""The budgets of the studies are those of preset paper."""

from __future__ import annotations

from verefine_viz.core.presets import BUDGETS as PRESET_BUDGETS
from verefine_viz.core.presets import PRESETS
from verefine_viz.studies.budgets import BUDGETS


def test_studies_and_preset_paper_have_one_budget_for_each_refiner() -> None:
    assert {("paper", refiner) for refiner in BUDGETS} == PRESET_BUDGETS.keys()
    for refiner, budget in BUDGETS.items():
        preset = PRESET_BUDGETS["paper", refiner]
        steps = preset.get("physics", PRESETS["paper"]["physics"])["steps"]
        numbers = (preset["method"]["iterations"], preset["hypotheses"]["max_per_object"], steps)
        assert numbers == (budget.calls, budget.hypotheses, budget.steps), refiner
        inner = preset.get("icp", {}).get("max_iterations", 1)
        assert inner == budget.inner, refiner
