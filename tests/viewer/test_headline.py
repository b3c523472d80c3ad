"""What the page says of the iteration, the stage or the answer at the cursor."""

from __future__ import annotations

import numpy as np

from tests.changing import replace
from tests.viewer.test_words import after, debugger, off
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.diagnosis.signs import RunnerUp
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import arms_table
from verefine_viz.viewer.panels.bandit_panel import chosen
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.headline import UNVERIFIED, headline


def test_before_the_first_iteration_it_says_what_there_is() -> None:
    said = headline(after())
    assert "box has 3 hypotheses" in said
    assert "nearest, 4.0° and 3.0 mm from ground truth" in said


def test_an_iteration_is_reported_in_the_order_it_happened() -> None:
    said = headline(after(c.Step()))
    places = [said.index(part) for part in ("Iteration 1", "hypothesis ", "UCB", "Simulation ", "ICP ", "accepted")]
    assert places == sorted(places)


def test_scores_are_reported_with_the_digits_it_takes() -> None:
    view = after(c.Step())
    for current, simulated, refined, said in (
        (0.5, 0.9204, 0.9197, ("0.9204", "0.9197")),
        (0.5, 0.62, 0.74, ("0.62; ", "0.74. ")),
        (0.752, 0.62, 0.74, ("0.620", "0.740", "0.752")),
    ):
        scores = {"current": current, "simulated": simulated, "refined": refined}
        stages = tuple(
            s if s.score is None else replace(s, score=replace(s.score, score=scores[s.name]))
            for s in view.shown.stages
        )
        told = headline(replace(view, shown=replace(view.shown, stages=stages, accepted="refined")))
        assert all(part in told for part in said), told


def test_what_nobody_judged_is_called_so() -> None:
    assert UNVERIFIED in headline(after(c.Step(), name="pir"))
    assert UNVERIFIED not in headline(after(c.Step(), name="sir"))
    assert UNVERIFIED not in headline(after(c.Step(), name="refine")), "there was nothing to choose from"


def with_best_scores(view: Snapshot, scores: list[float]) -> Snapshot:
    """The view at the end of a run in which the hypotheses came to these scores."""
    arms = tuple(
        replace(arm, entries=tuple(replace(e, score=replace(e.score, score=s)) for e in arm.entries))
        for arm, s in zip(view.state.arms, scores, strict=True)
    )
    own = view.scene.object(view.target.instance.instance_id)
    j = int(np.argmax(scores))
    answer = replace(own.answer, arm=j, score=replace(own.answer.score, score=scores[j]))
    scene = replace(view.scene, objects=(replace(own, answer=answer),))
    rival = max((k for k in range(len(scores)) if k != j), key=lambda k: scores[k])
    pose = replace(answer, arm=rival, score=replace(answer.score, score=scores[rival]))
    (done,) = view.finished
    done = replace(done, answer=answer, runner_up=RunnerUp(pose, scores[j] - scores[rival], 0.0))
    return replace(view, state=replace(view.state, arms=arms), scene=scene, finished=(done,))


def test_the_end_names_the_runner_up_and_its_distance() -> None:
    for name in ("rir", "even", "expl", "vf_breadth"):
        view = after(c.RunUntil("end"), name=name)
        assert "Run finished" in headline(view), name
        for scores, said in (
            ([0.41, 0.95, 0.32], "0.54 ahead of hypothesis 1"),
            ([0.9, 0.9507, 0.95], "0.0007 ahead of hypothesis 3"),
            ([0.95, 0.9, 0.95], "level with hypothesis 3"),
        ):
            assert said in headline(with_best_scores(view, scores)), (name, scores)
    for name in ("pir", "sir", "vf_depth"):  # No other hypothesis could have won by its score.
        said = headline(after(c.RunUntil("end"), name=name))
        assert "ahead of" not in said, name
        assert "level with" not in said, name


