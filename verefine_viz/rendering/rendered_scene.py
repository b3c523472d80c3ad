"""A picture of a whole scene: depth, normals, labels and shaded colour, as an ideal RGB-D sensor would see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Placed
from verefine_viz.rendering.mesh import RenderMesh, drawn_faces, render_mesh
from verefine_viz.rendering.rasterizer import draw_frame

GREY = np.array([176, 176, 176], np.uint8)
"""Colour of models without any."""

CREASE_COSINE = np.cos(np.deg2rad(40.0))
"""Neighbouring faces that meet at more than this angle are shaded separately: edges stay edges."""

AMBIENT = 0.25
"""Share of ambient light; the rest comes from the camera."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """What an ideal sensor sees."""

    depth_m: NDArray[np.float32]
    """(H, W) z [m]; 0 where there is nothing."""
    normals_cam: NDArray[np.float32]
    """(H, W, 3) unit normals of the faces, towards the camera; 0 where there is nothing."""
    labels: NDArray[np.int32]
    """(H, W) index into the placed objects; -1 where there is nothing."""
    rgb: NDArray[np.uint8]
    """(H, W, 3) shaded by a light at the camera; black where there is nothing."""


def render_scene(placed: Sequence[Placed], camera: Camera) -> Rendering:
    """Renders models at their poses, with all triangles, into one image on the CPU."""
    inv_z = np.zeros(camera.shape, np.float32)
    labels = np.full(camera.shape, -1, np.int32)
    normals = np.zeros((*camera.shape, 3), np.float32)
    rgb = np.zeros((*camera.shape, 3), np.uint8)
    for index, item in enumerate(placed):
        mesh = render_mesh(item.model.vertices, item.model.faces)
        face_of = np.full(camera.shape, -1, np.int32)
        T = writable(item.T_cam_obj)
        draw_frame(T, *mesh.arrays, camera.fx, camera.fy, camera.cx, camera.cy, inv_z, face_of)
        rows, columns = np.nonzero(face_of >= 0)
        face = face_of[rows, columns]
        points = _points(camera, rows, columns, inv_z[rows, columns])
        labels[rows, columns] = index
        flat = _towards_camera(mesh.face_normals[face] @ item.T_cam_obj[:3, :3].T, points)
        normals[rows, columns] = flat
        rgb[rows, columns] = _shade(item, mesh, face, points, flat)
    depth = np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0)
    return Rendering(depth_m=depth, normals_cam=normals, labels=labels, rgb=rgb)


def _points(camera: Camera, rows: NDArray, columns: NDArray, inv_z: NDArray) -> Float:
    z = 1.0 / inv_z.astype(np.float64)
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)


def _towards_camera(normals: Float, points_cam: Float) -> Float:
    away = np.einsum("ij,ij->i", normals, points_cam) > 0
    return np.where(away[:, None], -normals, normals)


def _shade(item: Placed, mesh: RenderMesh, face: NDArray, points_cam: Float, flat_cam: Float) -> NDArray[np.uint8]:
    """Colour of each seen point: its corners' colours and smooth normals, blended by where it lies in its face."""
    corners = mesh.faces[face]
    corners_cam = apply(item.T_cam_obj, mesh.vertices)[corners]
    weights = _barycentric(points_cam, corners_cam)
    shading = np.einsum("ik,ikj->ij", weights, _corner_normals(mesh)[face]) @ item.T_cam_obj[:3, :3].T
    shading /= np.linalg.norm(shading, axis=1, keepdims=True)
    view = points_cam / np.linalg.norm(points_cam, axis=1, keepdims=True)
    light = AMBIENT + (1.0 - AMBIENT) * np.abs(np.einsum("ij,ij->i", shading, view))
    if item.model.has_colors:
        colors = item.model.colors(drawn_faces(item.model.vertices, item.model.faces)[face], weights)
    else:
        colors = np.broadcast_to(GREY, (len(face), 3)).astype(np.float64)
    return np.clip(np.rint(colors * light[:, None]), 0, 255).astype(np.uint8)


def _barycentric(points: Float, corners: Float) -> Float:
    """Barycentric weights (N, 3), not negative and summing to 1, of points (N, 3) in triangles (N, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    wb = np.einsum("ij,ij->i", np.cross(c - a, a - points), normal) / area
    wc = np.einsum("ij,ij->i", np.cross(b - a, points - a), normal) / area
    weights = np.clip(np.stack([1.0 - wb - wc, wb, wc], axis=1), 0.0, None)
    return weights / weights.sum(axis=1, keepdims=True)


def _corner_normals(mesh: RenderMesh) -> Float:
    """(F, 3, 3) unit normals at each face's corners: the mean over the faces around the corner that continue it
    smoothly.
    """
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    point_of = same.reshape(-1)[mesh.faces].ravel()
    n = len(point_of)
    touches = coo_array((np.ones(n, np.int8), (np.arange(n), point_of)), shape=(n, len(mesh.vertices))).tocsr()
    corner, neighbour = (touches @ touches.T).nonzero()
    ours, theirs = mesh.face_normals[corner // 3], mesh.face_normals[neighbour // 3]
    smooth = np.einsum("ij,ij->i", ours, theirs) > CREASE_COSINE
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)[neighbour[smooth] // 3]
    total = np.stack([np.bincount(corner[smooth], theirs[smooth, k] * area, n) for k in range(3)], axis=1)
    return (total / np.linalg.norm(total, axis=1, keepdims=True)).reshape(-1, 3, 3)
