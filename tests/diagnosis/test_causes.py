"""Where one thing is broken on purpose, the diagnosis names it. bench/diagnosis.py measures this over 20 seeds each."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.changing import replace
from tests.failing_scenes import GENERATORS, broken_scene, named
from tests.fakes import OneFrame
from tests.made_up_frames import Thing as Made
from tests.made_up_frames import frame_of, model, near, standing
from tests.received import received
from verefine_viz.batch.summary import worst_iteration
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import transform
from verefine_viz.diagnosis.case import CONTROLS, FIRST_CONTROLS, HELPS, Control
from verefine_viz.diagnosis.diagnose import Diagnosis, diagnose, diagnosed, failed_cases
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.page import protocol
from verefine_viz.page.branch import Branch
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.verdict import verdict_message
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import load_session, resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"


@pytest.mark.parametrize("cause", list(GENERATORS))
def test_what_is_broken_is_named(cause: Cause) -> None:
    diagnosis = next(found for seed in range(13) if (found := named(broken_scene(cause, seed))) is not None)
    assert diagnosis.main.cause == cause, diagnosis.main.text
    assert diagnosis.main.is_confirmed
    assert diagnosis.main.text.endswith(".")
    assert diagnosis.main.numbers


BUILT_IN = (
    ("failure_no_hypothesis_near", Cause.POOL),
    ("failure_icp_slides", Cause.REFINER),
    ("failure_score_prefers_wrong", Cause.SCORE),
    ("failure_score_prefers_flip", Cause.SYMMETRIC),
    ("failure_arm_starved", Cause.ARM_STARVED),
    ("failure_simulation_topples", Cause.SIMULATION),
    ("failure_mask_leaks", Cause.MASK),
    ("failure_wrong_plane", Cause.PLANE),
    ("failure_out_of_range", Cause.OUT_OF_RANGE),
)


@pytest.mark.parametrize(("name", "cause"), BUILT_IN, ids=[b[0] for b in BUILT_IN])
def test_built_in_failures_get_their_name(name: str, cause: Cause) -> None:
    toolbox = Toolbox(load_session(SESSIONS / f"{name}.toml"))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (diagnosis,) = diagnose(run, toolbox)
    assert diagnosis.main.cause == cause
    assert diagnosis.main.is_confirmed


def test_a_simulation_is_blamed_with_its_own_numbers() -> None:
    toolbox = Toolbox(load_session(SESSIONS / "failure_simulation_topples.toml", {"method": {"name": "rir"}}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (target,) = run.problem.targets
    assert target.instance.T_cam_obj_gt is not None
    (found,) = diagnose(run, toolbox, 0.05)
    (blamed,) = (i for i in run.iterations if i.index == found.main.numbers["iteration"])
    k = [stage.name for stage in blamed.stages].index("simulated")
    error_of = ErrorOf(target.model, target.instance.T_cam_obj_gt)
    before, after = (error_of(stage.T_cam_obj) for stage in blamed.stages[k - 1 : k + 1])
    assert found.main.numbers["error_added"] == pytest.approx(after - before)
    assert f"In iteration {blamed.index} the simulation moved the {target.model.name} by " in found.main.text


def ran(toolbox: Toolbox) -> Branch:
    """Run what the page would open, to its end."""
    space = Workspace(toolbox.session, None, lambda _: toolbox)
    debugger = Debugger(space)
    debugger.carry_out([protocol.Seek(100_000, space.work.first.index)])
    return space.work.first


def with_the_identity(session: str, **hypotheses: float) -> tuple[Diagnosis, Run]:
    """Why the only object of a shipped session fails when it is solved with a refiner that does nothing."""
    settings = {"method": {"refiner": "identity"}, "hypotheses": hypotheses}
    toolbox = Toolbox(load_session(SESSIONS / f"{session}.toml", settings))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, every_cause=True)
    return diagnosis, run


def test_a_refiner_is_blamed_where_icp_gets_there_from_the_same_hypotheses() -> None:
    diagnosis, run = with_the_identity("mug", rotation_deg=60.0, translation_mm=15.0, seed=2)
    assert (diagnosis.main.cause, diagnosis.main.is_confirmed) == (Cause.REFINER, True)
    assert "with ICP from the same hypotheses the error is 0%" in diagnosis.main.text
    assert diagnosis.main.numbers["error_repaired"] < 0.02
    assert diagnosis.main.numbers["calls"] == run.length
    assert diagnosis.main.numbers["calls_that_took_it_away"] == 0
    assert Cause.POOL not in {other.cause for other in diagnosis.findings[1:]}, "the pool leads there"


def test_no_refiner_is_blamed_for_a_pool_that_does_not_lead_there() -> None:
    diagnosis, _ = with_the_identity("failure_no_hypothesis_near")
    assert (diagnosis.main.cause, diagnosis.main.is_confirmed) == (Cause.POOL, True)
    assert Cause.REFINER not in {other.cause for other in diagnosis.findings[1:]}


def test_a_discarded_pose_is_named_with_both_poses_their_scores_and_the_iteration() -> None:
    broken = broken_scene(Cause.DISCARDED, 0)
    run = broken.toolbox.run(broken.problem)
    run.finish()
    (diagnosis,) = diagnose(run, broken.toolbox)
    (target,), evidence = broken.problem.targets, diagnosis.main.numbers
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    error_of = ErrorOf(target.model, T_gt)
    correct, wrong = (run.state_at(0).initial[0][k].score for k in (1, 0))
    assert evidence["hypothesis"] == 1
    assert evidence["hypothesis_of_answer"] == 0
    assert evidence["error_of_correct"] == error_of(target.instance.hypotheses[1].T_cam_obj) < 0.1
    assert (evidence["score_of_correct"], evidence["score"]) == (correct, wrong)
    assert evidence["margin"] == wrong - correct
    assert diagnosis.n_reruns == 0
    # The page marks that iteration, a batch opens it.
    worst = worst_iteration(target, run.iterations, run.final_state.best[0])
    assert worst == evidence["given_up_in_iteration"] == 1
    cast(Any, broken.toolbox).source = OneFrame(broken.problem)
    branch = ran(broken.toolbox)
    assert [m.k for m in branch.marks() if m.kind == "discarded" and m.tone == "problem"] == [1]


def test_what_re_runs_get_right_by_chance_is_undecided_whatever_is_put_right() -> None:
    diagnosis = named(broken_scene(Cause.UNDECIDED, 0))
    assert diagnosis is not None
    right, n = (diagnosis.main.numbers[name] for name in ("reruns_right", "reruns"))
    assert 0 < right < n == CONTROLS
    assert f"is between two basins: right in {right:.0f} of {n:.0f} re-runs" in diagnosis.main.text
    controlled = [other for other in diagnosis.findings[1:] if "repaired_right" in other.numbers]
    assert controlled, "a repair was tried"
    for other in controlled:
        assert not other.is_confirmed
        helped, times = other.numbers["repaired_right"], other.numbers["repaired"]
        assert helped / times - right / n < HELPS


def test_a_repair_has_its_control() -> None:
    toolbox = Toolbox(load_session(SESSIONS / "failure_mask_leaks.toml"))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (case,) = failed_cases(run, toolbox)
    diagnosis = diagnosed(case)
    assert diagnosis.main.rests_on == "true mask"
    assert case.unchanged(diagnosis.main.rests_on) == Control(0, FIRST_CONTROLS)
    assert case.repeated(diagnosis.main.rests_on) == Control(CONTROLS, CONTROLS)


def test_the_page_blames_no_start_for_ground_truth_that_does_not_fit_its_image() -> None:
    broken = broken_scene(Cause.GROUND_TRUTH, 2)
    cast(Any, broken.toolbox).source = OneFrame(broken.problem)
    (it,) = received(verdict_message(ran(broken.toolbox)))["objects"]
    assert [finding["cause"] for finding in it["findings"]] == [Cause.GROUND_TRUTH]


def sound_scene(n_hypotheses: int = 2) -> tuple[Toolbox, Any]:
    rng = np.random.default_rng(0)
    m = model("duck")
    T = standing(m, rng)
    toolbox = Toolbox(resolve({"method": {"name": "rir", "refiner": "icp", "iterations": 3}}))
    return toolbox, toolbox.ordered(frame_of([Made(m, T, near(T, rng, n_hypotheses, 8, 8))], rng))


def test_the_threshold_decides_what_failed() -> None:
    toolbox, problem = sound_scene()
    run = toolbox.run(problem)
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, threshold=0.0)
    assert not diagnosis.main.is_confirmed or diagnosis.main.cause in (Cause.SCORE, Cause.REFINER)


@pytest.mark.parametrize("seed", range(4))
def test_sound_input_draws_no_suspicion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m = model(["duck", "mug", "carton", "jug"][seed])
    T = standing(m, rng)
    toolbox = Toolbox(resolve({"method": {"name": "rir", "refiner": "icp", "iterations": 1}}))
    problem = toolbox.ordered(frame_of([Made(m, T, near(T, rng, 1, 8, 8))], rng))
    run = toolbox.run(problem)
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, threshold=0.0, every_cause=True)
    named = {diagnosis.main.cause, *(f.cause for f in diagnosis.findings[1:])}
    assert not named & {Cause.SYMMETRIC, Cause.DEPTH, Cause.MASK, Cause.PLANE, Cause.COLLIDER, Cause.NEIGHBOUR}


def test_a_mask_beside_the_object_and_a_frame_without_plane_are_no_errors() -> None:
    toolbox, problem = sound_scene()
    (instance,) = problem.instances
    empty = replace(instance, mask=np.zeros_like(instance.mask), points_cam=np.zeros((0, 3)))
    blank = replace(problem, instances=(empty,), observation=replace(problem.observation, support=None))
    run = toolbox.run(blank)
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, threshold=0.03)
    assert diagnosis.main.cause == Cause.MASK
    assert diagnosis.main.numbers["miss_share"] == 1.0


def test_without_ground_truth_nothing_is_said() -> None:
    toolbox, problem = sound_scene()
    blind = replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))
    run = toolbox.run(blind)
    run.finish()
    assert diagnose(run, toolbox) == ()


def test_an_empty_pool_is_no_bad_pool() -> None:
    toolbox, problem = sound_scene(0)
    run = toolbox.run(problem)
    run.finish()
    (diagnosis,) = diagnose(run, toolbox)
    assert diagnosis.main.cause == Cause.NO_HYPOTHESIS
    assert diagnosis.findings == (diagnosis.main,)
    assert diagnosis.main.numbers["error_from_ground_truth"] < 0.1


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "metres"), (10.0, "centimetres"), (1.0, "")])
def test_translations_of_another_unit_are_named(factor: float, unit: str) -> None:
    toolbox, problem = sound_scene()
    hypotheses = problem.instances[0].hypotheses
    shrunk = [replace(h, T_cam_obj=transform(h.T_cam_obj[:3, :3], h.T_cam_obj[:3, 3] / factor)) for h in hypotheses]
    target = replace(problem.instances[0], hypotheses=tuple(shrunk))
    run = toolbox.run(replace(problem, instances=(target, *problem.instances[1:])))
    run.finish()
    found = diagnose(run, toolbox)
    if not unit:
        assert found == ()
        return
    assert (found[0].main.cause, found[0].main.is_confirmed) == (Cause.UNIT, True)
    assert f"look like {unit}, where millimetres are expected" in found[0].main.text
    assert found[0].main.numbers["error_repaired"] < 0.1


def test_the_same_run_gets_the_same_diagnosis_and_is_left_as_it_was() -> None:
    broken = broken_scene(Cause.POOL, 0)
    run = broken.toolbox.run(broken.problem)
    run.finish()
    before = run.iterations
    first, second = (diagnose(run, broken.toolbox) for _ in range(2))
    assert first_difference(first, second) is None
    again = broken.toolbox.run(broken.problem)
    again.finish()
    assert first_difference(before, again.iterations) is None


def test_asking_for_every_cause_keeps_the_main_one() -> None:
    broken = broken_scene(Cause.SIMULATION, 0)
    run = broken.toolbox.run(broken.problem)
    run.finish()
    (brief,), (thorough,) = diagnose(run, broken.toolbox), diagnose(run, broken.toolbox, every_cause=True)
    assert brief.main.cause == thorough.main.cause == Cause.SIMULATION
    assert brief.n_reruns <= thorough.n_reruns
    assert {f.cause for f in brief.findings[1:]} <= {f.cause for f in thorough.findings[1:]}
