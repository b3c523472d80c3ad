"""Every surface over two small batches: one without ground truth, one with that of some objects only.

No pane fails, nothing is reported to the console, and no cell shows what is not there.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.batch.frames import batch_here
from tests.browser.conftest import Pages, Screen
from tests.fakes import box_problem
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.watch import Watch
from verefine_viz.cli import main
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Problem
from verefine_viz.page.app import App
from verefine_viz.page.gallery import read_gallery
from verefine_viz.page.notebook import show
from verefine_viz.page.protocol import Compare
from verefine_viz.recording.entities import curves
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.run.session_file import load_session
from verefine_viz.trace import Trace

NAMES = ("box", "crate", "lost")
"""The last one is in the frames of which something is known, without an initial pose, and so without an answer."""
QUICK = ("--method.refiner", "icp", "--method.iterations", "2", "--physics.steps", "20", "--scene.sequence", "True")
SEEN = """() => [document.body.innerText, ...[...document.querySelectorAll("*")].flatMap((e) =>
    [e.title, e.tagName === "OPTION" || e instanceof SVGElement ? e.textContent : "", e.getAttribute("aria-label")])]
    .filter(Boolean).join("\\n")"""
"""Everything that can be read: words, numbers, choices, titles."""
NOT_THERE = re.compile(r"cannot be drawn|\b(NaN|nan|undefined|null|None(?! is)|Infinity)\b")
SETTLED = (
    "!/Scoring|Looking for|Comparing the frames|Reading what/.test(document.querySelector('.tab-content').innerText)"
)
"""Whether a tab has all that it asked for."""


@dataclass(frozen=True)
class Data:
    """Frames, a batch over them, and how many of their objects have ground truth."""

    name: str
    frames: Path
    batch: Path
    truths: int
    words: tuple[str, ...]
    """Of a command that solves them."""

    @property
    def sweep(self) -> Path:
        """Batches by several methods, with two seeds."""
        return self.batch.with_name("sweep")


def write_trace(folder: Path, problem: Problem, mesh: Path, is_wrong: bool) -> None:
    """A recorded frame with ground truth of its first object only, whose answer is right unless ``is_wrong``."""
    seen = problem.observation
    with Trace(folder, K=seen.camera.K, depth_m=seen.depth_m, rgb=seen.rgb) as trace:
        for k, (name, instance) in enumerate(zip(NAMES, problem.instances, strict=True)):
            T_true = instance.T_cam_obj_gt
            one = trace.object(name, mesh, mask=instance.mask, truth=T_true if k == 0 else None)
            if name == "lost":
                continue
            for h, start in enumerate(instance.hypotheses):
                one.hypothesis(h, start.T_cam_obj, score=start.confidence)
            one.step(1, instance.hypotheses[0].T_cam_obj, score=0.7, name="coarse")
            one.answer(transform(T_true[:3, :3], T_true[:3, 3] + [0.03 * is_wrong, 0, 0]), score=0.9)


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory, chromium) -> Data:
    folder = tmp_path_factory.mktemp("without")
    mesh = box_mesh(folder / "box.stl")
    for seed in range(2):
        problem = box_problem(n_instances=2, seed=seed)
        objects = [{**found(problem, mesh, k), "name": name} for k, name in enumerate(NAMES[:2])]
        kept(folder / "frames", problem, objects)
    return solved(Data("without", folder / "frames", folder / "runs" / "rir", 0, QUICK))


@pytest.fixture(scope="module")
def partly(tmp_path_factory: pytest.TempPathFactory, chromium) -> Data:
    folder = tmp_path_factory.mktemp("partly")
    mesh = box_mesh(folder / "box.stl")
    for seed in range(2):
        write_trace(folder / "frames" / f"t{seed}", box_problem(n_instances=3, seed=seed), mesh, is_wrong=seed == 1)
    return solved(Data("partly", folder / "frames", folder / "runs" / "trace", 2, ("--scene.sequence", "True")))


def solved(data: Data) -> Data:
    done = batch_here(data.frames, data.batch, "--workers", "1", "--recording.keep", "all", *data.words)
    assert done.returncode in (0, 1), done.stderr
    words = ("--recording.keep", "none", *QUICK, "--methods", "pir", "sir", "refine", "--seeds", "2")
    done = batch_here(data.frames, data.sweep, "--workers", "1", *words)
    assert done.returncode in (0, 1), done.stderr
    return data


@pytest.fixture(params=["without", "partly"])
def data(request: pytest.FixtureRequest) -> Data:
    return request.getfixturevalue(request.param)


def look(screen: Screen, where: object) -> str:
    """Check what can be read on the screen; return it."""
    screen.page.wait_for_timeout(60)
    text = screen.page.evaluate(SEEN)
    fault = NOT_THERE.search(text)
    assert fault is None, f"{where}: …{text[max(0, fault.start() - 80) : fault.end() + 80]}…"
    assert screen.errors == [], where
    return text


def walk_answer(screen: Screen, where: str) -> None:
    """Look at the end of the run that is open, in every tab of every object, then, in the program, at its start."""
    screen.until("moment !== null && state.view.preset === 'inspect'")
    folder = "/web/" if screen.state("state.file === null") else "web/"
    tabs = screen.state(f"(await import('{folder}tabs/all.js')).tabs.map(t => t.title.toLowerCase())")
    n, objects = screen.state("moment.run.rows.length"), screen.state("state.frame.objects.map(o => o.id)")
    started = [(1, objects[0])] if screen.state("state.file === null") else []
    for k, obj in [*((n, obj) for obj in objects), *started]:
        screen.view(k=k, stage=None, obj=obj)
        for tab in tabs:
            screen.tab(tab)
            screen.until(SETTLED)
            look(screen, (where, "iteration", k, "object", obj, tab))
    screen.view(k=n, tab="score", together=True)
    text = look(screen, (where, "all objects"))
    assert ("ground truth where known" in text) == screen.state("state.frame.objects.some((o) => o.has_gt)"), where
    for title in ("Hypotheses: what colours say, scores, filter", "Evidence and what to do about it"):
        menu = screen.page.get_by_title(title, exact=True).first
        menu.click()
        look(screen, (where, title))
        menu.click()


def walk_gallery(screen: Screen, data: Data, where: str) -> None:
    """Look at the cards in every order, and at the plot under the pointer; open one."""
    screen.until("state.answers !== null && document.querySelectorAll('.card').length > 0")
    outcome = screen.page.locator(".gallery-bar h2").inner_text()
    assert ("; 2 without ground truth" in outcome, " right" in outcome) == (bool(data.truths),) * 2
    if screen.state("Object.keys(state.gallery.only).length"):
        screen.click("All")
    orders = screen.state("state.answers.orders.map(o => o.id)")
    assert ("misleading" in orders) == bool(data.truths)
    for order in orders:
        screen.state("(await import('/web/answers.js')).choose({ order: arg })", order)
        look(screen, (where, order))
    plot = screen.page.locator(".facets .plot")
    title = "Score over error" if data.truths else "Score over uncertainty"
    assert plot.locator("h3").inner_text() == title
    assert f"{data.truths or 4} with" in plot.locator("p").inner_text()
    point = plot.locator("canvas").bounding_box()
    for share in (0.2, 0.4, 0.6, 0.8):
        screen.page.mouse.move(point["x"] + share * point["width"], point["y"] + 0.4 * point["height"])
        look(screen, (where, "plot", share))
    screen.page.locator(".card").first.click()


def test_the_page_of_a_batch_is_walked(pages: Pages, data: Data) -> None:
    gallery = read_gallery(data.batch)
    app = App(gallery.session(gallery.worst.run), port=0, folder=data.batch.parent, gallery=gallery).start()
    try:
        app.wait_until_ready(120)
        screen = pages.show(app)
        walk_gallery(screen, data, "gallery")
        walk_answer(screen, "answer")
        for preset in ("maps", "compare", "inspect"):
            screen.view(preset=preset)
            look(screen, preset)
        app.send(Compare(a=min(app.debugger.space.branches), changes={"method.name": "pir"}))
        screen.until("state.compare && state.runs.get(state.compare.b)?.over && state.verdicts.has(state.compare.b)")
        screen.tab("compare")
        screen.until("document.querySelector('.tab.compare .facts')")
        words = look(screen, "A/B")
        assert ("which is nearer to ground truth" in words) == bool(data.truths)
    finally:
        app.stop()


def test_a_shared_run_and_a_notebook_are_walked(pages: Pages, data: Data, tmp_path: Path) -> None:
    assert main(["share", str(data.batch), "--out", str(tmp_path / "s.html")]) == 0
    screen = pages.open_file(tmp_path / "s.html")
    screen.until("moment.isAnswer && document.querySelector('.maps canvas')")
    walk_answer(screen, "share")
    screen.until("!document.querySelector('.maps .waiting')")
    assert not re.search("does not hold|holds the maps", look(screen, "share, all objects"))
    page = show(data.frames)
    try:
        look(pages.show(page._app), "notebook")
    finally:
        page.close()


def test_reports_are_walked(pages: Pages, data: Data, tmp_path: Path) -> None:
    two = [data.sweep / "pir-0", data.sweep / "sir-0"]
    made = {"one": [data.batch, "--embed", "2"], "two": two, "sweep": [data.sweep]}
    for name, words in made.items():
        assert main(["report", *map(str, words), "--out", str(tmp_path / f"{name}.html")]) == 0
        screen = pages.open_file(tmp_path / f"{name}.html")
        screen.until("state.report && document.querySelectorAll('.card').length > 0")
        text = look(screen, ("report", name))
        assert ("No ground truth: errors" in text) == (data.truths == 0), name
        assert ("both wrong" in text) <= bool(data.truths), name
        assert ("How far the answers are apart" in text) == (name == "two" and data.truths == 0), name
        if name == "one":
            screen.page.locator(".report .next .link").click()
            screen.until("moment?.isAnswer !== undefined && state.view.preset === 'inspect'")
            look(screen, "a frame of the report")


def test_a_watched_folder_is_walked(pages: Pages, data: Data, tmp_path: Path) -> None:
    watch = Watch(data.frames, tmp_path / "runs", None)
    app = App(load_session(None, {}), port=0, folder=tmp_path, watch=watch).start()
    try:
        app.wait_until_ready(120)
        screen = pages.show(app)
        screen.until("state.answers?.rows.length >= 4 && state.answers.rows.every((r) => r.tone !== 'waiting')")
        screen.view(preset="gallery")
        walk_gallery(screen, data, "watch")
    finally:
        app.stop()


def test_tables_and_recordings_hold_no_number_that_is_none(data: Data, capsys: pytest.CaptureFixture[str]) -> None:
    tables = [path for path in sorted(data.batch.rglob("*.csv"))]
    assert {path.name for path in tables} >= {"frames.csv", "results.csv"}
    for path in tables:
        for row in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))):
            assert not NOT_THERE.search(" ".join(map(str, row.values()))), (path.name, row)
    json.loads((data.batch / "run.json").read_text(), parse_constant=lambda name: pytest.fail(f"run.json: {name}"))
    recordings = sorted((data.batch / "recordings").glob("*.rrd"))
    assert len(recordings) == 2
    for path in recordings:
        drawn = [chunk for chunk in chunks_of(path) if not chunk.is_static]
        errors = {c.entity_path for c in drawn if c.entity_path.startswith((curves("error", ""), curves("add_s", "")))}
        known = {path.split("/")[3] for path in errors}
        assert len(known) == data.truths // 2, path.name  # Objects whose ground truth is known.
        assert not any(NOT_THERE.search(str(words)) for chunk in drawn for words in texts(chunk)), path.name
    assert main(["replay", str(recordings[0]), "--verify"]) == 0
    assert not NOT_THERE.search(capsys.readouterr().out)


def texts(chunk: Any) -> Iterator[object]:
    """What a part of a recording says in words."""
    batch = chunk.to_record_batch()
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if "text" in name.lower():
            yield from column.to_pylist()
