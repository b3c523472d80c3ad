"""The budgets of the studies are those of preset paper."""

from __future__ import annotations

from verefine_viz.core.presets import WITH_REFINER, preset_fields
from verefine_viz.studies.budgets import BUDGETS


def test_studies_and_preset_paper_have_one_budget_for_each_refiner() -> None:
    assert {*BUDGETS} == {refiner for preset, refiner in WITH_REFINER if preset == "paper"}
    for refiner, budget in BUDGETS.items():
        preset = preset_fields("paper", refiner)
        numbers = (preset["method"]["iterations"], preset["hypotheses"]["max_per_object"], preset["physics"]["steps"])
        assert numbers == (budget.calls, budget.hypotheses, budget.steps), refiner
        inner = preset["icp"].get("max_iterations", 1)
        assert inner == budget.inner, refiner
