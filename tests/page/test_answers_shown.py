"""Pictures of answers, and the gallery of a folder in which frames arrive."""

from __future__ import annotations

import io
import json
import threading
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from websockets.sync.client import connect

from tests.changing import replace
from tests.fakes import box_problem
from tests.made_runs import answer
from tests.page.conftest import SESSION
from tests.run.kept_frames import box_mesh, found, kept
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.batch.watch import Watch
from verefine_viz.core.errors import InputError
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.settings import Session
from verefine_viz.page import protocol as p
from verefine_viz.page.app import App
from verefine_viz.page.gallery import Gallery, GalleryEntry
from verefine_viz.page.thumbnails import WIDTH_PX, Painter, Thumbnails
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.demo import demo_problem


def row(instance_id: int | None, im_id: int = 0) -> Answer:
    return answer(0, im_id, instance_id=instance_id, obj_id=1, add_s_mm=50.0, diameter_mm=100.0)


ENTRIES = tuple(GalleryEntry("run", row(k)) for k in range(5))


def test_what_was_asked_for_last_is_drawn_first_and_once():
    permits, begun, seen = threading.Semaphore(0), threading.Semaphore(0), []

    def draw(entry: GalleryEntry) -> bytes:
        seen.append(entry.row.instance_id)
        begun.release()
        assert permits.acquire(timeout=20)
        if entry is ENTRIES[3]:
            raise InputError("its image is gone")
        return b"picture"

    thumbnails = Thumbnails(draw)
    first = thumbnails.ask(ENTRIES[0])
    assert begun.acquire(timeout=20)
    pictures: list[Future[bytes]] = [first, *(thumbnails.ask(ENTRIES[k]) for k in (1, 2, 3, 1))]
    permits.release(4)
    assert [picture.result(20) for picture in pictures] == [b"picture", b"picture", b"picture", b"", b"picture"]
    assert seen == [0, 3, 2, 1]
    thumbnails.stop()


@pytest.mark.usefixtures("processes")
def test_the_painter_draws_answer_and_ground_truth(tmp_path: Path):
    session = Session()
    target = demo_problem("mug", session.scene, session.hypotheses).targets[0]
    truth = target.instance.T_cam_obj_gt
    assert truth is not None
    moved = np.array(truth)
    moved[0, 3] += 0.04
    there = replace(row(target.instance.instance_id), obj_id=target.model.obj_id, T_cam_obj=moved)
    rows = (there, row(77), row(None), row(0, im_id=99))
    gallery = Gallery([BatchIndex(tmp_path, session, BatchInfo(), rows)])
    painter = Painter(lambda: gallery)
    image = np.asarray(Image.open(io.BytesIO(painter(gallery.entries[0]))).convert("RGB")).astype(int)
    assert image.shape == (WIDTH_PX * 3 // 4, WIDTH_PX, 3)
    for name in ("accepted", "ground truth"):
        assert (abs(image - np.array(STAGE_COLORS[name])).sum(axis=2) < 120).sum() > 50, name
    assert painter(gallery.entries[2]) == b""
    for missing in gallery.entries[1], gallery.entries[3]:
        with pytest.raises(InputError):
            painter(missing)


@pytest.mark.usefixtures("processes")
def test_frames_that_arrive_come_into_the_gallery_and_can_be_opened(tmp_path: Path):
    problem, mesh, frames = box_problem(n_hypotheses=2), box_mesh(tmp_path / "box.stl"), tmp_path / "frames"
    quick = resolve({"method": {"name": "refine", "iterations": 2}, "physics": {"enabled": False}})
    kept(frames, problem, [found(problem, mesh)])
    app = App(SESSION, port=0, folder=tmp_path, watch=Watch(frames, tmp_path / "runs", quick)).start()
    try:
        app.wait_until_ready(120)
        assert app.debugger.space.frame == "1/1"
        with connect(f"ws://127.0.0.1:{app.server.port}/ws", max_size=None) as window:

            def until(tones: list[str]) -> dict:
                while True:
                    message = json.loads(window.recv(240))
                    if message["t"] == "answers" and [row["tone"] for row in message["rows"]] == tones:
                        return message

            until(["unknown"])
            kept(frames, problem, [found(problem, mesh)])
            assert until(["unknown", "waiting"])["frames"] == ["1/1", "1/2"]
            until(["unknown", "unknown"])
        app.send(p.Open(answer=1))
        app.wait_until_idle()
        assert app.debugger.space.frame == "1/2"
        assert app.debugger.space.work.first.recording is not None
        assert app.debugger.space.work.first.is_over
    finally:
        app.stop()
