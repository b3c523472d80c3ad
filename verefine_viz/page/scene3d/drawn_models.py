"""Models as the 3D view draws them: a solid, a solid in its own colours, and an outline to look through."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from PIL import Image as PilImage
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from verefine_viz.core.arrays import Float
from verefine_viz.core.decimation import decimated
from verefine_viz.core.geometry import quat_wxyz
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import RGB
from verefine_viz.pictures.skin import skin_of
from verefine_viz.rendering.simplify import scoring_mesh

Mesh = tuple[Float, NDArray[np.int32]]
"""Vertices (V, 3) [m] and faces (F, 3)."""
LABEL_PX = 12
"""Height of viser's labels of scale 1, on any screen."""
_OUTLINE_FACES = 300
_BEND_RAD = np.deg2rad(28)
_FEWEST_EDGES = 12
_DISPLAY_MM = 0.2
_SIMPLIFY_FROM = 3000
_TEXTURE_PX = 512


def place(node: viser.SceneNodeHandle, T_parent_node: Float) -> None:
    """Move a node within its parent's frame."""
    node.position = T_parent_node[:3, 3]
    node.wxyz = quat_wxyz(T_parent_node[:3, :3])


def show_at(node: viser.SceneNodeHandle | None, T_parent_node: Float | None) -> None:
    """Draw a node at a pose, or hide it."""
    if node is None:
        return
    if T_parent_node is not None:
        place(node, T_parent_node)
    node.visible = T_parent_node is not None


def add_solid(
    scene: viser.SceneApi, name: str, mesh: Mesh, color: RGB, opacity: float | None = None
) -> viser.MeshHandle:
    """Add a mesh of one colour, not visible yet."""
    return scene.add_mesh_simple(
        name, *mesh, color=color, opacity=opacity, flat_shading=True, side="double", visible=False, cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip


def add_coloured(scene: viser.SceneApi, name: str, model: ObjectModel) -> viser.GlbHandle | None:
    """Add a model with its own colours, not visible yet; None where it has none."""
    if (skin := skin_of(model, _TEXTURE_PX)) is not None:
        # trimesh writes a material as rough and not metallic only if both are given.
        material = PBRMaterial(baseColorTexture=PilImage.fromarray(skin.image), metallicFactor=0.0, roughnessFactor=1.0)
        mesh = trimesh.Trimesh(
            skin.vertices, skin.faces, visual=TextureVisuals(uv=skin.uv, material=material), process=False
        )
    elif model.vertex_colors is not None:
        visual = ColorVisuals(vertex_colors=np.asarray(model.vertex_colors))
        mesh = trimesh.Trimesh(model.vertices, model.faces, visual=visual, process=False)
    else:
        return None
    return scene.add_mesh_trimesh(name, mesh, visible=False, cast_shadow=False, receive_shadow=False)


def add_outline(
    scene: viser.SceneApi, name: str, segments: NDArray[np.float32], color: RGB, width_px: float
) -> viser.LineSegmentsHandle:
    """Add line segments (E, 2, 3), not visible yet."""
    return scene.add_line_segments(name, segments, color, thickness=width_px, thickness_units="screen", visible=False)


@lru_cache(maxsize=64)
def display_mesh(model: ObjectModel) -> Mesh:
    """Return the mesh to draw: the simplified one that is scored, where the original is large."""
    if len(model.faces) < _SIMPLIFY_FROM:
        return model.vertices, model.faces
    mesh = scoring_mesh(model, _DISPLAY_MM)
    return mesh.vertices, mesh.faces


@lru_cache(maxsize=64)
def outline_of(model: ObjectModel) -> NDArray[np.float32]:
    """Return the edges of a model to draw, (E, 2, 3), taken from a few hundred triangles at most."""
    vertices, faces = display_mesh(model)
    if len(faces) > _OUTLINE_FACES:
        scale = float(np.abs(vertices).max())
        vertices, faces = decimated(vertices / scale, faces, _OUTLINE_FACES)
        vertices = vertices * scale
    return edges(vertices, faces)


def edges(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the edges at which a mesh bends or ends, (E, 2, 3); all of them where it is too round to have many."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-18)
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, which = np.unique(pairs, axis=0, return_inverse=True)
    # The sum of the two unit normals beside an edge is shorter the more the surface bends there; at a border it is 1.
    total = np.zeros((len(unique), 3))
    np.add.at(total, which.reshape(-1), np.tile(normals, (3, 1)))
    bent = np.linalg.norm(total, axis=1) < 2 * np.cos(_BEND_RAD / 2)
    chosen = unique[bent] if bent.sum() >= _FEWEST_EDGES else unique
    return vertices[chosen].astype(np.float32)
