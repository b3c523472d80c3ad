"""The OpenGL passes of the score: draw poses into tiles, score their pixels row by row, add up the rows.

All arrays keep image order: texture row v is image row v, so nothing is ever flipped, and the projection puts pixel
centres at integers of the camera's image.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from weakref import WeakKeyDictionary

import moderngl
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.rendering.colour import N_COLOUR_SUMS, ColourGrid, SceneColours
from verefine_viz.rendering.mesh import RenderMesh, RenderMeshes
from verefine_viz.rendering.prepared import PreparedTarget
from verefine_viz.rendering.rasterizer import NEAR_M
from verefine_viz.rendering.score_kernels import OWN

Intrinsics = tuple[float, float, float, float]
Windows = NDArray[np.int64]
"""(N, m, 4) the window x0, y0, columns, rows of each model of N combinations of poses [px]; 0 columns for none."""

AnyTexture = moderngl.Texture | moderngl.TextureArray | moderngl.Texture3D

ATLAS_PIXELS = 1 << 23
"""Largest atlas [px]; more poses are scored in several batches."""

NORMALS_WIDTH = 1024
"""Width of the texture that holds face normals, row by row."""

VERY_FAR_M = 1e30
"""Stands for no far limit [m]."""


class Framebuffer:
    """A framebuffer of (z, face) with a depth buffer, grown when more is asked for."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._size = (0, 0)
        self.texture: moderngl.Texture
        self.framebuffer: moderngl.Framebuffer

    def clear(self, width: int, height: int) -> None:
        """Empties it, at least (width, height) [px] large."""
        if width > self._size[0] or height > self._size[1]:
            self._size = max(width, self._size[0]), max(height, self._size[1])
            self.texture = self._context.texture(self._size, 2, dtype="f4")
            self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            depth = self._context.depth_renderbuffer(self._size)
            self.framebuffer = self._context.framebuffer([self.texture], depth)
        self.framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0, viewport=(0, 0, width, height))

    def read(self, width: int, height: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Z (height, width) [m] and face of the lower corner."""
        raw = self.framebuffer.read((0, 0, width, height), components=2, dtype="f4")
        pixels = np.frombuffer(raw, np.float32).reshape(height, width, 2)
        return pixels[:, :, 0].copy(), pixels[:, :, 1].astype(np.int64)


class GlPasses:
    """Programs, buffers and textures of one context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.context = context
        # What Python no longer references is released at the next call, in the thread that owns the context.
        context.gc_mode = "context_gc"
        self.atlas = Framebuffer(context)
        self.placed = Framebuffer(context)
        self._draw = context.program(_shader("draw.vert"), _shader("draw.frag"))
        self._score = context.program(_shader("whole.vert"), _shader("score.frag"))
        self._reduce = context.program(_shader("whole.vert"), _shader("reduce.frag"))
        self._score_all = context.vertex_array(self._score, [])
        self._reduce_all = context.vertex_array(self._reduce, [])
        self._colour = context.program(_shader("whole.vert"), _shader("colour.frag"))
        self._colour_all = context.vertex_array(self._colour, [])
        self._meshes: WeakKeyDictionary[RenderMesh, moderngl.VertexArray] = WeakKeyDictionary()
        self._normals: WeakKeyDictionary[RenderMeshes, moderngl.Texture] = WeakKeyDictionary()
        self._targets: WeakKeyDictionary[PreparedTarget, dict[str, moderngl.Texture | moderngl.TextureArray]]
        self._targets = WeakKeyDictionary()
        self._grids: WeakKeyDictionary[ColourGrid, moderngl.Texture3D] = WeakKeyDictionary()
        self._images: WeakKeyDictionary[SceneColours, moderngl.Texture] = WeakKeyDictionary()
        self._max_side = int(context.info["GL_MAX_TEXTURE_SIZE"])

    def collect(self) -> None:
        """Releases what is no longer referenced."""
        self.context.gc()

    def batches(self, windows: Windows) -> Iterator[tuple[int, int]]:
        """Ranges of combinations whose tiles fit into one atlas."""
        columns, rows = _tile(_joint(windows))
        per_atlas = min(
            (self._max_side // columns) * (self._max_side // rows), max(1, ATLAS_PIXELS // (columns * rows))
        )
        for first in range(0, len(windows), per_atlas):
            yield first, min(first + per_atlas, len(windows))

    def draw_tiles(self, meshes: RenderMeshes, Ts: Float, windows: Windows, camera: Intrinsics, far: float) -> None:
        """Pass 1: the window of the image that holds each combination (N, m, 4, 4) into its tile of the atlas."""
        joint = _joint(windows)
        columns, rows = _tile(joint)
        per_row = self._tiles_per_row(joint)
        self.atlas.clear(min(per_row, len(Ts)) * columns, -(-len(Ts) // per_row) * rows)
        for i in range(len(Ts)):
            corner = (i % per_row) * columns, (i // per_row) * rows
            shown = [k for k in range(len(meshes.meshes)) if windows[i, k, 2] > 0]
            items = [(meshes.meshes[k], Ts[i, k]) for k in shown]
            first_faces = [int(meshes.face_starts[k]) for k in shown]
            self._draw_together(self.atlas, corner, items, first_faces, joint[i], camera, far)

    def draw_scene(
        self, items: list[tuple[RenderMesh, Float]], shape: tuple[int, int], camera: Intrinsics, far: float
    ) -> None:
        """Several models into one whole image (height, width), ``placed``."""
        height, width = shape
        self.placed.clear(width, height)
        whole = np.array([0, 0, width, height])
        drawn = [(mesh, T) for mesh, T in items if np.isfinite(T).all()]
        self._draw_together(self.placed, (0, 0), drawn, [0] * len(drawn), whole, camera, far)

    def sums(
        self,
        prepared: PreparedTarget,
        meshes: RenderMeshes,
        Ts: Float,
        windows: Windows,
        camera: Intrinsics,
        has_placed: bool,
        rule: tuple[int, float, float],
    ) -> NDArray[np.float32]:
        """Passes 2 and 3: the sums (N, 3, 4) of ``score.frag``'s three outputs over each combination's tile.

        Args:
            prepared: what was observed.
            meshes: as in :meth:`draw_tiles`.
            Ts: as there.
            windows: as there.
            camera: (fx, fy, cx, cy) [px].
            has_placed: whether ``placed`` holds objects that may hide others.
            rule: (pixels, τ, α).
        """
        inputs, values = self._tiles(meshes, Ts, windows, camera)
        placed = self.placed.texture if has_placed else self.atlas.texture
        inputs = {**inputs, **self._target(prepared), "placed": placed}
        of_rule = dict(zip(("pixels", "tau_m", "alpha"), rule, strict=True))
        _bind(self._score, inputs, {**values, **of_rule, "has_placed": has_placed})
        return self._summed(self._score_all, len(Ts), _tile(_joint(windows))[1])

    def colour_sums(
        self,
        prepared: PreparedTarget,
        colours: SceneColours,
        meshes: RenderMeshes,
        Ts: Float,
        windows: Windows,
        camera: Intrinsics,
        tau_m: float,
    ) -> Float:
        """Passes 2 and 3 of the colour term: what f_c of each model is made of, (N, m, ``N_COLOUR_SUMS``).

        Args:
            prepared: what was observed.
            colours: of the models and of the image.
            meshes: as in :meth:`draw_tiles`.
            Ts: as there.
            windows: as there.
            camera: (fx, fy, cx, cy) [px].
            tau_m: depth tolerance [m].
        """
        out = np.zeros((*Ts.shape[:2], N_COLOUR_SUMS))
        inputs, values = self._tiles(meshes, Ts, windows, camera)
        seen = self._target(prepared)
        inputs = {**inputs, "observed": seen["observed"], "own": seen["own"], "image": self._image(colours)}
        for k, grid in enumerate(colours.grids):
            if grid is not None:
                own = {"model": k, "origin_m": tuple(grid.origin_m), "per_metre": 1 / grid.cell_m, "tau_m": tau_m}
                _bind(self._colour, {**inputs, "cells": self._cells(grid)}, {**values, **own})
                sums = self._summed(self._colour_all, len(Ts), _tile(_joint(windows))[1])
                out[:, k] = sums.reshape(len(Ts), 12)[:, :N_COLOUR_SUMS]
        return out

    def _tiles(
        self, meshes: RenderMeshes, Ts: Float, windows: Windows, camera: Intrinsics
    ) -> tuple[Mapping[str, AnyTexture], Mapping[str, object]]:
        """What pass 2 is given of the drawn tiles: textures and values."""
        joint, (n, m) = _joint(windows), Ts.shape[:2]
        # What is not drawn may hold numbers that no texture can.
        drawn = np.where(windows[:, :, 2, None, None] > 0, Ts, np.eye(4))
        pose_rows = np.concatenate([drawn[:, :, :3].reshape(n, 3 * m, 4), joint[:, None]], axis=1).astype("f4")
        poses = self.context.texture((3 * m + 1, n), 4, pose_rows.tobytes(), dtype="f4")
        inputs = {"atlas": self.atlas.texture, "poses": poses, "face_normals": self._face_normals(meshes)}
        per_row = self._tiles_per_row(joint)
        return inputs, {"camera": camera, "tile": _tile(joint), "tiles_per_row": per_row, "n_models": m}

    def _summed(self, everywhere: moderngl.VertexArray, n: int, rows: int) -> NDArray[np.float32]:
        """Pass 2, for whose program all is bound, and pass 3: its three outputs (n, 3, 4) summed over each tile."""
        context = self.context
        by_row = [context.texture((rows, n), 4, dtype="f4") for _ in range(3)]
        by_pose = context.texture((n, 3), 4, dtype="f4")
        row_target = context.framebuffer(by_row)
        row_target.use()
        everywhere.render(vertices=3)
        _bind(self._reduce, {f"rows_{k}": texture for k, texture in enumerate(by_row)}, {"n_rows": rows})
        pose_target = context.framebuffer([by_pose])
        pose_target.use()
        self._reduce_all.render(vertices=3)
        result = np.frombuffer(pose_target.read(components=4, dtype="f4"), np.float32).reshape(3, n, 4)
        return result.transpose(1, 0, 2)

    def _draw_together(
        self,
        surface: Framebuffer,
        corner: tuple[int, int],
        items: list[tuple[RenderMesh, Float]],
        first_faces: list[int],
        window: NDArray[np.int64],
        camera: Intrinsics,
        far: float,
    ) -> None:
        """Models at their poses into one window, which lies at ``corner`` of the surface."""
        if not items:
            return
        x0, y0, columns, rows = (int(k) for k in window)
        nearest = min(T[2, 3] - mesh.radius_m for mesh, T in items)
        farthest = max(T[2, 3] + mesh.radius_m for mesh, T in items)
        surface.framebuffer.use()
        self.context.viewport = (*corner, columns, rows)
        self.context.enable_only(moderngl.DEPTH_TEST)
        # OpenGL takes matrices column by column.
        self._draw["projection"] = tuple(_projection(camera, (x0, y0, columns, rows), nearest, farthest).T.ravel())
        self._draw["far_m"] = min(far, VERY_FAR_M)
        for (mesh, T), first_face in zip(items, first_faces, strict=True):
            self._draw["T_cam_obj"] = tuple(T.T.ravel())
            self._draw["first_face"] = first_face
            self._mesh(mesh).render(moderngl.TRIANGLES)
        self.context.enable_only(moderngl.NOTHING)

    def _tiles_per_row(self, joint: NDArray[np.int64]) -> int:
        columns, rows = _tile(joint)
        square = int(np.ceil(np.sqrt(len(joint) * rows / columns)))
        return max(1, min(square, self._max_side // columns))

    def _mesh(self, mesh: RenderMesh) -> moderngl.VertexArray:
        if mesh not in self._meshes:
            vertices = self.context.buffer(mesh.vertices.astype("f4").tobytes())
            indices = self.context.buffer(mesh.faces.astype("i4").tobytes())
            self._meshes[mesh] = self.context.vertex_array(self._draw, [(vertices, "3f", "in_position")], indices)
        return self._meshes[mesh]

    def _face_normals(self, meshes: RenderMeshes) -> moderngl.Texture:
        """Normal and number of the model of every face."""
        if meshes not in self._normals:
            n_faces = len(meshes.faces)
            height = -(-n_faces // NORMALS_WIDTH)
            normals = np.zeros((height * NORMALS_WIDTH, 4), "f4")
            normals[:n_faces, :3] = meshes.face_normals
            normals[:n_faces, 3] = meshes.model_of(np.arange(n_faces))
            texture = self.context.texture((NORMALS_WIDTH, height), 4, normals.tobytes(), dtype="f4")
            self._normals[meshes] = texture
        return self._normals[meshes]

    def _cells(self, grid: ColourGrid) -> moderngl.Texture3D:
        if grid not in self._grids:
            x, y, z, _ = grid.cells.shape
            self._grids[grid] = self.context.texture3d((z, y, x), 3, grid.cells.tobytes(), dtype="f4")
        return self._grids[grid]

    def _image(self, colours: SceneColours) -> moderngl.Texture:
        if colours not in self._images:
            height, width, _ = colours.observed.shape
            self._images[colours] = self.context.texture((width, height), 3, colours.observed.tobytes(), dtype="f4")
        return self._images[colours]

    def _target(self, prepared: PreparedTarget) -> dict[str, moderngl.Texture | moderngl.TextureArray]:
        if prepared not in self._targets:
            m, height, width = prepared.own.shape
            size, own = (width, height), prepared.own & OWN
            self._targets[prepared] = {
                "observed": self.context.texture(size, 4, prepared.observed.tobytes(), dtype="f4"),
                "flags": self.context.texture(size, 1, prepared.flags.tobytes(), alignment=1, dtype="u1"),
                "own": self.context.texture_array((*size, m), 1, own.tobytes(), alignment=1, dtype="u1"),
            }
        return self._targets[prepared]


def _joint(windows: Windows) -> NDArray[np.int64]:
    """(N, 4) the window that holds all models of a combination [px]; 0 columns where none shows."""
    shows = windows[:, :, 2:3] > 0
    first = np.where(shows, windows[:, :, :2], np.iinfo(np.int64).max).min(axis=1)
    last = np.where(shows, windows[:, :, :2] + windows[:, :, 2:], 0).max(axis=1)
    return np.where(shows.any(axis=1), np.concatenate([first, last - first], axis=1), 0)


def _tile(joint: NDArray[np.int64]) -> tuple[int, int]:
    """(columns, rows) that hold every window [px]."""
    if len(joint) == 0:
        return 1, 1
    return max(1, int(joint[:, 2].max())), max(1, int(joint[:, 3].max()))


def _projection(camera: Intrinsics, window: tuple[int, int, int, int], nearest: float, farthest: float) -> Float:
    """Clip space from the camera frame for a window of the image, depth between two z [m], a little widened."""
    fx, fy, cx, cy = camera
    x0, y0, columns, rows = window
    near = max(NEAR_M, nearest - 0.01 * (farthest - nearest))
    far = max(farthest + 0.01 * (farthest - nearest), 2.0 * near)
    # A fragment's centre is at half a pixel of the viewport: image column u is at x = u − x0 + 1/2.
    return np.array(
        [
            [2 * fx / columns, 0, 2 * (cx - x0 + 0.5) / columns - 1, 0],
            [0, 2 * fy / rows, 2 * (cy - y0 + 0.5) / rows - 1, 0],
            [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, 1, 0],
        ]
    )


def _bind(
    program: moderngl.Program,
    textures: Mapping[str, AnyTexture],
    values: Mapping[str, object],
) -> None:
    for unit, (name, texture) in enumerate(textures.items()):
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        texture.use(unit)
        program[name] = unit
    for name, value in values.items():
        program[name] = value


def _shader(name: str) -> str:
    return (resources.files("verefine_viz.rendering") / "shaders" / name).read_text(encoding="utf-8")
