"""The 3D scene on the demo mug, by a real viser server without a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import viser

from tests.labels.labelled import bare_dataset, problems
from tests.page.viser_client import client
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, axis_angle, quat_wxyz, transform
from verefine_viz.core.palette import rank_colors
from verefine_viz.core.settings import MethodSettings, SceneSettings, Session
from verefine_viz.page.protocol import CloudColors, DrawnHypothesis, DrawnPose, Look, PathMoment, SceneLook
from verefine_viz.page.scene3d.camera_moves import least_hidden, visible_share
from verefine_viz.page.scene3d.observed_cloud import measured_points
from verefine_viz.page.scene3d.physics_drawing import FORCE_M
from verefine_viz.page.scene3d.scene import Scene3D
from verefine_viz.page.scene3d.viser_server import Viser3DServer
from verefine_viz.page.wire import pose_numbers
from verefine_viz.page.workspace import Workspace
from verefine_viz.pictures.surface_distances import signed_distances
from verefine_viz.run.label_session import label_session
from verefine_viz.run.toolbox import Toolbox

ITERATIONS = 3


@pytest.fixture(scope="module")
def space(processes: None) -> Workspace:
    session = Session(scene=SceneSettings(source="demo", demo="mug"), method=MethodSettings(iterations=ITERATIONS))
    space = Workspace(session, None, Toolbox)
    while not space.work.first.run.is_done:
        space.work.first.run.step()
    return space


class Shown:
    """A scene with its nodes and what it sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, ...]] = []
        self.server = Viser3DServer()
        self.scene = Scene3D(self.server, lambda *given: self.sent.append(given))

    def node(self, name: str) -> Any:
        return self.server.scene._handle_from_node_name[name]

    @property
    def visible(self) -> set[str]:
        return {name for name, node in self.server.scene._handle_from_node_name.items() if node.visible}


@pytest.fixture
def shown(processes: None) -> Iterator[Shown]:
    shown = Shown()
    yield shown
    shown.server.stop()


def own_body(space: Workspace) -> str:
    return f"/cam/objects/{space.problem.instances[0].instance_id}/coloured"


def look(space: Workspace, poses: dict[str, Any], k: int = 1, **more: Any) -> Look:
    """The only object at poses by role: the first as its body, the others as outlines."""
    obj = space.problem.instances[0].instance_id
    draw = [
        DrawnPose(obj, pose_numbers(np.asarray(T)), role, 0.0 if n else 0.9)
        for n, (role, T) in enumerate(poses.items())
    ]
    return Look(branch=space.work.first.index, k=k, obj=obj, draw=tuple(draw), **more)


def accepted(space: Workspace, k: int = 1) -> np.ndarray:
    return space.work.first.run.iterations[k - 1].accepted_stage.T_cam_obj


def test_the_body_moves_with_the_iteration_and_no_mesh_is_sent_again(space: Workspace, shown: Shown) -> None:
    branch, body = space.work.first, own_body(space)
    shown.scene.show(space, look(space, {"accepted": accepted(space)}))
    assert {"/cam/cloud", "/cam/photo", "/cam/plane_outline", body} <= shown.visible
    handles = dict(shown.server.scene._handle_from_node_name)
    for iteration in branch.run.iterations:
        for stage in iteration.stages:
            shown.scene.show(space, look(space, {stage.name: stage.T_cam_obj}))
            np.testing.assert_allclose(shown.node(body).position, stage.T_cam_obj[:3, 3], atol=2e-5)
    again = shown.server.scene._handle_from_node_name
    assert all(again[name] is handle for name, handle in handles.items())


def test_without_an_object_in_focus_the_frame_is_drawn_and_a_frame_may_have_none(
    space: Workspace, shown: Shown, tmp_path: Path
) -> None:
    around = {"/cam/cloud", "/cam/photo", "/cam/plane_outline"}
    shown.scene.show(space, Look(branch=space.work.first.index))
    assert around <= shown.visible
    assert own_body(space) not in shown.visible
    folder = bare_dataset(tmp_path / "data", problems(1))
    bare = Workspace(label_session(folder, None, None, {}), None, Toolbox)
    try:
        assert bare.problem.instances == ()
        shown.scene.show(bare, Look(branch=bare.work.first.index))
        assert around <= shown.visible
        seen_m = shown.node("/cam/cloud").points[:, 2]
        nearest_m, farthest_m = np.quantile(seen_m, [0, 1])
        points = measured_points(bare.problem)
        assert len(points) > 100
        assert np.all((points[:, 2] > nearest_m - 0.01) & (points[:, 2] < farthest_m + 0.01))
    finally:
        bare.close()


