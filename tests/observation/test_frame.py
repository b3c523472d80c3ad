import numpy as np

from tests.fakes import box_problem
from tests.observation.planes import CAMERA
from tests.observation.test_support import UP, scene
from verefine_viz.core.settings import SceneSettings
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.observation.observed_frame import observe
from verefine_viz.recording.verify import first_difference


def test_puts_everything_together() -> None:
    depth, mask = scene(0.001)
    other = np.zeros(CAMERA.shape, bool)
    other[:5, :5] = True
    rgb = np.full((*CAMERA.shape, 3), 7, np.uint8)
    observation = observe(CAMERA, depth, rgb, [mask, other], SceneSettings())
    assert observation.depth_m.dtype == np.float32
    assert np.array_equal(observation.object_mask, mask | other)
    assert np.array_equal(observation.normals_cam, estimate_normals(observation.depth_m, CAMERA))
    assert observation.support.T_world_cam[2, :3] @ UP > 0.9999
    assert observation.support_note == ""
    again = observe(CAMERA, depth, rgb, [mask, other], SceneSettings())
    assert first_difference(observation, again) is None


def test_a_frame_without_a_plane_or_the_worlds_gravity_is_no_error() -> None:
    camera = box_problem().observation.camera
    observation = observe(camera, np.zeros(camera.shape), None, [], SceneSettings())
    assert observation.support is None
    assert observation.support_note.startswith("no support plane: ")
    assert "\n" not in observation.support_note
    assert not observation.object_mask.any()
    depth, mask = scene()
    observation = observe(CAMERA, depth, None, [mask], SceneSettings(gravity="world"))
    assert observation.support is None
    assert "cam_R_w2c" in observation.support_note
