"""What the page says of the iteration, the stage or the answer at the cursor."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.viewer.test_words import after
from verefine_viz.core.geometry import transform
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.headline import HINTS, UNVERIFIED, headline


def test_before_the_first_iteration_it_says_what_to_press() -> None:
    said = headline(after())
    assert said.startswith("Ready, before iteration 1. box has 3 hypotheses; hypothesis ")
    assert "is nearest, 4.0° and 3.0 mm from ground truth." in said
    assert said.endswith("Press Step (N) for one iteration, Run (Space) for all.")


def test_an_iteration_is_reported_in_the_order_it_happened() -> None:
    said = headline(after(c.Step()))
    parts = [
        "Iteration 1, box, hypothesis ",
        " of 3 (best UCB: ",
        "Simulation ",
        "and scored ",
        "; then ICP ",
        " accepted.",
    ]
    places = [said.index(p) for p in parts]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("current", "simulated", "refined", "said"),
    [
        (0.5, 0.9204, 0.9197, ("0.9204; ", "0.9197. ")),
        (0.5, 0.62, 0.74, ("0.62; ", "0.74. ")),
        (0.5, 0.92, 0.92, ("0.92; ", "0.92. ")),
        (0.74001, 0.62, 0.74, ("0.62; ", "0.74. ")),
        (0.752, 0.62, 0.74, ("0.620; ", "0.740. ", "less than before (0.752)")),
    ],
)
def test_scores_are_reported_with_the_digits_it_takes(
    current: float, simulated: float, refined: float, said: tuple[str, ...]
) -> None:
    view = after(c.Step())
    assert view.shown is not None
    scores = {"current": current, "simulated": simulated, "refined": refined}
    stages = tuple(
        s if s.score is None else replace(s, score=replace(s.score, score=scores[s.name])) for s in view.shown.stages
    )
    view = replace(view, shown=replace(view.shown, stages=stages, accepted="refined"))
    for part in said:
        assert part in headline(view)


def test_what_nobody_judged_is_called_so() -> None:
    said = headline(after(c.Step(), name="pir"))
    assert said.endswith(f"Refined accepted: PIR accepts it {UNVERIFIED}.")
    assert UNVERIFIED not in headline(after(c.Step(), name="sir"))
    assert UNVERIFIED not in headline(after(c.Step(), name="refine")), "there was nothing to choose from"


def test_the_end_names_the_answer_and_its_error() -> None:
    said = headline(after(c.RunUntil("end")))
    assert "Run finished: answer " in said
    assert said.endswith("mm from ground truth.")


def with_best_scores(view: Snapshot, scores: list[float]) -> Snapshot:
    """The view at the end of a run in which the hypotheses came to these scores."""
    assert view.state is not None
    arms = tuple(
        replace(arm, entries=tuple(replace(e, score=replace(e.score, score=s)) for e in arm.entries))
        for arm, s in zip(view.state.arms, scores, strict=True)
    )
    own = view.scene.object(view.target.instance.instance_id)
    assert own.answer is not None
    j = int(np.argmax(scores))
    answer = replace(own.answer, arm=j, score=replace(own.answer.score, score=scores[j]))
    scene = replace(view.scene, objects=(replace(own, answer=answer),))
    return replace(view, state=replace(view.state, arms=arms), scene=scene)


@pytest.mark.parametrize(
    ("scores", "said"),
    [
        ([0.41, 0.95, 0.32], ", 0.54 ahead of hypothesis 1"),
        ([0.9, 0.9507, 0.95], ", 0.0007 ahead of hypothesis 3"),
        ([0.95, 0.9, 0.95], ", level with hypothesis 3"),
    ],
)
@pytest.mark.parametrize("name", ["rir", "even", "expl", "vf_breadth"])
def test_the_end_names_the_runner_up_and_its_distance(name: str, scores: list[float], said: str) -> None:
    told = headline(with_best_scores(after(c.RunUntil("end"), name=name), scores))
    assert f"{said}; " in told


def with_poses(view: Snapshot, best_mm: float, rival_mm: float) -> Snapshot:
    """The view with the answer (of hypothesis 2) and the poses of hypothesis 3 so far beside the truth."""
    assert view.state is not None
    T_gt = view.target.instance.T_cam_obj_gt
    assert T_gt is not None
    best, rival = (T_gt @ transform(np.eye(3), [1e-3 * mm, 0, 0]) for mm in (best_mm, rival_mm))
    arms = list(view.state.arms)
    arms[2] = replace(arms[2], entries=tuple(replace(e, T_cam_obj=rival) for e in arms[2].entries))
    own = view.scene.object(view.target.instance.instance_id)
    assert own.answer is not None
    objects = (replace(own, answer=replace(own.answer, T_cam_obj=best)),)
    return replace(view, state=replace(view.state, arms=tuple(arms)), scene=replace(view.scene, objects=objects))


@pytest.mark.parametrize(
    ("runner_up", "rival_mm", "said"),
    [
        (0.947, 3.2, "0.003 ahead of hypothesis 3, which is 4.1 mm nearer to ground truth; "),
        (0.95, 3.2, "level with hypothesis 3, which is 4.1 mm nearer to ground truth; "),
        (0.947, 6.5, "0.003 ahead of hypothesis 3; "),
        (0.947, 12.0, "0.003 ahead of hypothesis 3; "),
        (0.93, 3.2, "0.020 ahead of hypothesis 3, which is 4.1 mm nearer to ground truth; "),
        (0.91, 3.2, "0.04 ahead of hypothesis 3; "),
    ],
)
def test_of_a_near_tie_it_is_said_that_the_runner_up_is_nearer_the_truth(
    runner_up: float, rival_mm: float, said: str
) -> None:
    view = with_best_scores(after(c.RunUntil("end")), [0.5, 0.95, runner_up])
    told = headline(with_poses(view, 7.3, rival_mm))
    assert said in told


@pytest.mark.parametrize("name", ["pir", "sir", "vf_depth"])
def test_no_runner_up_where_no_other_hypothesis_could_have_won_by_its_score(name: str) -> None:
    said = headline(after(c.RunUntil("end"), name=name))
    assert "ahead of" not in said
    assert "level with" not in said


def test_abbreviations_are_spelt_out_in_tooltips() -> None:
    shown = sentence(headline(after(c.Step())), HINTS)
    for word, meaning in (("UCB", "upper confidence bound"), ("ICP", "iterative closest point")):
        assert re.search(rf'<span class="term" title="{meaning}: [^"]*">{word}</span>', shown)


def test_stages_are_reported_one_by_one() -> None:
    said = [headline(after(*[c.StepStage()] * n)) for n in (1, 2, 3, 4)]
    assert "stage 1 of 4: current." in said[0]
    assert "(best UCB: " in said[0]
    assert "goes on from its current pose, which scores 0." in said[0]
    assert "stage 2 of 4: simulated. Simulation " in said[1]
    assert "where the refiner starts" in said[2]
    assert "stage 4 of 4: refined. ICP " in said[3]
