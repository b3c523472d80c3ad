"""The real frames beside the checkout load without trouble, and their poses fit their masks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.rendering.witness import cast
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.models import ModelLibrary
from verefine_viz.scenes.segments import overlap, silhouette
from verefine_viz.scenes.source import SceneSource, open_scene

pytestmark = pytest.mark.usefixtures("long_run")

FRAMES = ("0/1", "0/2", "0/3", "0/4", "0/5", "49/2365", "50/1", "900/2")


@pytest.fixture(scope="module")
def ycbv(shared_data: Path) -> SceneSource:
    return open_scene(
        SceneSettings(source="bop", dataset=str(shared_data / "ycbv"), masks="mask"), HypothesesSettings()
    )


@pytest.mark.parametrize("frame", ["0/3", "49/2365", "50/1", "900/2"])
def test_ground_truth_covers_its_mask(ycbv: SceneSource, frame: str) -> None:
    assert (ycbv.frames, ycbv.notes) == (FRAMES, ())
    problem = ycbv.problem(frame)
    assert problem.notes == ()
    assert problem.observation.support is not None
    for instance in problem.instances:
        model, camera = problem.models[instance.obj_id], problem.observation.camera
        outline = silhouette(model, instance.T_cam_obj_gt, camera)
        # By an independent witness of what the model covers.
        assert overlap(outline, cast([(model, instance.T_cam_obj_gt)], camera)[2] == 0) > 0.998
        # ``mask`` is the full silhouette, rendered from ground truth by others.
        assert overlap(outline, instance.mask) > 0.998
        assert len(instance.points_cam) == 1000
        # The observed cloud, seen from the object, lies on the model's surface.
        T = instance.T_cam_obj_gt
        points_obj = (instance.points_cam - T[:3, 3]) @ T[:3, :3]
        inside = (points_obj > model.vertices.min(0) - 0.01) & (points_obj < model.vertices.max(0) + 0.01)
        assert inside.all(axis=1).mean() > 0.6


@pytest.mark.parametrize(("frame", "n_objects"), [("49/2365", 4), ("50/1", 5)])
def test_key_frames_have_four_estimates_each(shared_data: Path, frame: str, n_objects: int) -> None:
    files = sorted((shared_data / "ycbv" / "pose_estimates").glob("*.csv"))
    settings = SceneSettings(source="bop", dataset=str(shared_data / "ycbv"), frames=(frame,), masks="mask")
    problem = open_scene(settings, HypothesesSettings(source="results", files=tuple(map(str, files)))).problem(frame)
    assert len(problem.instances) == n_objects
    methods = ["cosypose", "posecnn-icp-rss2018", "posecnn-rss2018", "sundermeyer"]
    for instance in problem.instances:
        assert [h.source for h in instance.hypotheses] == methods
        model, camera = problem.models[instance.obj_id], problem.observation.camera
        shares = [overlap(silhouette(model, h.T_cam_obj, camera), instance.mask) for h in instance.hypotheses]
        # Wrong in places (all four miss the bowl by over 40 mm), but each on its own object.
        assert min(shares) > 0.5
        assert max(shares) > 0.7


def test_the_frame_without_ground_truth_comes_from_detections(shared_data: Path) -> None:
    folder = shared_data / "xapc"
    masks = str(folder / "detections_xapc-test.json")
    source = open_scene(SceneSettings(source="bop", dataset=str(folder), masks=masks), HypothesesSettings())
    assert source.frames == ("4/0",)
    problem = source.problem("4/0")
    assert {i.obj_id: problem.models[i.obj_id].name for i in problem.instances} == {
        8: "kleenex_tissue_box",
        2: "expo_dry_erase_board_eraser",
        3: "folgers_classic_roast_coffee",
    }
    assert all(i.T_cam_obj_gt is None and len(i.points_cam) == 1000 for i in problem.instances)
    assert 0.3 < np.median(problem.observation.depth_m[problem.observation.object_mask]) < 2.0
    # The README of the data: the measured table normal is about 3° off the world's z.
    up_world = open_scene(
        SceneSettings(source="bop", dataset=str(folder), masks=masks, gravity="world"), HypothesesSettings()
    ).problem("4/0")
    cosine = problem.observation.support.T_world_cam[2, :3] @ up_world.observation.support.T_world_cam[2, :3]
    assert np.degrees(np.arccos(cosine)) == pytest.approx(3, abs=1.5)


def test_every_model_of_the_data_loads(shared_data: Path) -> None:
    for name, count in (("ycbv", 21), ("xapc", 11)):
        library = ModelLibrary(shared_data / name, 200, 0)
        assert len(library.ids) == count
        for obj_id in library.ids:
            assert library.notes(obj_id) == ()
            assert 0.05 < library.get(obj_id).diameter_m < 0.3
