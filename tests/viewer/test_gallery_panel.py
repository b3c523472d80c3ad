"""The gallery of a batch on the page: what its tiles say, where they lead, and what the page knows of them."""

from __future__ import annotations

import html
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.changing import replace
from tests.made_runs import answer
from tests.viewer.client import until
from tests.viewer.conftest import SESSION
from tests.viewer.fake_tools import FakeTools
from tests.viewer.test_app import cursor
from verefine_viz.batch.answer_cards import WRONG
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.run.record import Answer
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.panels.gallery_panel import entry_of, gallery_html, tip
from verefine_viz.viewer.state.batch_gallery import Gallery


def row(im_id: int, status: str = "ok", add_s_mm: float | None = None, worst: int | None = None) -> Answer:
    return answer(scene_id=0, im_id=im_id, instance_id=0, obj_id=1, name="<b>box</b>", status=status, score=0.5,
        add_s_mm=add_s_mm, diameter_mm=100.0, worst_iteration=worst, events="score_fell", message="no depth <i>",
    )  # fmt: skip


def gallery(tmp_path: Path, *rows: Answer) -> Gallery:
    return Gallery([BatchIndex(tmp_path, SESSION, BatchInfo(), rows)])


def test_tiles_lead_to_the_worst_iteration_and_names_are_text(tmp_path: Path) -> None:
    found = gallery(tmp_path, row(2, add_s_mm=42.0, worst=3), row(1, "failed"))
    wrong, failed = (entry_of(found, entry, k) for k, entry in enumerate(found.entries))
    assert "&lt;b&gt;box" in wrong
    assert "<b>box" not in wrong
    assert '{"command": "OpenAt", "frame": "0/2", "iteration": 3' in html.unescape(wrong)
    assert "42.0 mm" in wrong
    assert "&lt;i&gt;" in failed
    assert "data-open" not in failed


def test_what_a_tile_has_no_room_for_is_in_its_tooltip(tmp_path: Path) -> None:
    name = "a_model_with_a_name_that_no_card_has_room_for"
    wrong = replace(row(2, add_s_mm=42.0), name=name, method="rir", cause="score")
    failed = replace(row(1, "failed"), name=name, method="rir")
    tips = [tip(entry) for entry in gallery(tmp_path, wrong, failed).entries]
    assert all(words.startswith(name) for words in tips)
    assert "42% of the diameter: score ranks a wrong pose above the ground truth" in tips[0]
    assert "no depth <i>" in tips[1]


def test_objects_of_failed_frames_and_those_left_out_count_as_missed(tmp_path: Path) -> None:
    lost = [replace(row(2, status), has_truth=True) for status in ("failed", "left_out")]
    unknown = replace(row(3, "failed"), obj_id=None, instance_id=None, name="")
    found = gallery(tmp_path, row(1, add_s_mm=5.0), *lost, unknown)
    for count in ("1 of 3 objects", "2 have no answer", "1 frame failed"):
        assert count in found.outcome
    assert found.outcome in gallery_html(found)
    for entry, said in zip(found.entries[1:], ("frame failed", "left out", "frame failed"), strict=True):
        tile = entry_of(found, entry, 1)
        assert said in tile
        assert "data-open" not in tile


def test_data_in_doubt_are_reported_on_the_card_and_above_all_cards(tmp_path: Path) -> None:
    evidence = "The score misleads. Look at the data first: objects appear larger: check cam_K."
    doubted = replace(row(1, add_s_mm=42.0), cause="score", evidence=evidence)
    found = gallery(tmp_path, doubted, replace(row(2, add_s_mm=42.0), cause="score"))
    assert "in frame 0/1, objects appear larger: check cam_K" in found.doubt
    told, plain = (entry_of(found, entry, 0) for entry in found.entries)
    assert "data in doubt" in told
    assert "data in doubt" not in plain
    assert gallery(tmp_path, row(2, add_s_mm=42.0)).doubt == ""
    twice = gallery(tmp_path, doubted, replace(doubted, frame="0/3"), row(2, add_s_mm=42.0))
    assert "in 2 of 3 frames, such as 0/1, objects" in twice.doubt
    runs = [
        BatchIndex(tmp_path / name, SESSION, BatchInfo(), found.runs[tmp_path.name].rows) for name in ("rir", "sir")
    ]
    assert "in 2 of 4 frames of 2 runs, such as 0/1 of rir, objects" in Gallery(runs).doubt


def test_a_card_says_where_it_leads(tmp_path: Path) -> None:
    for worst, best, said in ((3, 5, "at iteration 3"), (None, 5, "at iteration 5"), (None, 0, "before iteration 1")):
        found = gallery(tmp_path, replace(row(2, add_s_mm=42.0, worst=worst), best_iteration=best))
        assert said in tip(found.entries[0]), (worst, best)


def test_filters_can_be_chosen_where_there_is_a_choice(tmp_path: Path) -> None:
    rows = row(1, add_s_mm=5.0), replace(row(2, add_s_mm=50.0), name="mug")
    page = gallery_html(gallery(tmp_path, *rows))
    assert 'aria-label="Object"' in page
    assert "<option>mug</option>" in page
    assert f"<option>{WRONG}</option>" in page
    assert 'aria-label="Cause"' not in page
    assert 'aria-label="Run"' not in page


@pytest.mark.usefixtures("processes")
def test_the_page_holds_all_tiles_and_says_what_is_open(tmp_path: Path) -> None:
    batch = gallery(tmp_path, row(1, add_s_mm=1.0, worst=1), row(2, add_s_mm=90.0, worst=3))
    app = App(SESSION, port=0, make_tools=FakeTools, folder=tmp_path, batch=batch).start()
    try:
        app.wait_until_ready(60)
        assert cursor(app) == 0, "nothing is computed before an answer is opened"
        state = app.page.layout.gallery._state
        assert '"only": {"result": "wrong or no answer"}' in html.unescape(state._handle.content)
        app.send(batch.opens(batch.entries[1]))
        until(app, lambda: cursor(app) == 3)
        app.wait_until_idle()
        assert app.debugger.workspace.frame == "0/2"
        assert app.debugger.options.focus == 0
        assert '"open": 1' in html.unescape(state._handle.content)
        app.send(c.TagAnswers((0,), "fine"))
        app.wait_until_idle()
        assert '"tags": {"0": ["fine"]}' in html.unescape(state._handle.content)
        with urllib.request.urlopen(f"{app.url}/picture/1") as answer:
            assert answer.status == 204, "the fake data have no such object"
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{app.url}/picture/2")
        foreign = urllib.request.Request(f"{app.url}/picture/1", headers={"Host": "foreign.invalid"})
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(foreign)
    finally:
        app.stop()
