"""Pictures of answers: made for what is looked at, once, and never in the way."""

from __future__ import annotations

import io
import threading
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.changing import replace
from tests.made_runs import answer
from tests.viewer.conftest import SESSION
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.core.errors import InputError
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.run.record import Answer
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.viewer.drawing.thumbnails import WIDTH_PX, Painter, Thumbnails
from verefine_viz.viewer.state.batch_gallery import Entry, Gallery


def row(instance_id: int | None, im_id: int = 0) -> Answer:
    return answer(0, im_id, instance_id=instance_id, obj_id=1, add_s_mm=50.0, diameter_mm=100.0)


ENTRIES = tuple(Entry("run", row(k)) for k in range(5))


class Drawn:
    """Thumbnails whose drawing waits for a permit each, and what was drawn."""

    def __init__(self) -> None:
        self.permits = threading.Semaphore(0)
        self.begun = threading.Semaphore(0)
        self.seen: list[int | None] = []
        self.thumbnails = Thumbnails(self._draw)

    def _draw(self, entry: Entry) -> bytes:
        self.seen.append(entry.row.instance_id)
        self.begun.release()
        assert self.permits.acquire(timeout=20)
        if entry is ENTRIES[3]:
            raise InputError("its image is gone")
        return b"picture %d" % (entry.row.instance_id or 0)

    def ask(self, *numbers: int) -> list[Future[bytes]]:
        return [self.thumbnails.ask(ENTRIES[k]) for k in numbers]


def test_what_was_asked_for_last_is_made_first_and_each_only_once() -> None:
    drawn = Drawn()
    drawn.ask(0)
    assert drawn.begun.acquire(timeout=20)
    first = drawn.ask(1, 2, 4, 1)
    drawn.permits.release(4)
    assert [picture.result(20) for picture in first] == [b"picture 1", b"picture 2", b"picture 4", b"picture 1"]
    assert drawn.seen == [0, 4, 2, 1]
    drawn.thumbnails.stop()


def test_pictures_wait_while_they_are_on_hold() -> None:
    drawn = Drawn()
    drawn.permits.release(2)
    drawn.thumbnails.hold(True)
    (picture,) = drawn.ask(1)
    with pytest.raises(TimeoutError):
        picture.result(0.3)
    drawn.thumbnails.hold(False)
    assert picture.result(20) == b"picture 1"
    drawn.thumbnails.stop()


def test_a_picture_that_cannot_be_made_is_empty_and_the_next_one_follows() -> None:
    drawn = Drawn()
    drawn.permits.release(2)
    assert [picture.result(20) for picture in drawn.ask(3, 1)] == [b"", b"picture 1"]
    drawn.thumbnails.stop()


def near(image: np.ndarray, name: str) -> int:
    return int((abs(image - np.array(STAGE_COLORS[name])).sum(axis=2) < 120).sum())


@pytest.mark.usefixtures("processes")
def test_the_painter_draws_answer_and_ground_truth(tmp_path: Path) -> None:
    target = demo_problem("mug", SESSION.scene, SESSION.hypotheses).targets[0]
    truth = target.instance.T_cam_obj_gt
    assert truth is not None
    moved = np.array(truth)
    moved[0, 3] += 0.04
    found = replace(row(target.instance.instance_id), obj_id=target.model.obj_id, T_cam_obj=moved)
    gallery = Gallery([BatchIndex(tmp_path, SESSION, BatchInfo(), (found, row(77), row(None), row(0, im_id=99)))])
    painter = Painter(gallery)
    image = np.asarray(Image.open(io.BytesIO(painter(gallery.entries[0]))).convert("RGB")).astype(int)
    assert image.shape == (WIDTH_PX * 3 // 4, WIDTH_PX, 3)
    assert near(image, "accepted") > 50
    assert near(image, "ground truth") > 50
    assert painter(gallery.entries[2]) == b""
    for missing in gallery.entries[1], gallery.entries[3]:
        with pytest.raises(InputError):
            painter(missing)
