"""A grasp in Bullet: what it holds, what it does not, and that it always comes to the same."""

import numpy as np
import pytest
from msgspec import structs

from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.grasping import grasp_trial
from verefine_viz.grasping.grasp_poses import sampled
from verefine_viz.grasping.grasp_trial import LIFT_M, Body, GraspPath, GraspWorld
from verefine_viz.grasping.gripper import TIP_M
from verefine_viz.physics.colliders import build
from verefine_viz.scenes.demo_models import demo_model

SETTINGS = GraspSettings()
DOWN = np.diag([1.0, -1.0, -1.0])
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def block() -> ObjectModel:
    """75 × 45 × 30 mm."""
    return demo_model("block", 500, 0)


def _tried(
    model: ObjectModel, y_m: float = 0.0, tip_m: float = 0.005, settings: GraspSettings = SETTINGS, there: bool = True
) -> GraspPath:
    """From above, the fingers closing along y, off the middle by ``y_m``."""
    T_world_obj = transform(np.eye(3), [0.0, 0.0, -float(model.vertices[:, 2].min())])
    bodies = [Body(0, build(model, "hull"), T_world_obj)] if there else []
    grasp = transform(DOWN, [0.0, y_m, TIP_M + tip_m])
    return GraspWorld(bodies, 0, UP, settings).run(grasp)


def test_block_is_lifted_and_stays_between_the_fingers(block: ObjectModel) -> None:
    path = _tried(block)
    rise_m = path.Ts_world_obj[0][-1, 2, 3] - path.Ts_world_obj[0][0, 2, 3]
    assert path.verdict == "success"
    assert rise_m == pytest.approx(LIFT_M, abs=0.005)
    assert path.gaps_m[-1] == pytest.approx(0.045, abs=0.002)


def test_a_wrong_pose_ends_as_it_would(block: ObjectModel) -> None:
    for y_m, tip_m, verdict in (
        (0.055, 0.005, "collided with the target"),
        (0.0, -0.01, "collided with the ground"),
        (0.0, 0.04, "no contact"),
    ):
        assert _tried(block, y_m, tip_m).verdict == verdict
    assert _tried(block, there=False).verdict == "no contact"


def test_the_pads_hold_what_coulomb_allows(block: ObjectModel) -> None:
    needed = SETTINGS.mass_kg * 9.81 / (2 * SETTINGS.force_n)
    for share, verdict in ((0.0, "slipped"), (0.85, "slipped"), (1.5, "success")):
        assert _tried(block, settings=structs.replace(SETTINGS, friction=share * needed)).verdict == verdict
    most_kg = 2 * SETTINGS.friction * SETTINGS.force_n / 9.81
    assert _tried(block, settings=structs.replace(SETTINGS, mass_kg=0.6 * most_kg)).verdict == "success"
    assert _tried(block, settings=structs.replace(SETTINGS, mass_kg=1.2 * most_kg)).verdict == "slipped"


def test_same_arguments_give_the_same_bits(block: ObjectModel) -> None:
    one, other = _tried(block, 0.01), _tried(block, 0.01)
    assert one.Ts_world_obj[0].tobytes() == other.Ts_world_obj[0].tobytes()
    assert one.forces_n.tobytes() == other.forces_n.tobytes()


def test_sampled_grasps_hold_the_object_and_come_again_for_a_seed(block: ObjectModel) -> None:
    poses = sampled(block, SETTINGS)
    assert len(poses) == SETTINGS.samples
    assert poses.tobytes() == sampled(block, SETTINGS).tobytes()
    for T in poses:
        x, y, z = ((block.points - T[:3, 3]) @ T[:3, :3]).T
        between = (np.abs(x) < 0.01) & (z < TIP_M)
        assert np.ptp(y[between]) < SETTINGS.opening_m


def test_the_path_is_read_only(block: ObjectModel, monkeypatch: pytest.MonkeyPatch) -> None:
    often = _tried(block, 0.01)
    monkeypatch.setattr(grasp_trial, "SHOWN_EVERY", 10**9)
    seldom = _tried(block, 0.01)
    assert seldom.verdict == often.verdict
    assert seldom.n_moments < often.n_moments / 10
    assert seldom.Ts_world_obj[0][-1].tobytes() == often.Ts_world_obj[0][-1].tobytes()
    assert seldom.Ts_world_gripper[-1].tobytes() == often.Ts_world_gripper[-1].tobytes()


def test_contacts_name_what_is_touched(block: ObjectModel) -> None:
    path = _tried(block)
    held = [
        {c.instance_id for c in now} for now, stage in zip(path.contacts, path.stages, strict=True) if stage == "hold"
    ]
    assert set().union(*held) == {0}
    assert {c.instance_id for c in _tried(block, tip_m=-0.01).contacts[-1]} == {None}


def test_further_off_is_never_better(block: ObjectModel) -> None:
    """Across the fingers: the object is 45 mm wide, and they open 135 mm."""
    ends = [_tried(block, y_m).verdict == "success" for y_m in (0.0, 0.02, 0.04, 0.05, 0.06, 0.08, 0.12)]
    assert ends[0]
    assert not ends[-1]
    assert ends == sorted(ends, reverse=True)
