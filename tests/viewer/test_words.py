"""What the page says: sentences, findings and tables, from a view alone."""

from __future__ import annotations

from typing import Any

from tests.changing import replace
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.records import Best
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing import pose_tables as tables
from verefine_viz.viewer.drawing.bandit_tables import arm_history, arms_table, n_means, scene_arms_table
from verefine_viz.viewer.drawing.markup import text
from verefine_viz.viewer.panels.bandit_panel import chosen, pull_lines
from verefine_viz.viewer.panels.errors_panel import errors_words
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.panels.physics_panel import physics_words, plane_warning
from verefine_viz.viewer.panels.timeline_panel import timeline_words
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import verdict_mark
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.pose_words import compared


def debugger(**method: Any) -> Debugger:
    return Debugger(Session(method=MethodSettings(iterations=2, **method)), None, FakeTools)


def after(*commands: c.Command, **method: Any) -> Snapshot:
    return debugger(**method).carry_out(commands).view()


def off(rotation_deg: float, translation_mm: float, relative: float) -> PoseErrors:
    return PoseErrors(rotation_deg, translation_mm, relative * 100, relative * 100, relative * 100, relative)


def test_words_depend_on_the_method() -> None:
    session = Session(physics=PhysicsSettings(enabled=False))
    assert "off" in physics_words(Debugger(session, None, FakeTools).carry_out([c.Step()]).view())
    assert "hypothesis 1 alone" in chosen(after(c.Step(), name="pir"))
    assert "took hypothesis" in chosen(after(c.Step()))
    assert "bandit counted" in arms_table(after(c.Step()))
    for name in ("pir", "refine"):
        assert "bandit counted" not in arms_table(after(c.Restart((("method.name", name),)), c.Step())), name


def test_objects_that_wait_for_their_turn_count_their_first_scores() -> None:
    html = scene_arms_table(after(c.OpenFrame("0/2"), c.ShowScene(), c.Step()))
    assert html.count('title="1 · 1 · 1"') == 2


def test_a_far_start_that_led_nowhere_is_red_once_the_run_is_over() -> None:
    view = after(c.RunUntil("end"))
    (own,) = view.finished
    wrong = replace(own, errors=off(40, 70, 0.8), starts=(off(41, 80, 0.9),) * 3, discarded=None)
    (said,) = findings(replace(view, finished=(wrong,)))
    assert said.red
    assert said.text.startswith("No hypothesis of the box starts near: best initial error 41° and 80 mm")
    assert (said.label, said.command) == ("iteration 0", c.Seek(0))
    for view in (after(), after(c.RunUntil("end")), after(c.RunUntil("end"), c.Seek(0))):
        assert findings(view) == (), "nothing is wrong before the run, and a good run has none"


def test_a_score_that_prefers_a_wrong_pose_is_blamed_but_for_ground_truth_that_does_not_fit() -> None:
    view = after(c.RunUntil("end"), c.ScoreGroundTruth())
    best, truth = view.poses["best"], view.ground_truth
    (own,) = view.finished
    assert best.score is not None
    assert truth is not None
    assert view.a is not None
    assert view.b is not None
    for at_gt, said, other in (
        (0.82, "The score prefers the answer to ground truth.", "does not fit"),
        (0.08, "Ground truth does not fit this image: the answer explains most of it", "prefers"),
    ):
        wrong = replace(best, errors=off(127, 45, 0.5), score=replace(best.score, score=0.94))
        right = replace(truth, score=replace(best.score, score=at_gt))
        done = replace(own, answer=replace(own.answer, score=wrong.score), errors=wrong.errors, score_at_gt=right.score)
        shown = replace(
            view,
            poses=view.poses | {"best": wrong, "ground truth": right},
            ground_truth=right,
            finished=(done,),
            a=replace(view.a, pose=wrong),
            b=replace(view.b, pose=right),
        )
        for words in (errors_words(shown), compared(shown)):
            assert said in words
            assert other not in words
    (note,) = findings(shown)
    assert note.text.startswith("The ground truth of the box does not fit this image: it scores 0.08, the answer 0.94.")


