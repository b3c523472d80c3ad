"""Maps, outlines and shaded models of poses: exactly what the evaluator has, where the model is in the image."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.page.answers_to_wants import MapsAnswer
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.protocol import MapsWanted, OutlinesWanted, Pose, ShadedWanted
from verefine_viz.page.views.pixel_maps import maps
from verefine_viz.page.views.pose_outlines import outlines
from verefine_viz.page.views.shaded_model import shaded
from verefine_viz.page.workspace import Workspace
from verefine_viz.pictures.shaded_models import shaded_picture
from verefine_viz.pictures.silhouettes import outline
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

NAMES = {
    "rendered": "rendered_m", "angle": "angle_rad", "f_d": "f_d", "f_n": "f_n",
    "classes": "classes", "counted": "counted",
}  # fmt: skip
COLOURS = {"correlation": "correlation", "rendered_rgb": "rendered_rgb"}


def opened(demo: str, **settings: dict[str, Any]) -> Workspace:
    raw = {"scene": {"source": "demo", "demo": demo}, "method": {"refiner": "icp"}, "physics": {"enabled": False}}
    raw |= settings
    return Workspace(load_session(None, raw), None, Toolbox)


@pytest.fixture(scope="module")
def mug(processes: None) -> Workspace:
    return opened("mug")


def target_of(space: Workspace) -> Target:
    return space.problem.targets[0]


def numbers(T_cam_obj: Float) -> Pose:
    return tuple(float(x) for x in T_cam_obj.ravel())


def unpacked(answer: MapsAnswer, blobs: Blobs) -> dict[str, np.ndarray]:
    """The arrays as the browser reads them, (h, w) or (h, w, 3)."""
    blob = blobs.get(answer.blob)
    assert blob is not None
    _, _, width, height = answer.region
    arrays = {}
    for one in answer.arrays:
        assert one.offset % 8 == 0
        values = np.frombuffer(blob.data, np.dtype(one.dtype).newbyteorder("<"), one.n, one.offset)
        arrays[one.name] = values.reshape(height, width, -1).squeeze()
    return arrays


def check_equal(answer: MapsAnswer, blobs: Blobs, pixels: ScoreMaps, names: dict[str, str]) -> None:
    u0, v0, width, height = answer.region
    arrays = unpacked(answer, blobs)
    assert set(arrays) == set(names)
    for name, field in names.items():
        ours = getattr(pixels, field)[v0 : v0 + height, u0 : u0 + width]
        assert arrays[name].tobytes() == np.ascontiguousarray(ours).tobytes(), name
    # Nothing that counts lies outside.
    assert np.count_nonzero(arrays["counted"]) == np.count_nonzero(pixels.counted) == answer.score.n


def test_maps_have_the_bits_of_the_evaluator(mug: Workspace) -> None:
    target, evaluator, blobs = target_of(mug), mug.branch(0).evaluator_of(1), Blobs()
    T = target.instance.hypotheses[0].T_cam_obj
    answer = maps(mug, MapsWanted(obj=target.instance.instance_id, T=numbers(T)), blobs)
    check_equal(answer, blobs, evaluator.maps(target, T), NAMES | COLOURS)
    score, errors = evaluator.score(target, T), evaluator.errors(target, T)
    assert answer.score.score == score.score
    assert answer.score.counts["explained"] == score.counts[0]
    assert errors is not None
    assert answer.score.err == errors.add_s_mm
    low, high = answer.scale.depth
    assert low < T[2, 3] < high


def test_colours_are_drawn_whatever_they_weigh_and_the_rest_is_what_was_scored(mug: Workspace) -> None:
    heavy, blobs = opened("mug", score={"colour_weight": 0.3}), Blobs()
    drawn = []
    for space in (mug, heavy):
        target, evaluator = target_of(space), space.branch(0).evaluator_of(1)
        T = target.instance.T_cam_obj_gt
        assert T is not None
        answer = maps(space, MapsWanted(obj=target.instance.instance_id, T=numbers(T)), blobs)
        check_equal(answer, blobs, evaluator.maps(target, T), NAMES | COLOURS)
        scored = evaluator.verifier.maps(target, T)
        assert scored is not None
        u0, v0, width, height = answer.region
        for name, field in NAMES.items():
            there = np.ascontiguousarray(getattr(scored, field)[v0 : v0 + height, u0 : u0 + width])
            assert unpacked(answer, blobs)[name].tobytes() == there.tobytes(), name
        assert answer.score.colour_fit == evaluator.score(target, T).colour_fit
        drawn.append(unpacked(answer, blobs)["correlation"])
    assert answer.score.colour_fit is not None
    np.testing.assert_array_equal(*drawn)


def test_a_scene_is_rendered_together(processes: None) -> None:
    space, blobs = opened("clutter"), Blobs()
    branch, targets = space.branch(0), space.problem.targets
    Ts = np.array([t.instance.hypotheses[0].T_cam_obj for t in targets])
    poses = tuple((t.instance.instance_id, numbers(T)) for t, T in zip(targets, Ts, strict=True))
    answer = maps(space, MapsWanted(poses=poses), blobs)
    evaluator = branch.evaluator_of(0)
    check_equal(answer, blobs, evaluator.scene_maps(targets, Ts), NAMES | COLOURS)
    assert answer.score.score == evaluator.scene_score(targets, Ts).score
    assert answer.score.err is None


def test_maps_of_no_pose_are_refused(mug: Workspace) -> None:
    with pytest.raises(InputError, match="no pose"):
        maps(mug, MapsWanted(), Blobs())
    with pytest.raises(InputError, match="no pose"):
        maps(mug, MapsWanted(obj=target_of(mug).instance.instance_id), Blobs())


def test_an_outline_runs_around_what_is_rendered(mug: Workspace) -> None:
    target, evaluator = target_of(mug), mug.branch(0).evaluator_of(1)
    Ts = [h.T_cam_obj for h in target.instance.hypotheses]
    behind = np.array(Ts[0])
    behind[2, 3] = -1.0
    want = OutlinesWanted(obj=target.instance.instance_id, poses=tuple(numbers(T) for T in (*Ts, behind)))
    shapes = outlines(mug, want, Blobs(), outline).outlines
    assert len(shapes) == len(Ts) + 1
    assert shapes[-1] == []
    for T, polygons in zip(Ts, shapes, strict=False):
        rows, columns = np.nonzero(evaluator.maps(target, T).rendered_m)
        line = np.concatenate([np.reshape(polygon, (-1, 2)) for polygon in polygons])
        assert line.min(axis=0) == pytest.approx((columns.min() - 0.5, rows.min() - 0.5), abs=1.2)
        assert line.max(axis=0) == pytest.approx((columns.max() + 0.5, rows.max() + 0.5), abs=1.2)
        # Few points enclose the same area: shoelace formula.
        (outer, *holes) = sorted((_area(polygon) for polygon in polygons), reverse=True)
        assert outer - sum(holes) == pytest.approx(len(rows), rel=0.02)
        assert len(line) < 150


def _area(polygon: list[float]) -> float:
    u, v = np.reshape(polygon, (-1, 2)).T
    return abs(float(u @ np.roll(v, -1) - v @ np.roll(u, -1))) / 2


def test_a_shaded_model_covers_what_is_rendered(mug: Workspace) -> None:
    target, evaluator, blobs = target_of(mug), mug.branch(0).evaluator_of(1), Blobs()
    T = np.array(target.instance.hypotheses[0].T_cam_obj)
    answer = shaded(mug, ShadedWanted(obj=target.instance.instance_id, T=numbers(T)), blobs, shaded_picture)
    _, _, width, height = answer.region
    blob = blobs.get((answer.url or "").removeprefix("/blob/"))
    assert blob is not None
    assert blob.media_type == "image/png"
    picture = np.asarray(PilImage.open(io.BytesIO(blob.data)))
    finer = picture.shape[1] // width
    assert picture.shape == (finer * height, finer * width, 4)
    n_rendered = np.count_nonzero(evaluator.maps(target, T).rendered_m)
    assert np.count_nonzero(picture[..., 3]) / finer**2 == pytest.approx(n_rendered, rel=0.02)
    T[0, 3] = 9.0
    assert shaded(mug, ShadedWanted(obj=target.instance.instance_id, T=numbers(T)), blobs, shaded_picture).url is None
