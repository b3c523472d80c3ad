"""What the page makes of a run: ``web/moment.js`` with rows that no server sent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import verefine_viz.page

pytestmark = pytest.mark.browser
WEB = Path(verefine_viz.page.__file__).parent / "web"
SETUP = """async () => {
    const { state, receive, setView } = await import("/web/store.js");
    await import("/web/messages.js");
    const moment = await import("/web/moment.js");
    const T = (x) => [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1];
    const stage = (name, x, score) => ({ name, T: T(x), score, err: x, ms: 1, text: name });
    const arm = (x, score) => ({ T: T(x), score, err: x, plays: 1, mean: score, source: "a" });
    const row = (k) => ({
      k, obj: 7, arm: 0, n: k, own: k, pass: null, accepted: "refined", events: [], placed: [], tree: null,
      stages: [stage("current", 50 - k, 0.1), stage("simulated", 49.5 - k, 0.2), stage("refined", 49 - k, 0.3)],
      best: { score: 0.1 * k + 0.1, err: 49 - k, arm: 0, k, stage: "refined", T: T(49 - k) },
      arms: [arm(49 - k, 0.1 * k + 0.1), arm(60, 0.05)], brief: "", text: "",
    });
    const arms = [arm(50, 0.1), arm(60, 0.05)];
    const object = { id: 7, obj_id: 7, label: "mug", diameter_mm: 100, has_gt: true, gt: T(0), arms };
    receive({ t: "hello", window: 1 });
    const choices = { methods: [{ name: "rir", verifies: true }] };
    receive({ t: "frame", id: 1, title: "", frame: "0/0", method: "rir", choices, objects: [object] });
    receive({ t: "branches", list: [{ index: 0, name: "first run", edits: [], settings: {} }], compare: null });
    const came = (from, rows, over = false) =>
      receive({ t: "run", branch: 0, from, total: 5, over, rows, marks: [] });
    came(0, []);
    window.at = () => {
      const m = moment.momentOf(state);
      return { k: m.k, stage: m.stage, answer: m.isAnswer, a: m.a.name, b: m.b?.name ?? null, same: m.same };
    };
    Object.assign(window, { came, row, receive, setView, ...moment });
}"""


@pytest.fixture
def page(chromium: Any) -> Iterator[Any]:
    """An empty page with the modules of the front end, and a frame with one object."""
    page = chromium.new_page()

    def serve(route: Any) -> None:
        path = WEB / route.request.url.split("/web/")[-1]
        if path.is_file():
            route.fulfill(path=path, content_type="text/javascript")
        else:
            route.fulfill(body="<!doctype html>", content_type="text/html")

    page.route("**/*", serve)
    page.goto("http://page.test/")
    page.evaluate(SETUP)
    yield page
    page.close()


def test_the_cursor_follows_rows_only_from_the_end(page: Any) -> None:
    assert page.evaluate("came(0, [row(1), row(2)]) ?? at().k") == 2
    assert page.evaluate("seek(1) ?? came(2, [row(3)]) ?? at().k") == 1
    assert page.evaluate("seek(3) ?? came(3, [row(4)]) ?? at().k") == 4


def test_a_link_waits_for_its_iteration_and_stays_there(page: Any) -> None:
    page.evaluate("came(0, [row(1)])")
    page.evaluate("receive({ t: 'view', patch: { branch: 0, k: 3 }, at: 3 })")
    assert page.evaluate("at().k") == 1
    assert page.evaluate("came(1, [row(2), row(3), row(4)]) ?? at().k") == 3
    assert page.evaluate("came(4, [row(5)], true) ?? at().k") == 3


def test_stages_are_revealed_one_by_one(page: Any) -> None:
    page.evaluate("came(0, [row(1), row(2)]) ?? seek(1)")
    seen = [page.evaluate("stepStage() ?? [at().k, at().stage, at().b]") for _ in range(3)]
    assert [one[:2] for one in seen] == [[2, "current"], [2, "simulated"], [2, None]]
    assert seen[1][2] == "simulated"


@pytest.mark.parametrize(
    ("verdict", "pair"),
    [
        ({"tone": "wrong", "err": 44.0}, ["best", "ground truth"]),
        ({"tone": "right", "err": 1.0}, ["initial", "best"]),
    ],
)
def test_a_finished_run_is_compared_with_what_tells_most(page: Any, verdict: dict[str, Any], pair: list[str]) -> None:
    page.evaluate("came(0, [1, 2, 3, 4, 5].map(row), true)")
    said = {"obj": 7, "score": 0.6, "limit": 10.0, "findings": [], "words": "", **verdict}
    page.evaluate("(said) => receive({ t: 'verdict', branch: 0, objects: [said] })", said)
    assert page.evaluate("[at().answer, at().a, at().b]") == [True, *pair]


def test_the_same_pose_is_not_compared_with_itself(page: Any) -> None:
    assert page.evaluate("[at().a, at().b, at().same]") == ["best", "ground truth", False]
    page.evaluate("setView({ a: 'initial', b: 'best' })")
    assert page.evaluate("at().same")  # But what the user chose is what is shown.
