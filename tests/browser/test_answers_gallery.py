"""A batch's answers: opened from a card at the iteration that went wrong, tagged, and back; files and the verb log."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS
from verefine_viz.batch.answer_tags import read_tags
from verefine_viz.cli import main
from verefine_viz.page.app import App
from verefine_viz.page.gallery import read_gallery
from verefine_viz.page.protocol import read_verb


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("batch") / "run"
    words = ["batch", str(SESSIONS / "failure_icp_slides.toml"), "--out", str(folder), "--workers", "1"]
    assert main([*words, "--recording.keep", "none"]) in (0, 1)
    return folder


def test_failure_is_opened_at_its_iteration_tagged_and_left_again(pages, batch):
    gallery = read_gallery(batch)
    entry = gallery.worst
    app = App(gallery.session(entry.run), port=0, folder=batch.parent, gallery=gallery).start()
    try:
        app.wait_until_ready(120)
        screen = pages.show(app)
        screen.until("state.answers !== null && state.view.preset === 'gallery'")
        rows = screen.state("state.answers.rows.map(r => [r.frame, r.err, r.k])")
        assert rows == [[e.row.frame, e.row.add_s_mm, e.iteration] for e in gallery.entries]
        card = screen.page.locator(".card").first
        card.wait_for(timeout=60_000)
        screen.shot("gallery")
        card.click()
        screen.until("state.view.preset !== 'gallery' && state.view.k === arg", entry.iteration)
        total = len(app.debugger.space.work.first.run.iterations)
        assert screen.state("state.runs.get(state.view.branch).rows.length") == total
        screen.until("state.verdicts.has(state.view.branch) && document.querySelector('.verdict .words.wrong')")
        why = screen.state("state.verdicts.get(state.view.branch).objects[0].findings.map(f => [f.cause, f.k])")
        assert [entry.row.cause, entry.row.worst_iteration] in why
        screen.shot("failure_from_gallery")
        screen.key("g")
        screen.until("state.view.preset === 'gallery'")
        screen.state("(await import('/web/store.js')).send({ verb: 'tag', answers: [0], tag: 'seen', on: true })")
        screen.until("state.answers.rows[0].tags.includes('seen')")
        assert [list(tags) for tags in read_tags(batch).tags.values()] == [["seen"]]
        assert screen.errors == []
    finally:
        app.stop()


def test_session_and_verbs_are_saved_and_can_be_downloaded(show):
    screen = show()
    screen.key("ArrowRight")
    screen.until("state.view.k === 1")
    screen.state("(await import('/web/store.js')).send({ verb: 'save', what: 'verbs' })")
    screen.until("state.written.length === 1 && state.written[0].url")
    url = screen.state("state.written[0].url")
    lines = screen.page.request.get(f"{screen.app.url}{url}").text().splitlines()
    assert [json.loads(line)["verb"] for line in lines][-1] == "step"
    assert [read_verb(line) for line in lines] == list(screen.app.debugger.log)