def test_the_simulated_path_is_shown_pose_by_pose(space: Workspace, shown: Shown) -> None:
    branch = space.work.first
    iteration = next(i for i in branch.run.iterations if i.path is not None)
    assert iteration.path is not None
    for moment in range(len(iteration.path.Ts_cam_obj)):
        path = PathMoment(iteration.index, moment)
        alone = SceneLook(hidden=("contacts",))
        shown.scene.show(space, look(space, {"refined": accepted(space)}, path=path, scene=alone))
        position = shown.node(own_body(space)).position
        np.testing.assert_allclose(position, iteration.path.Ts_cam_obj[moment][:3, 3], atol=2e-5)


def test_outlines_are_where_they_are_said_to_be_and_go_again(space: Workspace, shown: Shown) -> None:
    instance_id, truth = space.problem.instances[0].instance_id, space.problem.instances[0].T_cam_obj_gt
    best, beside = space.work.first.run.final_state.best[0], accepted(space)
    assert best is not None
    start = space.problem.instances[0].hypotheses[0].T_cam_obj
    poses = {"best": best.T_cam_obj, "B": beside, "ground truth": truth, "initial": start}
    shown.scene.show(space, look(space, poses))
    np.testing.assert_allclose(shown.node(own_body(space)).position, best.T_cam_obj[:3, 3], atol=2e-5)
    for role in ("B", "ground truth", "initial"):
        outline = f"/cam/objects/{instance_id}/outline_{role.replace(' ', '_')}"
        assert outline in shown.visible
        np.testing.assert_allclose(shown.node(outline).position, np.asarray(poses[role])[:3, 3], atol=2e-5)
    shown.scene.show(space, look(space, {"best": best.T_cam_obj}))
    assert not any("/outline_" in name for name in shown.visible)


def test_hypotheses_are_coloured_by_rank(space: Workspace, shown: Shown) -> None:
    instance_id = space.problem.instances[0].instance_id
    Ts = [h.T_cam_obj for h in space.problem.instances[0].hypotheses]
    ghosts = tuple(DrawnHypothesis(pose_numbers(T), k / (len(Ts) - 1)) for k, T in enumerate(Ts))
    shown.scene.show(space, look(space, {"accepted": accepted(space)}, hypotheses=ghosts, arm=1))
    node = shown.node(f"/cam/objects/{instance_id}/hypotheses")
    np.testing.assert_allclose(node.batched_positions, [T[:3, 3] for T in Ts], atol=1e-6)
    np.testing.assert_array_equal(node.batched_colors, rank_colors(np.linspace(0, 1, len(Ts))))
    assert np.argmax(node.batched_opacities) == 1


def test_what_the_image_allows_and_axes_are_drawn_where_they_are_and_go_again(space: Workspace, shown: Shown) -> None:
    instance_id, start = space.problem.instances[0].instance_id, accepted(space)
    Ts = [start @ transform(axis_angle(np.array([0.0, 0.0, 1.0]), turn), np.zeros(3)) for turn in (-0.5, 0.2, 0.6)]
    drawn = {"allowed": tuple(map(pose_numbers, Ts)), "axes": (pose_numbers(Ts[2]), pose_numbers(start))}
    shown.scene.show(space, look(space, {"best": start}, **drawn))
    own = f"/cam/objects/{instance_id}"
    ghosts = shown.node(f"{own}/allowed")
    np.testing.assert_allclose(ghosts.batched_wxyzs, [quat_wxyz(T[:3, :3]) for T in Ts], atol=1e-6)
    for k, T in enumerate((Ts[2], start)):
        np.testing.assert_allclose(shown.node(f"{own}/axes_{k}").wxyz, quat_wxyz(T[:3, :3]), atol=1e-6)
    assert {f"{own}/allowed", f"{own}/axes_0", f"{own}/axes_1"} <= shown.visible
    shown.scene.show(space, look(space, {"best": start}))
    assert not {f"{own}/allowed", f"{own}/axes_0", f"{own}/axes_1"} & shown.visible


