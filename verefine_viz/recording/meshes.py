"""The meshes of objects, made once for all frames that show them: a stage moves by its transform alone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import fast_simplification
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import ARM_COLORS, RGB, STAGE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.piece import Piece

DRAWN_FACES, DRAWN_FACES_IN_SCENE = 1200, 500
GHOST_FACES = 300
STAGE_ALPHA = {"current": 110, "simulated": 150, "mixed": 90, "refined": 170, "best": 230, "placed": 200}
STAGE_ALPHA |= {"incumbent": 255}
GHOST_ALPHA = 35
TRUTH_ALPHA = 60


def object_pieces(target: Target, branch: str, own: RGB | None) -> Iterator[Piece]:
    """An object's meshes; ``own`` is its colour in a scene of several."""
    root = f"{entities.OBJECTS}/{branch}"
    T_gt = target.instance.T_cam_obj_gt
    yield from _meshes(target.model, branch, T_gt is not None, own)
    if target.instance.hypotheses:
        yield _ghosts(target, f"{root}/hypotheses")
    if T_gt is not None:
        yield chunks.fixed_row(f"{root}/ground_truth", columns.transforms(T_gt[None]))


@lru_cache(maxsize=64)
def _meshes(model: ObjectModel, branch: str, has_truth: bool, own: RGB | None) -> tuple[Piece, ...]:
    """The object in the colour of each stage, made once for all frames that show it."""
    root, n_faces = f"{entities.OBJECTS}/{branch}", DRAWN_FACES if own is None else DRAWN_FACES_IN_SCENE
    looks = {stage: STAGE_COLORS[stage] for stage in entities.DRAWN_STAGES}
    if own is not None:
        looks |= {"placed": own, "incumbent": own}
    stages = [
        chunks.fixed(
            f"{root}/stages/{stage}",
            _mesh(model, n_faces, color, STAGE_ALPHA[stage]),
            rr.CoordinateFrame(entities.stage_frame(branch, stage)),
        )
        for stage, color in looks.items()
    ]
    if has_truth:
        truth = _mesh(model, n_faces, STAGE_COLORS["ground truth"], TRUTH_ALPHA)
        stages.append(chunks.fixed(f"{root}/ground_truth", truth))
    return tuple(stages)


def _ghosts(target: Target, entity: str) -> Piece:
    """All first hypotheses as one mesh, each in its arm's colour: an entity for each would cost 6 kB a piece."""
    vertices, _, normals = _simplified(target.model, GHOST_FACES)
    Ts = np.array([h.T_cam_obj for h in target.instance.hypotheses], np.float32)
    turned, ts = Ts[:, :3, :3].transpose(0, 2, 1), Ts[:, None, :3, 3]
    mesh = rr.Mesh3D
    parts = [
        columns.vectors(mesh.descriptor_vertex_positions(), [vertices @ turned + ts], 3),
        columns.vectors(mesh.descriptor_vertex_normals(), [normals @ turned], 3),
        *_ghost_faces(target.model, len(Ts)),
    ]
    return chunks.fixed_row(entity, parts)


@lru_cache(maxsize=256)
def _ghost_faces(model: ObjectModel, n: int) -> tuple[columns.Column, ...]:
    """What does not depend on where the hypotheses are."""
    vertices, faces, _ = _simplified(model, GHOST_FACES)
    colors = columns.packed(np.array([ARM_COLORS[arm % len(ARM_COLORS)] for arm in range(n)], np.uint8))
    triangles = faces[None] + np.uint32(len(vertices)) * np.arange(n, dtype=np.uint32)[:, None, None]
    mesh = rr.Mesh3D
    return (
        columns.vectors(mesh.descriptor_triangle_indices(), [triangles], 3, np.uint32),
        columns.numbers(mesh.descriptor_vertex_colors(), [np.repeat(colors, len(vertices))], np.uint32),
        columns.numbers(mesh.descriptor_albedo_factor(), [[0xFFFFFF00 | GHOST_ALPHA]], np.uint32),
    )


def _mesh(model: ObjectModel, n_faces: int, color: RGB, alpha: int) -> rr.Mesh3D:
    vertices, faces, normals = _simplified(model, n_faces)
    return rr.Mesh3D(
        vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, albedo_factor=(*color, alpha)
    )


@lru_cache(maxsize=256)
def _simplified(
    model: ObjectModel, n_faces: int
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """A coarse mesh to draw, with smooth vertex normals."""
    vertices: Any = model.vertices.astype(np.float32)
    faces: Any = np.array(model.faces)
    if len(faces) > n_faces:
        simpler: Any = fast_simplification.simplify(vertices, faces, target_count=n_faces)
        vertices, faces = simpler
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return vertices, faces.astype(np.uint32), normals.astype(np.float32)
