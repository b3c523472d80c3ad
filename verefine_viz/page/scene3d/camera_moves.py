"""Moves of the 3D view's camera: to the sensor, to a first overview, and to where an object is not hidden."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Observation

NEAR_M = 0.005
"""Distance from which on the view is drawn [m]."""
_ELEVATIONS_DEG = (25, 50, 75)
_AZIMUTHS = 12
_CELLS, _LEAST_CELL_M = 12, 0.006
"""Cells across an object; no smaller than the distance of points that are sampled on models."""
_TURNING = 0.15
"""Share of an object's points that is worth a turn of the view by 180°."""
_FIRST_TURNING = 0.8
"""This share for the first look: from behind, the observed cloud is a veil with holes."""
_FIRST_SHARE = 1 / 3
"""Share of the pane's height that the object in focus takes in the first look."""
_BESIDE_RAD = math.radians(25)


def set_first_look(
    server: viser.ViserServer, points_world: Float, others_world: Sequence[Float], sensor_world: Float
) -> None:
    """Let browsers begin where an object's points (n, 3) fill a third of the pane and are not hidden.

    Connected browsers are moved there.

    Args:
        server: whose browsers they are.
        points_world: of the object in focus [m].
        others_world: points of the others, which may hide it.
        sensor_world: where the sensor was (3,): the side from which the observed cloud is a surface.
    """
    middle = (points_world.min(axis=0) + points_world.max(axis=0)) / 2
    to_sensor = (sensor_world - middle) / np.linalg.norm(sensor_world - middle)
    camera = server.initial_camera
    direction = least_hidden(points_world, others_world, _beside(to_sensor), _FIRST_TURNING)
    distance_m = (
        float(np.ptp(points_world @ _axes_seen(direction).T, axis=0).max())
        / _FIRST_SHARE
        / (2 * math.tan(camera.fov / 2))
    )
    camera.position, camera.look_at, camera.up = middle + distance_m * direction, middle, np.array([0.0, 0.0, 1.0])
    camera.near = NEAR_M
    for client in server.get_clients().values():
        _take_to_first_look(server, client)


def _beside(direction: Float) -> Float:
    """Turn a direction a little about the vertical, so that a line along it can be seen."""
    c, s = math.cos(_BESIDE_RAD), math.sin(_BESIDE_RAD)
    return np.array([c * direction[0] - s * direction[1], s * direction[0] + c * direction[1], direction[2]])


def _take_to_first_look(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Take one browser's camera back to the first look."""
    first = server.initial_camera
    client.camera.up_direction = np.array([0.0, 0.0, 1.0])
    client.camera.position, client.camera.look_at, client.camera.fov = first.position, first.look_at, first.fov


def take_to_sensor(client: viser.ClientHandle, observation: Observation, T_world_cam: Float) -> None:
    """Put one browser's camera where the sensor was, looking along its axis, as high an image as it took."""
    depth_m = observation.depth_m[observation.depth_m > 0]
    ahead_m = float(np.median(depth_m)) if len(depth_m) else 1.0
    eye, target = apply(T_world_cam, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, ahead_m]]))
    client.camera.up_direction = -T_world_cam[:3, 1]
    client.camera.position, client.camera.look_at = eye, target
    client.camera.fov = 2 * math.atan2(observation.camera.height / 2, observation.camera.fy)


def take_to_points(client: viser.ClientHandle, points_world: Float, others_world: Sequence[Float]) -> None:
    """Take one browser's camera close to an object's points (n, 3), where those of others hide the fewest of them."""
    low, high = points_world.min(axis=0), points_world.max(axis=0)
    middle, size_m = (low + high) / 2, float(np.linalg.norm(high - low))
    now = np.asarray(client.camera.position) - np.asarray(client.camera.look_at)
    direction = least_hidden(points_world, others_world, now / max(float(np.linalg.norm(now)), 1e-9))
    distance_m = 1.1 * size_m / (2 * math.tan(client.camera.fov / 2)) + size_m / 2
    client.camera.up_direction = np.array([0.0, 0.0, 1.0])
    client.camera.position, client.camera.look_at = middle + distance_m * direction, middle


def least_hidden(points: Float, others: Sequence[Float], now: Float, turning: float = _TURNING) -> Float:
    """Return the direction (3,) from an object to the eye, above the ground, from which most of its points are seen.

    Of directions that are about as good, the one near the present one, ``now``, is taken; a turn by 180° is worth
    ``turning`` of the points.
    """
    directions = [
        np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        for e in np.deg2rad(_ELEVATIONS_DEG)
        for a in np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    ]
    if 0.1 < now[2] < 0.98:
        directions.append(now)
    together = np.concatenate(others) if others else np.zeros((0, 3))
    return max(directions, key=lambda d: visible_share(points, together, d) + turning * (d @ now) / 2)


def visible_share(points: Float, others: Float, direction: Float) -> float:
    """Return the share of an object's points that other points do not hide, as seen from a direction.

    Both are drawn into cells of a grid perpendicular to the direction, with the depth of the nearest point in each.
    """
    axes, middle = _axes_seen(direction), points.mean(axis=0)
    cell_m = max(2 * float(np.linalg.norm(points - middle, axis=1).max()) / _CELLS, _LEAST_CELL_M)
    cells, near = (points - middle) @ axes.T // cell_m, (points - middle) @ direction
    other_cells, other_near = (others - middle) @ axes.T // cell_m, (others - middle) @ direction
    half = _CELLS
    heights = np.full((2 * half, 2 * half), -np.inf)
    inside = (np.abs(other_cells + 0.5) < half).all(axis=1)
    at = other_cells[inside].astype(int) + half
    np.maximum.at(heights, (at[:, 0], at[:, 1]), other_near[inside])
    own = np.clip(cells.astype(int) + half, 0, 2 * half - 1)
    return float((heights[own[:, 0], own[:, 1]] <= near + cell_m / 2).mean())


def _axes_seen(direction: Float) -> Float:
    """Return the axes (2, 3) across and up of a view from a direction."""
    across = np.cross([0.0, 0.0, 1.0], direction)
    across /= max(float(np.linalg.norm(across)), 1e-9)
    return np.stack([across, np.cross(direction, across)])


def cut_away(camera: viser.CameraHandle, ball_world: tuple[Float, float], share: float) -> None:
    """Cut one browser's view at a plane perpendicular to it, at a share of a ball's depth.

    Args:
        camera: of the browser.
        ball_world: centre (3,) and radius [m].
        share: 0 = nothing is cut away, 1 = the whole ball.
    """
    near_m, (centre, radius_m) = NEAR_M, ball_world
    if share:
        ahead = camera.look_at - camera.position
        depth_m = float((centre - camera.position) @ ahead) / max(float(np.linalg.norm(ahead)), 1e-9)
        near_m = max(depth_m + (2 * share - 1) * radius_m, NEAR_M)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # A browser that has just closed gets nothing more.
        camera.near = near_m  # An unchanged value is not sent.