def test_forces_are_drawn_as_long_as_mujoco_draws_them_where_the_object_can_be_looked_into(
    space: Workspace, shown: Shown
) -> None:
    branch, obj = space.work.first, space.problem.instances[0].instance_id
    iteration = next(i for i in branch.run.iterations if i.path is not None and len(i.path.contacts[-1].depths_m))
    assert iteration.path is not None
    contacts = iteration.path.contacts[-1]
    path, T = PathMoment(iteration.index, len(iteration.path.contacts)), iteration.path.T_cam_obj
    shown.scene.show(space, look(space, {"simulated": T}, path=path))
    np.testing.assert_allclose(shown.node("/cam/contact_points").points, contacts.points_cam, atol=1e-6)
    lengths_m = FORCE_M * contacts.forces_n / branch.settings.physics.mass_kg
    long = (lengths_m > 0.001) & (lengths_m < 0.1)
    ends = contacts.points_cam + lengths_m[:, None] * contacts.normals_cam
    arrows = shown.node("/cam/contacts").points
    assert long.any()
    for tail, tip in zip(contacts.points_cam[long], ends[long], strict=True):
        assert np.abs(arrows - [tail, tip]).max(axis=(1, 2)).min() < 1e-6
    assert shown.node(f"/cam/objects/{obj}/solid").opacity < 0.5
    shown.scene.show(space, look(space, {"simulated": T}, path=path, scene=SceneLook(hidden=("contacts",))))
    assert "/cam/contacts" not in shown.visible
    assert own_body(space) in shown.visible


def dragged(shown: Shown, T: np.ndarray) -> None:
    """What a browser's drag comes to on the server: its handle has moved, and its callbacks are called."""
    from verefine_viz.core.geometry import quat_wxyz

    gizmo = shown.node("/cam/gizmo")
    message = {
        "type": "TransformControlsUpdateMessage", "name": "/cam/gizmo", "owner": shown.server.scene._owner_id,
        "wxyz": tuple(float(x) for x in quat_wxyz(T[:3, :3])), "position": tuple(float(x) for x in T[:3, 3]),
    }  # fmt: skip
    with client(shown.server.address) as fake:
        n = len(shown.sent)
        fake.send(
            {"type": "TransformControlsDragStartMessage", "name": "/cam/gizmo", "owner": shown.server.scene._owner_id}
        )
        fake.send(message)
        wait_for(lambda: len(shown.sent) > n)
    assert gizmo is shown.node("/cam/gizmo")


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_drag_is_sent_and_its_echo_does_not_move_the_gizmo(space: Workspace, shown: Shown) -> None:
    branch, model = space.work.first, space.problem.target(space.problem.instances[0].instance_id).model
    start = branch.run.iterations[0].accepted_stage.T_cam_obj

    def edit(T: Any) -> None:
        shown.scene.show(space, look(space, {"gizmo": T}))

    edit(start)
    gizmo = shown.node("/cam/gizmo")
    middle = transform(np.eye(3), model.middle_m)
    np.testing.assert_allclose(gizmo.position, (start @ middle)[:3, 3], atol=1e-5)
    assert own_body(space) not in shown.visible  # The gizmo has it.
    first, second = (
        transform(axis_angle([0, 0, 1], a) @ start[:3, :3], start[:3, 3] + [a, 0, 0]) for a in (0.01, 0.02)
    )
    for T in (first, second):
        dragged(shown, T @ middle)
        name, obj, pose = shown.sent[-1]
        assert (name, obj) == ("edited", space.problem.instances[0].instance_id)
        np.testing.assert_allclose(np.reshape(pose, (4, 4)), T, atol=1e-9)
    poses = [given[2] for given in shown.sent]
    edit(poses[0])  # The window is a message behind: the gizmo stays where the hand is.
    np.testing.assert_allclose(gizmo.position, (second @ middle)[:3, 3], atol=1e-5)
    edit(poses[1])
    edit(start)  # Another pose comes from the page.
    np.testing.assert_allclose(gizmo.position, (start @ middle)[:3, 3], atol=1e-5)
    edit(poses[1])  # A pose that it sent once, typed again.
    np.testing.assert_allclose(gizmo.position, (second @ middle)[:3, 3], atol=1e-5)
    shown.scene.show(space, look(space, {"accepted": accepted(space)}))
    assert "/cam/gizmo" not in shown.server.scene._handle_from_node_name


