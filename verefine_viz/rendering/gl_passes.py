"""The OpenGL passes of the score, all compute shaders: pictures of all poses of a batch at once, and their sums.

Everything lies in buffers that are made once and grow when more is asked for. All pictures keep image order, and pixel
centres lie at integers of the camera's image. A combination has a picture of its own window alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from weakref import WeakKeyDictionary

import moderngl
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.rendering.colour import N_COLOUR_SUMS, SceneColours
from verefine_viz.rendering.mesh import RenderMeshes
from verefine_viz.rendering.prepared import PreparedTarget
from verefine_viz.rendering.rasterizer import NEAR_M

Intrinsics = tuple[float, float, float, float]
Windows = NDArray[np.int64]
"""(N, m, 4) the window x0, y0, columns, rows of each model of N combinations of poses [px]; 0 columns for none."""

BATCH_PIXELS = 1 << 23
"""Most pixels of the pictures of a batch, 64 MB; more combinations are scored in several batches. Twice as many are
still whole numbers of 32-bit floats, and in half of the smallest buffer that OpenGL 4.3 promises."""

MOST_GROUPS = 65_535
"""Work groups along one axis, as OpenGL 4.3 promises; hence combinations of a batch."""

DRAWING_THREADS = 128
"""Threads in a work group of ``draw.comp``."""

CLEARING_THREADS = 256
"""Threads in a work group of ``clear.comp``."""

THREAD_PIXELS = 16
"""About so many pixels are drawn by a thread; a triangle that has more is shared by several."""

MOST_SIDE = 16
"""Root of the most threads that share a triangle."""

PIXEL_BYTES = 8
"""Bytes of a pixel: 1/z and face."""

N_RAW = 12
"""Numbers that a work group sums."""

GRID = np.dtype([("corner", "f4", 4), ("shape", "i4", 4), ("faces", "i4", 2), ("", "i4", 2)])
"""A model's colours in ``colour.comp``."""