def test_of_a_near_tie_it_is_said_that_the_runner_up_is_nearer_the_truth() -> None:
    ended = after(c.RunUntil("end"))
    for runner_up, rival_mm, is_said in (
        (0.947, 3.2, True), (0.95, 3.2, True), (0.947, 6.5, False), (0.947, 12.0, False), (0.93, 3.2, True),
        (0.91, 3.2, False),
    ):  # fmt: skip
        told = headline(with_poses(with_best_scores(ended, [0.5, 0.95, runner_up]), 7.3, rival_mm))
        assert ("hypothesis 3, which is 4.1 mm nearer to ground truth" in told) == is_said, (runner_up, rival_mm)


def with_poses(view: Snapshot, best_mm: float, rival_mm: float) -> Snapshot:
    """The view with the answer (of hypothesis 2) and the poses of hypothesis 3 so far beside the truth."""
    T_gt = view.target.instance.T_cam_obj_gt
    best, rival = (T_gt @ transform(np.eye(3), [1e-3 * mm, 0, 0]) for mm in (best_mm, rival_mm))
    (done,) = view.finished
    answer, runner_up = replace(done.answer, T_cam_obj=best), done.runner_up
    pose = replace(runner_up.pose, T_cam_obj=rival)
    return replace(view, finished=(replace(done, answer=answer, runner_up=replace(runner_up, pose=pose)),))


def test_stages_are_reported_one_by_one() -> None:
    said = [headline(after(*[c.StepStage()] * n)) for n in (1, 2, 3, 4)]
    for told, part in zip(said, ("1 of 4: current", "2 of 4: simulated", "3 of 4", "4 of 4: refined"), strict=True):
        assert part in told


def moved(arm: int, turn_deg: float, mm: float, *first: c.Command) -> Snapshot:
    """Iteration 0 of a run that goes on from hypothesis ``arm`` put that far from ground truth."""
    d = debugger().carry_out([*first, c.SelectArm(arm), c.EditPose()])
    T_gt = d.view().target.instance.T_cam_obj_gt
    T: Float = T_gt @ transform(axis_angle(np.array([0.0, 0, 1]), np.deg2rad(turn_deg)), [1e-3 * mm, 0, 0])
    there = c.DragPose(tuple(float(x) for x in T.ravel()))
    return d.carry_out([there, c.ForkFromPose(), c.Seek(0)]).view()


def test_the_hypotheses_that_are_best_and_nearest_are_named_with_scores_and_errors_that_they_start_with() -> None:
    view = after()
    view = replace(view, initial_errors=(off(12, 9, 0.2), off(11, 7, 0.1), off(13, 8, 0.3)))
    assert "hypothesis 1 scores best with 0.83, hypothesis 2 is nearest, 11.0° and 7.0 mm" in headline(view)
    said = headline(moved(2, 1.0, 1.0))
    assert "hypothesis 3 scores best with 0.9" in said
    assert "is nearest, 1.0° and 1.0 mm" in said
    later = headline(moved(2, 1.0, 1.0, c.Step()))
    assert "hypothesis 1 scores best with 0.83 and is nearest, 4.0° and 3.0 mm" in later, "no start"


def test_a_hypothesis_moved_away_no_longer_scores_best_but_its_initial_pose_may() -> None:
    said = headline(moved(0, 60.0, 80.0))
    assert "the initial pose of hypothesis 1 scores best with 0.83, hypothesis 3 is nearest, 12.0°" in said


def test_a_method_that_looks_at_one_hypothesis_does_not_say_that_it_scores_best() -> None:
    for name in ("pir", "sir", "refine"):
        assert f"{name.upper()} works on hypothesis 1 alone, which scores 0.83" in headline(after(name=name))


def test_what_comes_first_is_reported_with_the_exploration_of_the_start() -> None:
    """A branch that explores more from iteration 1 on began as the run that it leaves."""
    wider = c.Fork((("method.exploration", 3.0),), 1)
    before, fork = after(c.Step(), c.Seek(0)), after(c.Step(), wider, c.Seek(0))
    assert fork.session.method.exploration == 3.0
    assert (chosen(fork), arms_table(fork)) == (chosen(before), arms_table(before))
    at_once = after(c.Step(), c.Fork((("method.exploration", 3.0),), 0), c.Seek(0))
    assert chosen(at_once) != chosen(before)