def test_a_click_into_the_cloud_gives_the_pixel(space: Workspace, shown: Shown) -> None:
    shown.scene.show(space, look(space, {"accepted": accepted(space)}, scene=SceneLook(hidden=("photo",))))
    assert "/cam/photo" not in shown.visible
    observation = space.problem.observation
    assert observation.support is not None
    v, u = (int(x) for x in np.argwhere(observation.object_mask & (observation.depth_m > 0))[300])
    camera: Camera = observation.camera
    direction = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
    T = observation.support.T_world_cam
    event = viser.SceneClickEvent(
        client=None, client_id=0, ray_origin=tuple(T[:3, 3]),  # type: ignore[arg-type]
        ray_direction=tuple(T[:3, :3] @ direction), screen_pos=(0.5, 0.5), modifier=None,
    )  # type: ignore[call-arg]  # fmt: skip
    shown.scene._on_click(event)
    assert shown.sent == [("picked", u, v)]


def test_clouds_colours(space: Workspace, shown: Shown) -> None:
    def show(scene: SceneLook) -> None:
        shown.scene.show(space, look(space, {"accepted": accepted(space, ITERATIONS)}, scene=scene))

    seen = set()
    for colors in get_args(CloudColors):
        show(SceneLook(cloud=colors))
        seen.add(shown.node("/cam/cloud").colors.tobytes())
    assert len(seen) == 4
    show(SceneLook(box=1.0))
    assert len(shown.node("/cam/cloud").points) < len(shown.scene._frame.cloud.points_cam)


def test_distances_to_the_model_have_a_sign(space: Workspace) -> None:
    target = space.problem.target(space.problem.instances[0].instance_id)
    T = branch_pose(space)
    points_obj = target.model.points + 0.002 * target.model.point_normals
    outside = points_obj @ T[:3, :3].T + T[:3, 3]
    inside = outside - 0.003 * target.model.point_normals @ T[:3, :3].T
    far = outside + np.array([0, 0, 1])
    assert np.nanmedian(signed_distances(outside, [(target, T)], 0.02)) == pytest.approx(0.002, abs=2e-4)
    assert np.nanmedian(signed_distances(inside, [(target, T)], 0.02)) == pytest.approx(-0.001, abs=2e-4)
    assert np.isnan(signed_distances(far, [(target, T)], 0.02)).all()


def branch_pose(space: Workspace) -> np.ndarray:
    return space.work.first.run.iterations[-1].accepted_stage.T_cam_obj


def test_the_camera_goes_where_the_object_is_not_hidden() -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400, 3))
    ball *= 0.03 / np.linalg.norm(ball, axis=1, keepdims=True)
    wall = np.stack([np.full(20_000, 0.1), *rng.uniform(-0.2, 0.2, (2, 20_000))], axis=1)
    front = np.array([1.0, 0.0, 0.2]) / np.linalg.norm([1.0, 0.0, 0.2])
    assert visible_share(ball, wall, front) < 0.1
    assert visible_share(ball, wall, -front) == 1.0
    chosen = least_hidden(ball, [wall], front)
    assert visible_share(ball, wall, chosen) > 0.9
    assert chosen[2] > 0
    np.testing.assert_array_equal(least_hidden(ball, [], front), front)  # Nothing hides it: the view stays.


def test_the_first_look_shows_the_object_a_third_as_high_as_the_pane(space: Workspace, shown: Shown) -> None:
    shown.scene.show(space, look(space, {"accepted": accepted(space)}))
    camera, support = shown.server.initial_camera, space.problem.observation.support
    assert support is not None
    model = space.problem.target(space.problem.instances[0].instance_id).model
    points = apply(support.T_world_cam @ accepted(space), model.points)
    eye = np.asarray(camera.position)
    ahead = np.asarray(camera.look_at) - eye
    ahead /= np.linalg.norm(ahead)
    across = np.cross(ahead, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    offsets = points - eye
    seen = np.stack([offsets @ across, offsets @ np.cross(across, ahead)], axis=1) / (offsets @ ahead)[:, None]
    share = np.ptp(seen, axis=0).max() / (2 * np.tan(camera.fov / 2))
    assert 0.25 < share < 0.45


def test_the_scene_is_one_page_and_the_same_each_time(space: Workspace, shown: Shown) -> None:
    shown.scene.show(space, look(space, {"accepted": accepted(space)}))
    page = shown.scene.page()
    assert page == shown.scene.page()
    assert len(page) > 500_000
    assert 'src="http' not in page
