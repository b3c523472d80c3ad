"""Objects that a person marks by a box or a scribble: their pixels, and the poses that are offered for them."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest

from tests import made_up_frames as made
from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.evaluation.pose_errors import add_s_mm, pose_errors
from verefine_viz.labels.marked_region import region_of_box, region_of_scribble
from verefine_viz.labels.object_search import DIFFERS, found
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.unlabelled_frames import unlabelled_frames

Box = tuple[float, float, float, float]


@pytest.fixture(scope="module")
def tools() -> Toolbox:
    return Toolbox(resolve({"physics": {"enabled": False}}))


@pytest.fixture(scope="module")
def table() -> Problem:
    """A carton that lies on its side, a duck beside it, and a can that hides a little of the carton."""
    carton, duck, can = made.model("carton"), made.model("duck"), made.model("can")
    lying = made.on_edge(carton, transform(axis_angle([0, 0, 1], 0.7) @ axis_angle([1, 0, 0], np.pi / 2), [0, 0, 0]))
    standing = [
        transform(np.eye(3), [x, y, -float(model.vertices[:, 2].min())])
        for model, x, y in ((duck, 0.15, 0.05), (can, -0.14, -0.02))
    ]
    things = [made.Thing(model, T) for model, T in zip((carton, duck, can), (lying, *standing), strict=True)]
    return made.frame_of(things, np.random.default_rng(0))


def drawn(mask: Mask, larger: float = 0.0) -> Box:
    """The box of a mask, larger by a share of its size on each side."""
    v, u = np.nonzero(mask)
    left, top, right, bottom = u.min(), v.min(), u.max() + 1, v.max() + 1
    du, dv = larger * (right - left), larger * (bottom - top)
    return left - du, top - dv, right + du, bottom + dv


def n_right(tools: Toolbox, observation: Observation, target: Target, region: Mask) -> int:
    """How many of the offered poses are right; their order and that they differ is checked as well."""
    T_gt, model = target.instance.T_cam_obj_gt, target.model
    assert T_gt is not None
    offered = found(tools, observation, model, 0, region)
    assert 1 <= len(offered) <= 5
    assert all(a.score >= b.score for a, b in pairwise(offered))
    for a, b in combinations(offered, 2):
        assert add_s_mm(model, b.T_cam_obj, a.T_cam_obj) > 1e3 * DIFFERS * model.diameter_m
    return sum(pose_errors(model, one.T_cam_obj, T_gt).is_correct for one in offered)


def test_the_right_pose_is_offered(tools: Toolbox, table: Problem) -> None:
    for target in table.targets:
        mask = target.instance.mask
        for larger in (0.0, 0.2):
            region = region_of_box(table.observation, drawn(mask, larger))
            share = np.count_nonzero(region & mask) / np.count_nonzero(region | mask)
            assert share > 0.7, f"{target.model.name}, box larger by {larger}: {share:.2f} of its pixels"
            assert n_right(tools, table.observation, target, region), f"{target.model.name}, box larger by {larger}"


def test_a_scribble_marks_what_a_box_does(table: Problem) -> None:
    for target in table.targets:
        mask = target.instance.mask
        to_and_fro = np.argwhere(mask)[:: np.count_nonzero(mask) // 20, ::-1]
        by_scribble = region_of_scribble(table.observation, to_and_fro, target.model.diameter_m)
        by_box = region_of_box(table.observation, drawn(mask, 0.1))
        share = np.count_nonzero(by_scribble & by_box) / np.count_nonzero(by_scribble | by_box)
        assert share > 0.9, f"{target.model.name}: {share:.2f}"


def test_labelled_objects_are_not_marked(table: Problem) -> None:
    carton, _, can = table.targets
    assert can.instance.T_cam_obj_gt is not None
    labelled = [Placed(7, can.model, can.instance.T_cam_obj_gt)]
    both = drawn(carton.instance.mask | can.instance.mask)
    region = region_of_box(table.observation, both, labelled)
    left = np.count_nonzero(region & can.instance.mask) / np.count_nonzero(can.instance.mask)
    assert left < 0.05
    assert np.count_nonzero(region & carton.instance.mask) > 0.7 * np.count_nonzero(carton.instance.mask)


def test_marks_that_hold_nothing_are_refused(table: Problem) -> None:
    seen, (carton, duck, can) = table.observation, table.targets
    blind = replace(seen, depth_m=np.where(duck.instance.mask, np.float32(0), seen.depth_m))
    T_can = can.instance.T_cam_obj_gt
    assert T_can is not None
    v, u = np.nonzero(np.logical_not(seen.object_mask) & (seen.depth_m > 0))
    lowest = int(v.argmax())
    plane_only = (u[lowest] - 12, v[lowest] - 12, u[lowest] + 12, v[lowest] + 1)
    middle = [(float(np.median(x)), float(np.median(y))) for y, x in (np.nonzero(duck.instance.mask),)]
    boxes: dict[str, tuple[Observation, Box, list[Placed]]] = {
        "beside the image": (seen, (400.0, 10.0, 460.0, 60.0), []),
        "above the image": (seen, (50.0, -90.0, 90.0, -20.0), []),
        "without a size": (seen, (50.0, 50.0, 50.0, 50.0), []),
        "the wrong way round": (seen, (80.0, 80.0, 20.0, 20.0), []),
        "plane only": (seen, plane_only, []),
        "labelled objects only": (seen, drawn(can.instance.mask), [Placed(7, can.model, T_can)]),
    }
    for name, (observation, box, others) in boxes.items():
        with pytest.raises(InputError):
            pytest.fail(f"{name}: {np.count_nonzero(region_of_box(observation, box, others))} pixels")
    inside = np.zeros_like(seen.object_mask)
    inside[90:110, 150:170] = True
    dark = replace(seen, depth_m=np.where(inside, np.float32(0), seen.depth_m))
    with pytest.raises(InputError, match="no depth"):
        region_of_box(dark, drawn(inside))
    for pixels in (middle, [(-5.0, 3.0)], []):
        with pytest.raises(InputError, match="no depth"):
            region_of_scribble(blind, pixels, carton.model.diameter_m)


def test_real_frames(shared_data: Path, tmp_path: Path) -> None:
    for name, there in (("camera.json", "camera.json"), ("models", "models_textured"), ("test", "test")):
        (tmp_path / name).symlink_to(shared_data / "ycbv" / there)
    frames = ["50/1", "900/2"]
    scene = {"source": "bop", "dataset": str(tmp_path), "frames": frames}
    tools = Toolbox(resolve({"scene": scene, "hypotheses": {"source": "perturb", "max_per_object": 1}}))
    bare, rng, right = unlabelled_frames(tools.session.scene), np.random.default_rng(0), dict[str, bool]()
    for frame in frames:
        observation = bare.observation(frame)[0]
        for target in tools.source.problem(frame).targets:
            region = region_of_box(observation, drawn(target.instance.mask, rng.uniform(0, 0.2)))
            right[f"{frame} {target.model.name}"] = n_right(tools, observation, target, region) > 0
    assert len(right) == 9
    assert sum(right.values()) >= 8, right
