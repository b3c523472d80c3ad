"""Annotated grasps: which file, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.grasping.grasp_poses import grasps_of, sampled
from verefine_viz.scenes.demo_models import demo_model


@pytest.fixture(scope="module")
def block() -> ObjectModel:
    return demo_model("block", 500, 0)


def test_a_file_named_after_the_object_is_read(tmp_path: Path, block: ObjectModel) -> None:
    poses = sampled(block, GraspSettings())
    np.save(tmp_path / "012_block.npy", poses.reshape(-1, 1, 16))
    grasps = grasps_of(block, GraspSettings(folder=str(tmp_path)))
    assert grasps.source == "annotated"
    np.testing.assert_allclose(grasps.T_obj_gripper, poses, atol=1e-12)


def test_what_holds_no_grasp_of_the_object_is_refused(tmp_path: Path, block: ObjectModel) -> None:
    for poses, message in (
        (transform(np.eye(3), [0.0, 0.0, 0.4])[None], "another object"),
        (np.diag([2.0, 1.0, 1.0, 1.0])[None], "4×4 in metres"),
        (np.zeros((3, 5)), r"an array of shape \(3, 5\), expected \(N, 4, 4\)"),
        (np.zeros((0, 16)), "0 grasps, expected 1 to"),
    ):
        np.save(tmp_path / "block.npy", poses)
        with pytest.raises(InputError, match=message):
            grasps_of(block, GraspSettings(folder=str(tmp_path)))
    (tmp_path / "block.npy").unlink()
    with pytest.raises(InputError, match=r"holds no \.npy files"):
        grasps_of(block, GraspSettings(folder=str(tmp_path)))
    with pytest.raises(InputError, match="is no folder"):
        grasps_of(block, GraspSettings(folder=str(tmp_path / "none")))
