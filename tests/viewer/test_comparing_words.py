"""What the page says of two runs: where they part, and who comes nearer."""

from __future__ import annotations

from collections.abc import Sequence

from tests.changing import replace
from tests.fakes import FakeVerifier
from tests.viewer.fake_tools import FakeTools
from tests.viewer.two_runs import SESSION, SIR, TWO, debugger, sides
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.run.compare import Departure
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.comparison_tables import (
    better,
    legend,
    now_table,
    outcome_table,
    parting,
    scores_note,
    settings_list,
)
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.objects_panel import objects_html
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot


def test_the_first_difference_is_reached_and_said() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.CompareRun((("method.exploration", 5.0),))])
    v = sides(d)
    assert v.departures.deed.kind == "hypothesis"
    d.carry_out([c.SeekDifference()])
    v = sides(d)
    assert v.place == v.departures.deed.place  # type: ignore[union-attr]
    assert v.which == "kept"
    assert "the same for 1 iteration. Then in iteration 2 B works on hypothesis 3 of box instead of 1" in parting(v)


def test_a_run_beside_itself_has_no_difference_to_jump_to() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.CompareRun(), c.SeekDifference()])
    assert d.message.startswith("No difference in the 6 iterations")
    assert "the same in all 6 iterations" in parting(sides(d))
    assert {o.winner for o in sides(d).outcomes} == {"even"}


def test_scores_by_other_settings_are_not_compared() -> None:
    d = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun((*SIR, ("score.tau_m", 0.01)))])
    v = sides(d)
    assert not v.scores_alike
    assert "score.tau_m is 0.02 in A, 0.01 in B" in scores_note(v)
    assert "⚠" in outcome_table(v)
    assert [better(v, o) for o in v.outcomes] == ["A", "A"]
    blind = without_truth(v)
    assert "score.tau_m is 0.02 in A, 0.01 in B" in scores_note(blind)
    assert [better(blind, o) for o in blind.outcomes] == [None, None]


def test_scores_by_the_same_settings_are_compared() -> None:
    v = sides(debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun((*SIR, ("score.renderer", "cpu")))]))
    assert scores_note(v) == ""
    assert "⚠" not in outcome_table(v)
    blind = without_truth(v)
    assert [better(blind, o) for o in blind.outcomes] == ["A", "A"]


def test_each_side_is_reported_with_its_own_scores() -> None:
    class Stricter(FakeTools):
        """Scores a tenth with the smaller tolerance."""

        def __init__(self, session: Session) -> None:
            super().__init__(session)
            if session.score.tau_m < 0.02:
                self.verifier = StrictVerifier()

    class StrictVerifier(FakeVerifier):
        def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
            scores = super().score(target, Ts_cam_obj, placed)
            return replace(scores, score=scores.score / 10)

    d = Debugger(SESSION, None, Stricter).carry_out([c.RunUntil("end"), c.CompareRun((("score.tau_m", 0.01),))])
    v = sides(d)
    assert v.now_a.score is not None
    assert v.now_b.score is not None
    assert v.now_b.score < 0.1 < 0.9 < v.now_a.score
    assert f"{v.now_a.score:.2f} → {v.now_b.score:.2f}" in outcome_table(v), "as in the table above it"
    assert f"scores {10 * v.now_b.score:.2f}" in outcome_table(v), "by the settings of A"


def test_settings_changed_on_the_way_count() -> None:
    d = debugger().carry_out([c.RunUntil("end"), c.Fork((("score.alpha", 0.293),), 2, run=True), c.CompareBranch(0)])
    assert "score.alpha is 0.293 in A, 0.707 in B" in scores_note(sides(d))


def without_truth(v: ComparisonSnapshot) -> ComparisonSnapshot:
    """The same, where it is unknown who is nearer."""
    blind = [replace(o, a=o.a and replace(o.a, errors=None), b=o.b and replace(o.b, errors=None)) for o in v.outcomes]
    return replace(v, outcomes=tuple(blind))


def test_means_over_the_objects_stand_below_their_answers() -> None:
    v = sides(debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR)]))
    means = [sum(o.errors.add_s_mm for o in side) / 2 for side in zip(*((o.a, o.b) for o in v.outcomes), strict=True)]
    assert f"{means[0]:.1f} → {means[1]:.1f}" in outcome_table(v)


def test_names_from_data_are_text() -> None:
    evil = "<img src=x onerror=alert(1)>"

    class Evil(FakeTools):
        def problem(self, frame: str) -> Problem:
            problem = super().problem(frame)
            return replace(problem, models={k: replace(m, name=evil) for k, m in problem.models.items()})

    d = Debugger(SESSION, None, Evil).carry_out([TWO, c.RunUntil("end"), c.CompareRun()])
    v = replace(sides(d), name_a=evil, name_b=evil, settings=(("method.name", evil, evil),))
    shown = "".join([sentence(parting(v)), legend(v), now_table(v), outcome_table(v), settings_list(v)])
    assert "<img src=x" not in shown
    assert "&lt;img src=x" in shown


def test_a_run_that_ends_earlier_is_said_to_be_done() -> None:
    said = parting(sides(debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR)])))
    assert "Then B is done with box #0 after 2 iterations, while A goes on." in said
    shorter = debugger(Session(method=MethodSettings(name="sir", iterations=1)))
    said = parting(sides(shorter.carry_out([c.RunUntil("end"), c.CompareRun((("method.iterations", 3),))])))
    assert "Then B goes on with box, which A is done with after 1 iteration." in said


def test_runs_that_differ_from_the_start_are_said_to_begin_differently() -> None:
    v = sides(debugger().carry_out([c.RunUntil("end"), c.CompareRun(SIR)]))
    first = Departure(0, "start", "starts hypothesis 1 of box 3.0 mm and 1.0° away")
    begun = parting(replace(v, departures=v.departures._replace(deed=first)))
    assert "begin differently: B starts hypothesis 1 of box 3.0 mm" in begun
    once = Departure(1, "accepted", "accepts the refined pose of box instead of the simulated one", 1, 2)
    parted = parting(replace(v, departures=v.departures._replace(deed=once)))
    assert "in iteration 1 (B's 2) B accepts the refined pose" in parted


def test_the_frame_score_is_the_same_number_in_the_list_and_in_the_comparison() -> None:
    view = debugger().carry_out([TWO, c.RunUntil("end"), c.CompareRun(SIR)]).view()
    assert view.comparison.frame_scores[0] == view.frame_score.score
    assert f"{view.frame_score.score:.3f} → " in outcome_table(view.comparison)
    assert f"{view.frame_score.score:.2f}" in objects_html(view)


def test_a_name_does_not_say_twice_on_which_side_it_is() -> None:
    d = debugger().carry_out([TWO, c.RunTo(2), c.CompareRun(), c.RunB()])
    assert (sides(d).name_a, sides(d).name_b) == ("first run", "same settings")
    d.carry_out([c.SwapSides()])
    assert (sides(d).name_a, sides(d).name_b) == ("same settings", "first run")
