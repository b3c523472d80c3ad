"""Table IV with a simulated gripper: budgets, rows, and what a run comes to."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import structs

from tests.batch.frames import PoolHere
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import load_session
from verefine_viz.studies import run_study as run_study_module
from verefine_viz.studies.grasp_table import grasp_order, grasp_rows
from verefine_viz.studies.grasping_study import GIVEN, TABLE, grasping
from verefine_viz.studies.run_study import run_study
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_command import scenes
from verefine_viz.studies.study_request import StudyRequest


def test_methods_with_several_hypotheses_have_the_calls_of_one() -> None:
    curves = {c.label: c for c in grasping().panels[0].curves}
    calls = {label: c.settings["method"].get("iterations") for label, c in curves.items()}
    assert calls["ICP alone, 10"] == 10
    assert calls["ICP + RIR, 10"] == calls["ICP + VF_d, 10"] == 2
    search = curves["PHYSIM-MCTS, 10"]
    assert (search.most_calls, search.settings["method"]["refiner"]) == (10, "icp")


def _outcome(seed: int, name: str, grasp: str, curve: str = "ICP + RIR, 10") -> UnitAnswer:
    answer = Answer(frame="0/0", seed=seed, instance_id=0, obj_id=1, name=name, status="ok")
    return UnitAnswer(panel=TABLE, x=0.0, scene="s", curve=curve, answer=answer, refiner_calls=10.0, grasp=grasp)


def test_found_and_success_are_counted_apart() -> None:
    ends = ("success", "slipped", "collided with the ground", "no contact", "no collision-free grasp", "no answer")
    rows = grasp_rows(grasping(), [_outcome(k, "can", end) for k, end in enumerate(ends)])
    (total,) = (r for r in rows if r["object"] == "all")
    assert (total["n"], total["successes"]) == (6, 1)
    assert total["found"] == pytest.approx(4 / 6)


def test_the_order_is_tested_on_the_trials_that_both_rows_have() -> None:
    for n, word in ((3, "too close to tell"), (8, "as in the paper")):
        rir = [_outcome(k, "can", "success") for k in range(n + 1)]
        sir = [_outcome(k, "can", "slipped" if k else "success", "ICP + SIR, 2") for k in range(n + 5)]
        (order,) = grasp_order(grasping().panels[0], rir + sir)
        assert (order.n, order.better_alone, order.worse_alone) == (n + 1, n, 0), (n, word)
        assert order.p == pytest.approx(2 * 0.5**n), (n, word)
        assert order.word == word, (n, word)


def test_trials_are_of_the_objects_as_they_lie_and_turned() -> None:
    given, turned = scenes("grasping", None, {}, quick=True).values()
    assert (given.scene.turned, turned.scene.turned) == (False, True)
    assert structs.replace(given.scene, turned=True) == turned.scene


@pytest.mark.usefixtures("long_run", "processes")
def test_the_ground_truth_is_lifted_and_workers_do_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = {"demo": "duck", "model_points": 200, "cloud_points": 200}
    sessions = {"duck": load_session(None, {"preset": "published", "scene": scene})}
    request = StudyRequest("grasping", quick=True)
    with monkeypatch.context() as patched:
        patched.setattr(run_study_module, "Pool", PoolHere)
        one = run_study(request, sessions, 1, 1, tmp_path / "one", lambda done, total: None)
    two = run_study(request, sessions, 1, 2, tmp_path / "two", lambda done, total: None)
    without_times = [
        msgspec.to_builtins([structs.replace(o, ms=0.0) for o in outcome.answers], enc_hook=np.ndarray.tolist)
        for outcome in (one, two)
    ]
    assert without_times[0] == without_times[1]
    assert {o.grasp for o in one.answers if o.curve == GIVEN and o.x == 0} == {"success"}
