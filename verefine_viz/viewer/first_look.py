"""Where a person looks from when a frame is opened."""

from __future__ import annotations

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.viewer.cloud import measured_points
from verefine_viz.viewer.view import View


def aim(server: viser.ViserServer, view: View, T_world_cam: Float) -> None:
    """The first look: from beside the sensor, with the objects in the part that no panel covers."""
    points = measured_points(view.problem)
    middle = points.mean(axis=0)
    extent = 2 * float(np.percentile(np.linalg.norm(points - middle, axis=1), 90))
    several = len(view.problem.instances) > 1
    distance = max(0.42, (2.75 if several else 2.5) * extent)
    towards_sensor = -middle / np.linalg.norm(middle)
    beside = np.array([0.75, -0.35, 0.0])
    direction = towards_sensor + beside
    eye_cam = middle + distance * direction / np.linalg.norm(direction)
    eye, target = apply(T_world_cam, np.array([eye_cam, middle]))
    # The free part is the upper half: look below the objects, so that they appear above the middle.
    target = target - np.array([0.0, 0.0, 0.38 * distance])
    if several:  # The list of objects covers the right: look past them on that side.
        right = np.cross(target - eye, [0.0, 0.0, 1.0])
        target = target + 0.06 * distance * right / max(float(np.linalg.norm(right)), 1e-9)
    camera = server.initial_camera
    camera.position, camera.look_at, camera.up = eye, target, np.array([0.0, 0.0, 1.0])
    camera.near = 0.005
    for client in server.get_clients().values():
        look_again(server, client)


def look_again(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Takes one browser's camera back to the first look."""
    first = server.initial_camera
    if first.up is not None:
        client.camera.up_direction = first.up
    client.camera.position, client.camera.look_at = first.position, first.look_at
