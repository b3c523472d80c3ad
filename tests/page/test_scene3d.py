"""The 3D scene on the demo mug, by a real viser server without a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import viser

from tests.page.viser_client import client
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.settings import MethodSettings, SceneSettings, Session
from verefine_viz.page.moment import moment_of
from verefine_viz.page.protocol import Beside, Look
from verefine_viz.page.scene3d.camera_moves import least_hidden, visible_share
from verefine_viz.page.scene3d.observed_cloud import signed_distances
from verefine_viz.page.scene3d.scene import Scene3D
from verefine_viz.page.scene3d.viser_server import Viser3DServer
from verefine_viz.page.workspace import Workspace
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


def test_the_body_moves_with_the_iteration_and_no_mesh_is_sent_again(space: Workspace, shown: Shown) -> None:
    branch, body = space.work.first, own_body(space)
    shown.scene.show(space, Look(branch=branch.index, k=1))
    assert {"/cam/cloud", "/cam/photo", "/world/grid", body} <= shown.visible
    handles = dict(shown.server.scene._handle_from_node_name)
    for k in range(1, ITERATIONS + 1):
        for stage in (s.name for s in branch.run.iterations[k - 1].stages):
            look = Look(branch=branch.index, k=k, stage=stage)
            shown.scene.show(space, look)
            reached = branch.run.iterations[k - 1]
            last = stage == reached.stages[-1].name
            T = (
                reached.accepted_stage.T_cam_obj
                if last
                else next(s for s in reached.stages if s.name == stage).T_cam_obj
            )
            np.testing.assert_allclose(shown.node(body).position, T[:3, 3], atol=2e-5)
    again = shown.server.scene._handle_from_node_name
    assert all(again[name] is handle for name, handle in handles.items())


def test_the_simulated_path_is_shown_pose_by_pose(space: Workspace, shown: Shown) -> None:
    branch = space.work.first
    iteration = next(i for i in branch.run.iterations if i.path is not None)
    assert iteration.path is not None
    for moment in range(len(iteration.path.Ts_cam_obj)):
        shown.scene.show(space, Look(branch=branch.index, k=iteration.index, moment=moment))
        position = shown.node(own_body(space)).position
        np.testing.assert_allclose(position, iteration.path.Ts_cam_obj[moment][:3, 3], atol=2e-5)


def test_the_answer_and_a_run_beside_it(space: Workspace, shown: Shown) -> None:
    branch, n = space.work.first, space.work.first.run.length
    instance_id = space.problem.instances[0].instance_id
    shown.scene.show(space, Look(branch=branch.index, k=n, answer=True, b=Beside(branch=branch.index, k=1)))
    best = branch.run.final_state.best[0]
    assert best is not None
    np.testing.assert_allclose(shown.node(own_body(space)).position, best.T_cam_obj[:3, 3], atol=2e-5)
    beside = moment_of(branch, Look(branch=branch.index, k=1)).object(instance_id).T_cam_obj
    assert beside is not None
    outline = f"/cam/objects/{instance_id}/outline_B"
    np.testing.assert_allclose(shown.node(outline).position, beside[:3, 3], atol=2e-5)
    shown.scene.show(space, Look(branch=branch.index, k=n, answer=True))
    assert outline not in shown.visible


def dragged(shown: Shown, T: np.ndarray) -> None:
    """What a browser's drag comes to on the server: its handle has moved, and its callbacks are called."""
    from verefine_viz.core.geometry import quat_wxyz

    gizmo = shown.node("/cam/gizmo")
    message = {
        "type": "TransformControlsUpdateMessage", "name": "/cam/gizmo", "owner": shown.server.scene._owner_id,
        "wxyz": tuple(float(x) for x in quat_wxyz(T[:3, :3])), "position": tuple(float(x) for x in T[:3, 3]),
    }  # fmt: skip
    with client(f"http://127.0.0.1:{shown.server.get_port()}") as fake:
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
        shown.scene.show(space, Look(branch=branch.index, k=1, edited=tuple(float(x) for x in np.ravel(T))))

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
    shown.scene.show(space, Look(branch=branch.index, k=1))
    assert "/cam/gizmo" not in shown.server.scene._handle_from_node_name


def test_a_click_into_the_cloud_gives_the_pixel(space: Workspace, shown: Shown) -> None:
    shown.scene.show(space, Look(branch=space.work.first.index, k=1))
    shown.scene.panel.hide("photo")
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
    branch = space.work.first
    look = Look(branch=branch.index, k=ITERATIONS)
    seen = set()
    for colors in ("photo", "distance to model", "normals", "class"):
        shown.scene.panel._cloud.value = colors
        shown.scene.show(space, look)
        seen.add(shown.node("/cam/cloud").colors.tobytes())
    assert len(seen) == 4
    shown.scene.panel._box.value = 1.0
    shown.scene.show(space, look)
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


def test_the_scene_is_one_page_and_the_same_each_time(space: Workspace, shown: Shown) -> None:
    shown.scene.show(space, Look(branch=space.work.first.index, k=1))
    page = shown.scene.page()
    assert page == shown.scene.page()
    assert len(page) > 500_000
    assert 'src="http' not in page