def test_errors_and_score_say_what_the_score_makes_of_the_true_pose() -> None:
    view = after(c.RunUntil("end"), c.ScoreGroundTruth())
    best, true = view.poses["best"], view.ground_truth
    assert best.score is not None
    assert true is not None

    def scored(own: float, of_truth: float) -> Snapshot:
        assert best.score is not None
        near = replace(best, errors=off(2, 4, 0.02), score=replace(best.score, score=own))
        truth = replace(true, score=replace(best.score, score=of_truth))
        poses = view.poses | {"best": near, "ground truth": truth}
        assert view.a is not None
        assert view.b is not None
        sides = {"a": replace(view.a, pose=near), "b": replace(view.b, pose=truth)}
        return replace(view, poses=poses, ground_truth=truth, **sides)  # type: ignore[arg-type]

    preferred = scored(0.755, 0.714)
    said = "scores as much as ground truth or more"
    assert said in errors_words(preferred)
    assert said in compared(preferred)
    known = scored(0.714, 0.755)
    assert "scores as much" not in errors_words(known) + compared(known)
    assert said in errors_words(scored(0.7, 0.7)), "nothing but the score leads to ground truth"


def test_errors_say_that_the_best_pose_is_a_initial_pose_which_iterations_left_as_it_is() -> None:
    said = "The answer is an initial pose"
    view = after(c.RunUntil("end"))
    assert said not in errors_words(view)
    first = after(c.Step()).state.arms[0].entries[0]
    unrefined = Best(first.T_cam_obj, first.score, 0, 0, "initial")
    assert view.state is not None
    told = replace(view, state=replace(view.state, best=unrefined), is_answer=False)
    assert said in errors_words(told)
    assert said not in errors_words(replace(told, cursor=0)), "nothing was tried"
    assert said not in errors_words(replace(told, cursor=1, is_partial=True)), "nothing was tried to its end"
    answers = tuple(replace(o, answer=unrefined) for o in view.scene.objects)
    assert said in errors_words(replace(view, scene=replace(view.scene, objects=answers)))


def test_a_weak_plane_and_a_missing_one_are_found() -> None:
    view = after()
    observation = view.target.observation
    assert observation.support is not None
    weak = replace(observation, support=replace(observation.support, inlier_share=0.31))
    doubted = replace(view, target=replace(view.target, observation=weak))
    found = findings(doubted)
    assert "explains only 31% of the background" in found[0].text
    assert text(found[0].text) in plane_warning(doubted), "the Physics panel says the same"
    none = replace(observation, support=None, support_note="no plane among 12 points")
    found = findings(replace(view, target=replace(view.target, observation=none)))
    assert found[0].text.startswith("No physics: no plane among 12 points.")


def test_the_arms_table_shows_the_numbers_that_chose() -> None:
    view = after(c.Step(), c.Step(), c.Step())
    choice = view.shown.choice
    html = arms_table(view)
    for j in range(3):
        assert f"{choice.ucb[j]:.3f}" in html
    assert f"{choice.arm + 1} ◂" in html
    pulled = [line.values[-1] for line in pull_lines(view, 3)]
    at_choice = [1 + n - (j == view.shown.arm) for j, n in enumerate(pulled)]
    assert at_choice == choice.plays.tolist(), "what the line says is what is counted"
    fading = view.session.model_copy(update={"method": MethodSettings(name="vf_depth", discount=0.9)})
    assert "×0.9 a pass" in n_means(replace(view, session=fading))


def test_names_from_data_are_text_everywhere() -> None:
    view = after(c.RunUntil("end"), c.Fork())
    evil = "<script>alert(1)</script>"
    hypotheses = tuple(replace(h, source=evil) for h in view.target.instance.hypotheses)
    target = replace(
        view.target,
        model=replace(view.target.model, name=evil),
        instance=replace(view.target.instance, hypotheses=hypotheses),
    )
    branches = tuple(replace(b, name=evil) for b in view.branches)
    view = replace(view, target=target, branches=branches)
    html = arm_history(view) + tables.starts_table(view) + tables.branches_table(view) + timeline_words(view, ())
    assert "<script>" not in html
    assert html.count("&lt;script&gt;") >= 4


def test_a_tenth_of_the_diameter_decides_and_without_ground_truth_nothing_does() -> None:
    for relative, mark in ((0.02, "✓"), (0.0999, "✓"), (0.1, "✗"), (2.0, "✗")):
        assert verdict_mark(off(1.0, 1.0, relative)) == mark, relative
    assert verdict_mark(None) == ""


def test_the_list_marks_the_wrong_ones_alone() -> None:
    session = Session(method=MethodSettings(name="rir", iterations=2))
    view = Debugger(session, None, FakeTools).carry_out([c.OpenFrame("0/2"), c.RunUntil("end")]).view()
    in_legend = objects_html(view).count("✗")
    right, wrong = view.scene.objects
    objects = (right, replace(wrong, errors=off(40.0, 30.0, 0.3)))
    html = objects_html(replace(view, scene=replace(view.scene, objects=objects)))
    assert html.count("✗") == in_legend + 1
    assert "30.0 ✗" in html
    assert "1/2 ✓" in html
