"""A batch's answers on the page: a gallery to sort and filter, one click to where an object went wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from verefine_viz.viewer.panels.batch_panel import card, choices, pages, summary

from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_app import SESSION, cursor, until
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.journal import RunFile
from verefine_viz.batch.rows import ObjectRow
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.state.batch_gallery import PAGE, WRONG, Gallery


def row(im_id: int, status: str = "ok", add_s_mm: float | None = None, worst: int | None = None) -> ObjectRow:
    return ObjectRow(
        scene_id=0, im_id=im_id, instance_id=0, obj_id=1, name="<b>box</b>", status=status, score=0.5,  # type: ignore[arg-type]
        add_s_mm=add_s_mm, diameter_mm=100.0, worst_iteration=worst, events="score_fell", message="no depth <i>",
    )  # fmt: skip


def gallery(tmp_path: Path, *rows: ObjectRow) -> Gallery:
    return Gallery([BatchIndex(tmp_path, SESSION, RunFile(), rows)])


def content(app: App) -> str:
    """The cards on the page."""
    assert app.page.layout.batch is not None
    return "".join(block._handle.content for block in app.page.layout.batch._cards)


def test_cards_are_links_to_the_worst_iteration_and_names_are_text(tmp_path: Path) -> None:
    found = gallery(tmp_path, row(2, add_s_mm=42.0, worst=3), row(1, "failed"))
    wrong, failed = found.entries
    html = card(wrong, found.opens(wrong), None, False, False)
    assert "&lt;b&gt;box" in html
    assert "<b>box" not in html
    assert '{"command": "OpenAt", "frame": "0/2", "iteration": 3' in html.replace("&quot;", '"')
    html = card(failed, found.opens(failed), None, False, False)
    assert "&lt;i&gt;" in html
    assert "data-cmd" not in html


def test_what_a_card_has_no_room_for_is_in_its_tooltip(tmp_path: Path) -> None:
    name = "a_model_with_a_name_that_no_card_has_room_for"
    wrong = row(2, add_s_mm=42.0).model_copy(
        update={"name": name, "method": "rir", "cause": "score", "evidence": "No."}
    )
    failed = row(1, "failed").model_copy(update={"name": name, "method": "rir"})
    entries = gallery(tmp_path, wrong, failed).entries
    tips = [card(e, c.Step(), None, False, False).partition('title="')[2].partition('"')[0] for e in entries]
    cause = "score ranks a wrong pose above the ground truth"
    assert tips[0].startswith(f"{name} · 0/2 · rir: {cause}. No. Opens ")
    assert tips[1] == f"{name} · 0/1 · rir: no depth &lt;i&gt;."


def test_the_summary_counts_what_is_correct_and_what_has_no_answer(tmp_path: Path) -> None:
    found = gallery(tmp_path, row(1, add_s_mm=5.0), row(1, add_s_mm=50.0), row(2, "failed"))
    said = summary(found, found.entries[:1])
    assert said.startswith("1 of 2 objects in 2 frames are right; 1 has no answer")
    assert "1 match. Click to open; J/K = next/previous." in said
    assert "No match: choose other filters." in summary(found, ())


def test_objects_of_failed_frames_and_those_left_out_count_as_missed(tmp_path: Path) -> None:
    lost = [row(2, status).model_copy(update={"has_truth": True}) for status in ("failed", "left_out")]
    unknown = row(3, "failed").model_copy(update={"obj_id": None, "instance_id": None, "name": ""})
    found = gallery(tmp_path, row(1, add_s_mm=5.0), *lost, unknown)
    assert found.outcome == "1 of 3 objects in 3 frames are right; 2 have no answer; 1 frame failed"
    assert "1 match. Click to open;" in summary(found, found.entries)
    assert ", none can be opened." in summary(found, found.entries[1:])
    for entry, said in zip(found.entries[1:], ("frame failed", "left out", "frame failed"), strict=True):
        html = card(entry, found.opens(entry), None, False, False)
        assert said in html
        assert "data-cmd" not in html


def test_data_in_doubt_are_told_on_the_card_and_above_all_cards(tmp_path: Path) -> None:
    doubted = row(1, add_s_mm=42.0).model_copy(
        update={
            "cause": "score",
            "evidence": "The score misleads. Look at the data first: objects appear larger: check cam_K.",
        }
    )
    found = gallery(tmp_path, doubted, row(2, add_s_mm=42.0).model_copy(update={"cause": "score"}))
    assert found.doubt == "Look at the data first: in frame 0/1, objects appear larger: check cam_K."
    told, plain = (card(entry, found.opens(entry), None, False, False) for entry in found.entries)
    assert "data in doubt</b></span>" in told
    assert "data in doubt" not in plain
    assert gallery(tmp_path, row(2, add_s_mm=42.0)).doubt == ""
    twice = gallery(tmp_path, doubted, doubted.model_copy(update={"im_id": 3}), row(2, add_s_mm=42.0))
    assert twice.doubt.startswith(
        "Look at the data first: in 2 of 3 frames, such as 0/1, objects appear larger: check cam_K."
    )
    runs = [BatchIndex(tmp_path / name, SESSION, RunFile(), found.runs[tmp_path.name].rows) for name in ("rir", "sir")]
    assert Gallery(runs).doubt.startswith(
        "Look at the data first: in 2 of 4 frames of 2 runs, such as 0/1 of rir, objects appear larger: check cam_K."
    )


@pytest.mark.parametrize(
    ("worst", "best", "said"),
    [
        (3, 5, "Opens at iteration 3, which made it worse than any other."),
        (None, 5, "Opens at iteration 5, where the answer comes from: no iteration made it much worse."),
        (None, 0, "Opens before iteration 1, where the answer comes from: no iteration made it much worse."),
    ],
)
def test_a_card_says_where_it_leads_and_why(tmp_path: Path, worst: int | None, best: int, said: str) -> None:
    found = gallery(tmp_path, row(2, add_s_mm=42.0, worst=worst).model_copy(update={"best_iteration": best}))
    assert said in card(found.entries[0], found.opens(found.entries[0]), None, False, False)


def test_filters_can_be_chosen_where_there_is_a_choice(tmp_path: Path) -> None:
    rows = row(1, add_s_mm=5.0), row(2, add_s_mm=50.0).model_copy(update={"name": "mug"})
    html = choices(gallery(tmp_path, *rows), "score", {"object": "mug"}).replace("&quot;", '"')
    assert '{"command": "FilterBatch", "by": "object", "value": "mug"}" selected' in html
    assert '{"command": "SortBatch", "order": "score"}" selected' in html
    assert f'"value": "{WRONG}"}}" selected' in html
    assert 'aria-label="Cause"' not in html
    assert 'aria-label="Run"' not in html


@pytest.mark.parametrize(("page", "n", "said"), [(0, PAGE, ""), (1, 2 * PAGE + 1, f"{PAGE + 1} to {2 * PAGE} of")])
def test_pages_lead_on_while_there_are_more(page: int, n: int, said: str) -> None:
    html = pages(page, n)
    assert said in html
    assert ("TurnPage" in html) == bool(said)


@pytest.mark.usefixtures("processes")
def test_a_click_opens_the_frame_at_its_worst_iteration(tmp_path: Path) -> None:
    batch = gallery(tmp_path, row(1, add_s_mm=1.0, worst=1), row(2, add_s_mm=90.0, worst=3))
    app = App(SESSION, port=0, make_tools=FakeTools, folder=tmp_path, batch=batch).start()
    try:
        app.wait_until_ready(60)
        until(app, lambda: cursor(app) == 3)
        assert app.debugger.workspace.frame == "0/2"
        assert "0/1 " not in content(app)  # Only what is wrong is shown at first.
        app.send(c.FilterBatch("result", "all"))
        app.wait_until_idle()
        assert content(app).index("0/2 ") < content(app).index("0/1 ")
        app.send(batch.opens(batch.entries[0]))
        until(app, lambda: cursor(app) == 1)
        assert app.debugger.workspace.frame == "0/1"
        assert app.debugger.options.focus == 0
        app.send(c.SortBatch("frame"))
        app.wait_until_idle()
        assert content(app).index("0/1 ") < content(app).index("0/2 ")
        assert content(app).count("card marked") == 1
        app.send(c.FilterBatch("result", WRONG))
        app.wait_until_idle()
        assert "0/2" in content(app)
        assert "0/1 " not in content(app)
    finally:
        app.stop()
