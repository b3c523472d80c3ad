"""A folder whose depth is in another unit, without ground truth: badge, picture, one button, and a run that fits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tests.browser.conftest import Pages, Screen
from tests.calibration.sizes import scene
from tests.calibration.spoiled import with_depth
from tests.scenes.without_truth import written_without_truth
from verefine_viz.page.app import App

CLUTTER = scene("clutter", "0/0")


@pytest.fixture(scope="module")
def app(chromium: object, tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    folder = tmp_path_factory.mktemp("wrong")
    session = written_without_truth(folder / "data", with_depth(CLUTTER, 10.0), depth_scale_mm=1.0)
    app = App(session, None, port=0, folder=folder).start()
    app.wait_until_ready(180)
    yield app
    app.stop()


def middle_of(screen: Screen, role: str, obj: int) -> list[float]:
    """The middle and the width [px] of what the picture of a doubt outlines of an object."""
    shapes = screen.state(
        '(await import("/web/store.js")).want({ what: "doubt", index: 0, branch: state.view.branch }).shapes'
    )
    points = [p for s in shapes if s["role"] == role and s["obj"] == obj for p in s["polygons"]]
    uv = np.concatenate([np.reshape(p, (-1, 2)) for p in points])
    return [*uv.mean(axis=0).tolist(), float(np.ptp(uv[:, 0]))]


def test_depth_in_another_unit_is_put_right_by_one_button(app: App, pages: Pages) -> None:
    screen = pages.show(app)
    screen.finish()
    app.wait_until_idle(120)
    scores = [o["score"] for o in screen.state("state.verdicts.get(state.view.branch)")["objects"]]
    badge = screen.page.locator(".verdict .doubt-badge")
    assert badge.count() == 1
    assert badge.inner_text() == "depth ×0.1"
    badge.click()
    screen.until("state.view.doubt === 0")
    card = screen.page.locator(".doubt-card")
    card.get_by_text("put right", exact=True).wait_for()
    obj = screen.state("moment.obj")
    mask, given, fits = (middle_of(screen, role, obj) for role in ("mask", "given", "fits"))
    assert given[2] < 0.2 * mask[2], "ten times as far away it is a tenth as wide"
    assert np.abs(np.subtract(fits, mask)).max() < 25
    screen.shot("data_doubt")
    card.get_by_role("button", name="Put right and run").click()
    screen.until(
        "state.frame.as_read['data.depth_times'] === 1 && moment.isAnswer && state.verdicts.has(state.view.branch)"
    )
    app.wait_until_idle(120)
    assert screen.state("state.view.doubt") is None
    assert [screen.page.locator(".verdict .doubt-badge:not(.mended)").count(), card.count()] == [0, 0]
    verdict = screen.state("state.verdicts.get(state.view.branch)")
    after = [o["score"] for o in verdict["objects"]]
    assert verdict["doubts"] == []
    assert min(after) > 0.6 > max(scores)
    problem = app.debugger.space.problem
    for best, instance in zip(app.debugger.space.work.first.run.final_state.best, problem.instances, strict=True):
        true = next(i for i in CLUTTER.instances if i.obj_id == instance.obj_id)
        assert np.linalg.norm(best.T_cam_obj[:3, 3] - np.array(true.T_cam_obj_gt)[:3, 3]) < 0.02
    screen.page.locator(".verdict .doubt-badge.mended").click()
    screen.until("Object.keys(state.frame.as_read).length === 0 && state.frame.doubts.length === 1")
    assert not screen.errors
