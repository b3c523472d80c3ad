"""From one answer of a batch to the next, over frames and runs, and back to what the batch says about it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import made_runs
from tests.made_runs import answer, finished
from tests.viewer.conftest import SESSION
from tests.viewer.fake_tools import FakeTools
from verefine_viz.batch.answer_cards import RIGHT, WRONG
from verefine_viz.batch.answer_tags import TAGS_FILE, Arrangement
from verefine_viz.batch.folder import RunFolder
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import AT_ITS_START, changed
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.errors_panel import plot_svg, trust_in_score
from verefine_viz.viewer.state.batch_gallery import Gallery, plot_of, read_gallery
from verefine_viz.viewer.text.findings import findings

SIR = changed(SESSION, {"method": {"name": "sir"}}, AT_ITS_START)
EVIDENCE = "No hypothesis of the box leads to the truth: the nearest starts 30° away."


def row(im_id: int, instance_id: int = 0, **values: object) -> Answer:
    known = {"obj_id": 1, "name": "box", "diameter_mm": 100.0, "score": 0.5}
    return answer(0, im_id, instance_id=instance_id, **{**known, **values})


RIR_ROWS = (
    row(1, add_s_mm=2.0, worst_iteration=1, method="rir", score=0.7),
    row(2, add_s_mm=60.0, best_iteration=2, method="rir", cause="pool", evidence=EVIDENCE),
    row(2, 1, add_s_mm=30.0, worst_iteration=7, method="rir", cause="score", score=0.9),
)
SIR_ROWS = (row(1, add_s_mm=40.0, best_iteration=0, method="sir", cause="pool"), row(2, status="no_answer"))


@pytest.fixture
def several(tmp_path: Path) -> Gallery:
    return Gallery(
        [
            BatchIndex(tmp_path / "rir", SESSION, BatchInfo(), RIR_ROWS),
            BatchIndex(tmp_path / "sir", SIR, BatchInfo(), SIR_ROWS),
        ]
    )


@pytest.fixture
def debugger(several: Gallery) -> Debugger:
    return Debugger(several.session(several.worst.run), None, FakeTools, batch=several)


def open_now(debugger: Debugger) -> tuple[str, str, int | None, int]:
    """Method, frame, object in focus, iteration."""
    space = debugger.workspace
    return space.tools.session.method.name, space.frame, debugger.options.focus, space.run.cursor


def test_keys_go_through_wrong_answers_worst_first_each_where_it_went_wrong(debugger: Debugger) -> None:
    seen = []
    for _ in range(4):
        debugger.carry_out([c.OpenFailure(1)])
        seen.append(open_now(debugger))
    assert seen == [("sir", "0/2", 0, 0), ("rir", "0/2", 0, 2), ("sir", "0/1", 0, 0), ("rir", "0/2", 1, 7)]
    with pytest.raises(InputError, match="last answer of the list"):
        debugger.apply(c.OpenFailure(1))
    debugger.carry_out([c.OpenFailure(-1)])
    assert open_now(debugger) == ("sir", "0/1", 0, 0)


def test_keys_heed_filters_which_stay_when_a_frame_is_opened(debugger: Debugger) -> None:
    chosen = {"method": "rir", "result": RIGHT}
    debugger.carry_out([c.ArrangeGallery(only=(("method", "rir"), ("result", RIGHT))), c.OpenFailure(1)])
    assert open_now(debugger) == ("rir", "0/1", 0, 1)
    assert debugger.options.arrangement.only == chosen
    debugger.carry_out([c.ArrangeGallery(search="box 0/2 ICP", order="score")])
    with pytest.raises(InputError, match="choose other filters"):
        debugger.apply(c.OpenFailure(1))


def test_what_is_logged_leads_there_again(debugger: Debugger, several: Gallery) -> None:
    debugger.carry_out([c.OpenFailure(1), c.OpenFailure(1), c.Step(), c.OpenFailure(1), c.OpenFailure(1)])
    again = Debugger(several.session(several.worst.run), None, FakeTools, batch=several).carry_out(debugger.log)
    assert open_now(again) == open_now(debugger)
    assert not any(isinstance(command, c.OpenFailure) for command in debugger.log)


def test_the_log_shows_what_was_shown_where_the_last_iteration_was_asked_for(
    debugger: Debugger, several: Gallery
) -> None:
    total = 12
    debugger.carry_out([c.OpenAt("0/2", total, "rir", 1)])
    assert debugger.options.stage is not None
    assert {"current", "accepted"} <= set(debugger.view().poses), "it is shown itself, and not the answer"
    again = Debugger(several.session(several.worst.run), None, FakeTools, batch=several).carry_out(debugger.log)
    assert again.options == debugger.options
    debugger.carry_out([c.Restart(), c.RunTo(total)])
    assert debugger.view().is_answer, "of this run no iteration was asked for"


def test_a_run_that_was_left_is_opened_with_its_own_session_again(debugger: Debugger, several: Gallery) -> None:
    failure = several.opens(several.entries[1])
    debugger.carry_out([failure, c.Fork((("method.exploration", 0.0),), 0, run=True)])
    assert debugger.workspace.work.index == 1
    debugger.carry_out([failure])
    assert debugger.workspace.work.index == 0
    debugger.carry_out([c.Restart((("method.name", "pir"),)), failure])
    assert open_now(debugger) == ("rir", "0/2", 0, 2)


def test_the_evidence_stands_first_among_the_findings_and_leads_back(debugger: Debugger, several: Gallery) -> None:
    debugger.carry_out([several.opens(several.entries[1])])
    first = findings(debugger.view())[0]
    assert EVIDENCE in first.text
    assert "iteration 2 made the answer" in first.text
    assert first.red
    assert first.command is None
    debugger.carry_out([c.Back()])
    first = findings(debugger.view())[0]
    assert EVIDENCE in first.text
    assert isinstance(first.command, c.OpenAt)
    debugger.carry_out([first.command])
    assert open_now(debugger) == ("rir", "0/2", 0, 2)


def test_of_another_scene_the_batch_says_nothing(debugger: Debugger) -> None:
    assert debugger.view().entry is not None
    other = SESSION.model_copy(update={"scene": SESSION.scene.model_copy(update={"seed": 7})})
    debugger.workspace.open(other, None)
    assert debugger.view().entry is None


def test_the_page_opens_with_the_gallery_and_an_answer_where_it_can_be_inspected(debugger: Debugger) -> None:
    assert debugger.options.preset == "gallery"
    debugger.carry_out([c.OpenFailure(1)])
    assert debugger.options.preset == "inspect"
    debugger.carry_out([c.ShowLayout("gallery"), c.Step()])
    assert debugger.options.preset == "gallery"
    debugger.carry_out([c.ShowLayout("maps"), c.OpenFailure(1)])
    assert debugger.options.preset == "maps", "what the user looks at stays"


def test_without_a_batch_there_is_no_gallery() -> None:
    alone = Debugger(SESSION, None, FakeTools)
    assert alone.options.preset == "inspect"
    for command in c.ShowLayout("gallery"), c.TagAnswers((0,), "x"), c.OpenFailure(1):
        with pytest.raises(InputError, match="no batch is open; open one with verefine-viz view FOLDER"):
            alone.apply(command)


def test_tags_and_saved_filters_lie_beside_their_runs(debugger: Debugger, several: Gallery, tmp_path: Path) -> None:
    debugger.carry_out(
        [c.TagAnswers((1, 3), " handle  hidden "), c.TagAnswers((1,), "b"), c.SaveFilter("mine", "score")]
    )
    again = Gallery(list(several.runs.values()))
    for gallery in several, again:
        assert gallery.tags_of(gallery.entries[1]) == ("handle hidden", "b")
        assert gallery.tags_of(gallery.entries[3]) == ("handle hidden",)
        assert gallery.saved_filters == {"mine": Arrangement(order="score")}
        tagged = gallery.shown(Arrangement(only={"tag": "handle hidden"}, search="HIDDEN"))
        assert set(tagged) == {gallery.entries[1], gallery.entries[3]}
    debugger.carry_out([c.TagAnswers((1,), "handle hidden", on=False), c.TagAnswers((3,), "handle hidden", on=False)])
    debugger.carry_out([c.DeleteFilter("mine")])
    again = Gallery(list(several.runs.values()))
    assert [again.tags_of(entry) for entry in again.entries] == [(), ("b",), (), (), ()]
    assert again.saved_filters == {}
    assert sorted(path.parent.name for path in tmp_path.rglob(TAGS_FILE)) == ["rir", "sir"]
    for command in c.TagAnswers((9,), "x"), c.TagAnswers((0,), "  "), c.SaveFilter("x" * 41):
        with pytest.raises(InputError):
            debugger.apply(command)


def test_a_damaged_file_of_tags_is_reported_and_left_alone(several: Gallery, tmp_path: Path) -> None:
    path = tmp_path / "rir" / TAGS_FILE
    path.parent.mkdir()
    path.write_text('{"tags": {"0/1#0": "one"}}')
    gallery = Gallery(list(several.runs.values()))
    assert list(gallery.tag_faults) == ["rir"]
    assert "tags.json is damaged (tags.0/1#0 = 'one'" in gallery.tag_faults["rir"]
    with pytest.raises(InputError, match="is damaged"):
        gallery.tag([gallery.entries[0]], "x", True)
    assert path.read_text() == '{"tags": {"0/1#0": "one"}}'
    gallery.tag([gallery.entries[3]], "x", True)


def test_filters_and_orders_go_over_all_runs(several: Gallery) -> None:
    wrong = {"result": WRONG}
    assert several.first_arrangement == Arrangement(only=wrong)
    assert [e.row.instance_id for e in several.shown(Arrangement(only={**wrong, "run": "rir"}))] == [0, 1]
    pool = Arrangement(only={"cause": "no good hypothesis in the pool"})
    assert [e.run for e in several.shown(pool)] == ["rir", "sir"]
    misleading = Arrangement(order="misleading", only={**wrong, "run": "rir"})
    assert [e.row.score for e in several.shown(misleading)] == [0.9, 0.5]
    assert len(several.shown(Arrangement(order="frame"))) == 5
    assert [e.run for e in several.shown(Arrangement(search="BOX 30°"))] == ["rir"]


def test_a_click_into_the_plot_opens_the_nearest_point(debugger: Debugger, several: Gallery) -> None:
    plot = plot_of(several, {})
    assert len(plot.entries) == 4
    at = plot.place(several.entries[2])
    debugger.carry_out([c.OpenPoint(round(at[0]) + 3, round(at[1]) - 3)])
    assert open_now(debugger) == ("rir", "0/2", 1, 7)
    with pytest.raises(InputError, match="no object there"):
        debugger.apply(c.OpenPoint(0, 0))
    assert plot_of(several, {"run": "sir", "cause": "whatever"}).entries == (several.entries[3],)


def test_the_plot_says_how_often_the_score_lies_and_rings_what_is_open(several: Gallery) -> None:
    plot = plot_of(several, {})
    assert "33% of pairs" in trust_in_score(plot)  # 0.5, 0.9 and 0.5 are wrong, 0.7 is right.
    assert "% of pairs" not in trust_in_score(plot_of(several, {"run": "sir"}))
    assert "<circle" in plot_svg(plot, several.entries[0])
    assert "<circle" not in plot_svg(plot, None)


def written(folder: Path, session: Session, rows: tuple[Answer, ...], is_finished: bool = True) -> None:
    run = RunFolder(folder, session)
    run.write_json("run.json", {"status": "finished" if is_finished else "running"})
    if is_finished:
        for frame in dict.fromkeys(r.frame for r in rows):
            made_runs.written(folder, finished(frame, [r for r in rows if r.frame == frame]))
    run.close()


def test_finished_runs_of_a_folder_are_read_and_the_rest_is_counted(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
    written(tmp_path / "a", SESSION, RIR_ROWS)
    written(tmp_path / "b", SIR, SIR_ROWS)
    written(tmp_path / "c", SESSION, (), is_finished=False)
    found = read_gallery(tmp_path, {"method": {"exploration": 0.3}})
    assert list(found.runs) == ["a", "b"]
    assert found.n_unfinished == 1
    assert len(found.entries) == 5
    assert found.session("b").method.name == "sir"
    assert found.session("b").method.exploration == 0.3
    assert found.session("a").scene.frames == ("0/2", "0/1")
    alone = read_gallery(tmp_path / "a")
    assert not alone.has_several_runs
    assert alone.opens(alone.worst).run == ""
    with pytest.raises(InputError, match="has no finished frame yet"):
        read_gallery(tmp_path / "c")


def test_a_failure_is_opened_with_ground_truth_beside_it(debugger: Debugger, several: Gallery) -> None:
    wrong = next(entry for entry in several.entries if entry.is_wrong and entry.can_be_opened)
    options = debugger.carry_out([several.opens(wrong)]).view().options
    assert options.b == "ground truth"
    assert options.a in ("accepted", "best")
    debugger.carry_out([c.Compare(a="initial", b="best"), c.Back()])
    assert (debugger.view().options.a, debugger.view().options.b) == ("initial", "best"), "the user's choice stays"
