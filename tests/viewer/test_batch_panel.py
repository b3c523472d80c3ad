"""A batch's frames on the page: worst first, one click to where it went wrong."""

from __future__ import annotations

from pathlib import Path

from tests.viewer.test_app import SESSION, cursor, until
from tests.viewer.tools import FakeTools
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.rows import ObjectRow
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.panels.batch import WRONG, batch_table, filtered, summary


def row(im_id: int, status: str = "ok", add_s_mm: float | None = None, worst: int | None = None) -> ObjectRow:
    return ObjectRow(
        scene_id=0, im_id=im_id, instance_id=0, obj_id=1, name="<b>box</b>", status=status, score=0.5,  # type: ignore[arg-type]
        add_s_mm=add_s_mm, diameter_mm=100.0, worst_iteration=worst, events="score_fell", message="no depth <i>",
    )  # fmt: skip


def index(tmp_path: Path, *rows: ObjectRow) -> BatchIndex:
    return BatchIndex(tmp_path, SESSION, {}, rows)


def test_rows_are_links_to_the_worst_iteration_and_names_are_text() -> None:
    html = batch_table((row(2, add_s_mm=42.0, worst=3), row(1, "failed")), "0/1")
    assert "&lt;b&gt;box" in html
    assert "<b>box" not in html
    assert "&lt;i&gt;" in html
    assert '{"command": "OpenAt", "frame": "0/2", "iteration": 3}' in html.replace("&quot;", '"')


def test_the_summary_counts_what_is_correct_and_what_has_no_answer() -> None:
    rows = (row(1, add_s_mm=5.0), row(1, add_s_mm=50.0), row(2, "failed"))
    assert summary(rows).startswith(
        "3 objects in 2 frames; 1 of 2 are within 10 % of their diameter; 1 have no answer."
    )


def test_filters_leave_what_passes_all_of_them() -> None:
    rows = (row(1, add_s_mm=5.0), row(2, add_s_mm=50.0), row(3, "no_answer"))
    rows = (rows[0], rows[1].model_copy(update={"cause": "pool", "evidence": "41° <off>"}), rows[2])
    assert [r.im_id for r in filtered(rows, {})] == [1, 2, 3]
    assert [r.im_id for r in filtered(rows, {"result": WRONG})] == [2, 3]
    assert [r.im_id for r in filtered(rows, {"result": "right", "cause": "all"})] == [1]
    assert [r.im_id for r in filtered(rows, {"cause": "no good hypothesis in the pool"})] == [2]
    assert filtered(rows, {"result": "right", "cause": "no good hypothesis in the pool"}) == ()
    assert filtered(rows, {"object": "mug"}) == ()
    html = batch_table(rows, "")
    assert "no good hypothesis in the pool" in html
    assert "41° &lt;off&gt;" in html


def test_a_click_opens_the_frame_at_its_worst_iteration(tmp_path: Path) -> None:
    batch = index(tmp_path, row(1, add_s_mm=1.0, worst=1), row(2, add_s_mm=90.0, worst=3))
    app = App(SESSION, port=0, make_tools=FakeTools, folder=tmp_path, batch=batch).start()
    try:
        app.wait_until_idle()
        assert app.layout.batch is not None
        html = app.layout.batch._rows._handle.content
        assert html.index("0/2") < html.index("0/1")
        app.send(c.OpenAt("0/2", 3))
        until(app, lambda: cursor(app) == 3)
        assert app.debugger.workspace.frame == "0/2"
        app.send(c.OpenAt("0/2", 1))
        until(app, lambda: cursor(app) == 1)
        app.send(c.SortBatch("frame"))
        app.wait_until_idle()
        html = app.layout.batch._rows._handle.content
        assert html.index("0/1") < html.index("0/2")
        app.send(c.FilterBatch("result", WRONG))
        app.wait_until_idle()
        html = app.layout.batch._rows._handle.content
        assert "0/2" in html
        assert "0/1<" not in html
    finally:
        app.stop()
