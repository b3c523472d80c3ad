"""The budgets of the studies are those of preset paper."""

from __future__ import annotations

from verefine_viz.core.presets import WITH_REFINER, preset_fields
from verefine_viz.run.session_file import changed, resolve
from verefine_viz.studies.budgets import BUDGETS, budget_of


def test_studies_and_preset_paper_have_one_budget_for_each_refiner() -> None:
    assert {*BUDGETS} == {refiner for preset, refiner in WITH_REFINER if preset == "paper"}
    for refiner, budget in BUDGETS.items():
        preset = preset_fields("paper", refiner)
        numbers = (preset["method"]["iterations"], preset["hypotheses"]["max_per_object"], preset["physics"]["steps"])
        assert numbers == (budget.calls, budget.hypotheses, budget.steps), refiner
        inner = preset["icp"].get("max_iterations", 1)
        assert inner == budget.inner, refiner


def test_rows_of_the_papers_refiners_score_by_depth_and_normals_alone():
    recommended = resolve({"scene": {"demo": "mug"}})
    assert recommended.score.colour_weight > 0
    for refiner in BUDGETS:
        curve = budget_of(refiner).curve("RIR", "rir")
        assert curve.settings is not None
        assert changed(recommended, curve.settings).score.colour_weight == 0