class Storage:
    """A buffer that is made once, and made larger when more is asked for."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self.buffer = context.buffer(reserve=64, dynamic=True)

    def holding(self, n_bytes: int) -> moderngl.Buffer:
        """The buffer, with room for at least so many bytes; what it held is lost where it grows."""
        if n_bytes > self.buffer.size:
            self.buffer = self._context.buffer(reserve=n_bytes, dynamic=True)
        return self.buffer

    def write(self, array: NDArray) -> moderngl.Buffer:
        """The buffer, with an array at its beginning."""
        buffer = self.holding(array.nbytes)
        buffer.write(array)
        return buffer


@dataclass(frozen=True)
class Drawn:
    """A batch whose pictures are drawn."""

    meshes: RenderMeshes
    n: int
    """Combinations."""
    camera: Intrinsics


@dataclass(frozen=True)
class MeshBuffers:
    """Meshes as the shaders read them."""

    vertices: moderngl.Buffer
    faces: moderngl.Buffer
    normals: moderngl.Buffer


class GlPasses:
    """Programs and buffers of one context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.context = context
        # What Python no longer references is released at the next call, in the thread that owns the context.
        context.gc_mode = "context_gc"
        self._clear = context.compute_shader(_source("pictures.glsl", "clear.comp"))
        self._draw = context.compute_shader(_source("pictures.glsl", "draw.comp"))
        self._score = context.compute_shader(_source("pictures.glsl", "sum.glsl", "score.comp"))
        self._colour = context.compute_shader(_source("pictures.glsl", "sum.glsl", "colour.comp"))
        self._combinations, self._pictures = Storage(context), Storage(context)
        self._placed, self._sums, self._read = Storage(context), Storage(context), Storage(context)
        self._meshes: WeakKeyDictionary[RenderMeshes, MeshBuffers] = WeakKeyDictionary()
        self._targets: WeakKeyDictionary[PreparedTarget, tuple[moderngl.Buffer, moderngl.Buffer]] = WeakKeyDictionary()
        self._colours: WeakKeyDictionary[SceneColours, tuple[moderngl.Buffer, ...]] = WeakKeyDictionary()

    def collect(self) -> None:
        """Releases what is no longer referenced."""
        self.context.gc()

    def draw(self, meshes: RenderMeshes, Ts: Float, windows: Windows, camera: Intrinsics, far: float) -> Drawn:
        """Passes 1 and 2: the window of the image that holds each combination (N, m, 4, 4), all at once."""
        joint = _joint_windows(windows)
        n_pixels = int((joint[:, 2] * joint[:, 3]).sum())
        pictures = self._empty(self._pictures, n_pixels)
        groups = self._draw_into(pictures, meshes, Ts, windows, joint, camera, far)
        self._draw["find_faces"] = True
        self._run(self._draw, *groups)
        return Drawn(meshes, len(Ts), camera)

    def draw_placed(
        self, items: Sequence[tuple[RenderMeshes, Float]], shape: tuple[int, int], camera: Intrinsics
    ) -> None:
        """Single models (4, 4) into one whole image (height, width), which may hide what is scored."""
        whole = np.array([[0, 0, shape[1], shape[0]]])
        picture = self._empty(self._placed, shape[0] * shape[1])
        for meshes, T in items:
            self._draw_into(picture, meshes, T[None, None], whole[None], whole, camera, np.inf)

    def sums(
        self, drawn: Drawn, prepared: PreparedTarget, has_placed: bool, rule: tuple[int, float, float]
    ) -> NDArray[np.float32]:
        """Pass 3: the sums (N, 3, 4) of ``score.comp`` over each combination's window.

        Args:
            drawn: what :meth:`draw` has drawn last.
            prepared: what was observed.
            has_placed: whether objects that may hide others are drawn.
            rule: (pixels, τ, α).
        """
        results = self._sums.holding(4 * N_RAW * drawn.n)
        placed = self._placed.buffer if has_placed else self._pictures.buffer
        target, normals = self._target(prepared), self._mesh(drawn.meshes).normals
        _bind(self._combinations.buffer, self._pictures.buffer, results, *target, normals, placed)
        of_rule = dict(zip(("pixels", "tau_m", "alpha"), rule, strict=True))
        _set(self._score, **_frame(drawn, prepared), **of_rule, has_placed=has_placed)
        self._run(self._score, drawn.n)
        return np.frombuffer(results.read(4 * N_RAW * drawn.n), np.float32).reshape(drawn.n, 3, 4)

    def colour_sums(self, drawn: Drawn, prepared: PreparedTarget, colours: SceneColours, tau_m: float) -> Float:
        """Pass 4: what f_c of each model is made of, (N, m, ``N_COLOUR_SUMS``).

        Args:
            drawn: what :meth:`draw` has drawn last.
            prepared: what was observed.
            colours: of the models and of the image.
            tau_m: depth tolerance [m].
        """
        m = len(drawn.meshes.meshes)
        results = self._sums.holding(4 * N_RAW * drawn.n * m)
        inputs = *self._target(prepared), *self._colours_of(colours, drawn.meshes)
        _bind(self._combinations.buffer, self._pictures.buffer, results, *inputs)
        _set(self._colour, **_frame(drawn, prepared), tau_m=tau_m)
        self._run(self._colour, drawn.n, m)
        raw = np.frombuffer(results.read(4 * N_RAW * drawn.n * m), np.float32)
        return raw.reshape(drawn.n, m, N_RAW)[:, :, :N_COLOUR_SUMS].astype(np.float64)

    def picture(self, shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Z (height, width) [m], 0 = empty, and face; of the one combination that is drawn, in a window as large."""
        return self._read_picture(self._pictures, shape)

    def placed_depth(self, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Z (height, width) [m] of what :meth:`draw_placed` has drawn; 0 = empty."""
        return self._read_picture(self._placed, shape)[0]

    def _empty(self, storage: Storage, n_pixels: int) -> moderngl.Buffer:
        """Pictures of so many pixels, empty. By a pass: OpenGL's own clearing may move the buffer to the CPU."""
        pictures, n_words = storage.holding(PIXEL_BYTES * n_pixels), PIXEL_BYTES // 4 * n_pixels
        _bind(self._combinations.buffer, pictures)
        self._clear["n_words"] = n_words
        self._run(self._clear, min(-(-n_words // CLEARING_THREADS), MOST_GROUPS))
        return pictures

    def _draw_into(
        self,
        pictures: moderngl.Buffer,
        meshes: RenderMeshes,
        Ts: Float,
        windows: Windows,
        joint: NDArray[np.int64],
        camera: Intrinsics,
        far: float,
    ) -> tuple[int, int, int]:
        """Pass 1: the nearest 1/z of every pixel of pictures that are empty, or hold other models.

        Returns:
            The work groups.
        """
        combinations = self._combinations.write(_combinations(meshes, Ts, windows, joint))
        mesh = self._mesh(meshes)
        _bind(combinations, pictures, mesh.vertices, mesh.faces)
        side, m = _side(joint, len(meshes.faces)), len(meshes.meshes)
        sizes = {"n_models": m, "side": side}
        _set(self._draw, **sizes, find_faces=False, camera=camera, near_m=NEAR_M, least_inv_z=1 / far)
        n_threads = int(np.diff(meshes.face_starts).max()) * side**2
        groups = min(-(-n_threads // DRAWING_THREADS), MOST_GROUPS), len(Ts), m
        self._run(self._draw, *groups)
        return groups

    def _run(self, shader: moderngl.ComputeShader, x: int, y: int = 1, z: int = 1) -> None:
        """A pass; the next one sees what it wrote."""
        if x > 0 and y > 0:
            shader.run(x, y, z)
            self.context.memory_barrier()

    def _read_picture(self, storage: Storage, shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        n_bytes = PIXEL_BYTES * shape[0] * shape[1]
        # A buffer that the CPU reads may stay with the CPU, so that is never the one that is drawn into.
        copy = self._read.holding(n_bytes)
        self.context.copy_buffer(copy, storage.buffer, n_bytes)
        words = np.frombuffer(copy.read(n_bytes), np.uint32).reshape(*shape, 2)
        inv_z = np.ascontiguousarray(words[:, :, 0]).view(np.float32)
        drawn = inv_z > 0
        depth = np.divide(1, inv_z, out=np.zeros(shape, np.float32), where=drawn)
        return depth, np.where(drawn, words[:, :, 1], 0).astype(np.int64)

    def _mesh(self, meshes: RenderMeshes) -> MeshBuffers:
        if meshes not in self._meshes:
            model = meshes.model_of(np.arange(len(meshes.faces)))
            corners = meshes.faces + meshes.vertex_starts[model, None]
            faces = np.column_stack([corners, meshes.closed]).astype("i4")
            vertices = np.pad(meshes.vertices, ((0, 0), (0, 1))).astype("f4")
            normals = np.column_stack([meshes.face_normals, model]).astype("f4")
            self._meshes[meshes] = MeshBuffers(*(self.context.buffer(a.tobytes()) for a in (vertices, faces, normals)))
        return self._meshes[meshes]

    def _target(self, prepared: PreparedTarget) -> tuple[moderngl.Buffer, moderngl.Buffer]:
        """Observed frame and flags."""
        if prepared not in self._targets:
            flags = np.concatenate([prepared.flags[None], prepared.own]).ravel()
            words = np.pad(flags, (0, -len(flags) % 4))
            observed, packed = prepared.observed.tobytes(), words.tobytes()
            self._targets[prepared] = self.context.buffer(observed), self.context.buffer(packed)
        return self._targets[prepared]

    def _colours_of(self, colours: SceneColours, meshes: RenderMeshes) -> tuple[moderngl.Buffer, ...]:
        """Image, cells and grids."""
        if colours not in self._colours:
            cells, starts, shapes, origins, per_metre, image = colours.arrays
            grids = np.zeros(len(shapes), GRID)
            grids["corner"] = np.column_stack([origins, per_metre])
            grids["shape"] = np.column_stack([shapes, starts[:-1]])
            grids["faces"] = np.column_stack([meshes.face_starts[:-1], meshes.face_starts[1:]])
            self._colours[colours] = tuple(self.context.buffer(array.tobytes()) for array in (image, cells, grids))
        return self._colours[colours]


def batches(windows: Windows) -> Iterator[slice]:
    """Ranges of combinations whose pictures fit into one buffer; at least one each."""
    joint = _joint_windows(windows)
    ends = np.cumsum(joint[:, 2] * joint[:, 3])
    first = 0
    while first < len(windows):
        before = ends[first - 1] if first else 0
        fit = int(np.searchsorted(ends, before + BATCH_PIXELS, side="right"))
        last = min(max(fit, first + 1), first + MOST_GROUPS)
        yield slice(first, last)
        first = last


def _joint_windows(windows: Windows) -> NDArray[np.int64]:
    """(N, 4) the window that holds all models of a combination [px]; 0 columns where none shows."""
    shows = windows[:, :, 2:3] > 0
    first = np.where(shows, windows[:, :, :2], np.iinfo(np.int64).max).min(axis=1)
    last = np.where(shows, windows[:, :, :2] + windows[:, :, 2:], 0).max(axis=1)
    return np.where(shows.any(axis=1), np.concatenate([first, last - first], axis=1), 0)


def _combinations(meshes: RenderMeshes, Ts: Float, windows: Windows, joint: NDArray[np.int64]) -> NDArray[np.float32]:
    """Combinations (N, 2 + 4 m, 4) as ``pictures.glsl`` says."""
    n, m = Ts.shape[:2]
    out = np.zeros((n, 2 + 4 * m, 4), np.float32)
    out[:, 0] = joint
    out[1:, 1, 0] = np.cumsum(joint[:-1, 2] * joint[:-1, 3])
    # What is not drawn may hold numbers that no 32-bit float can.
    shows = windows[:, :, 2] > 0
    drawn = np.where(shows[:, :, None, None], Ts, 0)
    poses = out[:, 2:].reshape(n, m, 4, 4)
    poses[:, :, :3] = drawn[:, :, :3]
    poses[:, :, 3, 0] = drawn[:, :, 2, 3] - [mesh.radius_m for mesh in meshes.meshes] > NEAR_M
    poses[:, :, 3, 1] = meshes.face_starts[:-1]
    poses[:, :, 3, 2] = np.diff(meshes.face_starts) * shows
    return out


def _side(joint: NDArray[np.int64], n_faces: int) -> int:
    """Root of the threads that share a triangle: a power of two."""
    pixels = float((joint[:, 2] * joint[:, 3]).mean()) / max(n_faces, 1) if len(joint) else 0.0
    side = math.sqrt(pixels / THREAD_PIXELS)
    return min(MOST_SIDE, 1 << int(math.log2(max(side, 1.0))))


def _frame(drawn: Drawn, prepared: PreparedTarget) -> dict[str, object]:
    """What passes that sum know of a frame."""
    height, width = prepared.flags.shape
    sizes = {"n_models": len(drawn.meshes.meshes), "width": width, "n_pixels": height * width}
    return {**sizes, "camera": drawn.camera}


def _bind(*buffers: moderngl.Buffer) -> None:
    for binding, buffer in enumerate(buffers):
        buffer.bind_to_storage_buffer(binding)


def _set(shader: moderngl.ComputeShader, **values: object) -> None:
    for name, value in values.items():
        shader[name] = value


def _source(*names: str) -> str:
    folder = resources.files("verefine_viz.rendering") / "shaders"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)
