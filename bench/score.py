"""Milliseconds per score: our two verifiers against the authors' scheme and against reading everything back.

One object at 640×480, scored with ``pixels = "published"``, the authors' formula. Ours twice: with the mesh simplified
by the default deviation, as a session scores, and with every triangle, as the authors' scheme draws them; only those
rows compute the same number; those with colour add its term. The authors' scheme, on this machine's OpenGL: the
whole frame in two passes, averaged by mipmaps, level 4 (40×30) read back and summed; one pose after the other, every
triangle.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import moderngl
import numpy as np
import trimesh
from msgspec import structs
from numpy.typing import NDArray

from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import create_context, gl_problem, info_of
from verefine_viz.rendering.gl_verifier import GlVerifier
from verefine_viz.rendering.rendered_scene import render_scene

Poses = NDArray[np.float64]
Way = Callable[[Poses], Any]
CAMERA = Camera(np.array([[1066.8, 0, 313.0], [0, 1067.5, 241.3], [0, 0, 1]]), 640, 480)
TAU_M, ALPHA = 0.02, 0.707
N_POSES = 25
REPEATS = 15
BATCH = f"{N_POSES} poses [ms each]"

DRAW_VERT = """#version 330
uniform mat4 T_cam_obj; uniform mat4 projection;
in vec3 position; in vec3 normal; out vec4 surface;
void main() {
    vec4 p = T_cam_obj * vec4(position, 1.0);
    vec3 n = mat3(T_cam_obj) * normal;
    surface = vec4(dot(n, p.xyz) > 0.0 ? -n : n, p.z);
    gl_Position = projection * p;
}"""
DRAW_FRAG = """#version 330
in vec4 surface; out vec4 color;
void main() { color = surface; }"""
WHOLE_VERT = """#version 330
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }"""
FIT_FRAG = """#version 330
uniform sampler2D rendered; uniform sampler2D observed; uniform float tau; uniform float alpha;
out vec4 fit;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 r = texelFetch(rendered, at, 0), d = texelFetch(observed, at, 0);
    bool both = r.w > 0.0 && d.w > 0.0;
    float f_d = both ? max(0.0, 1.0 - abs(d.w - r.w) / tau) : 0.0;
    float f_n = both ? max(0.0, 1.0 - (1.0 - clamp(dot(d.xyz, r.xyz), 0.0, 1.0)) / alpha) : 0.0;
    fit = vec4(f_d, f_n, r.w > 0.0 || d.w > 0.0 ? 1.0 : 0.0, 1.0);
}"""


class FullFrame:
    """The whole frame in OpenGL, one pose after the other."""

    def __init__(self, target: Target) -> None:
        gl = self.gl = create_context()
        size = CAMERA.width, CAMERA.height
        self.surface = gl.texture(size, 4, dtype="f4")
        self.fit = gl.texture(size, 4, dtype="f4")
        observation = target.observation
        depth = np.where(observation.object_mask, observation.depth_m, 0)
        self.observed = np.dstack([observation.normals_cam, depth]).astype("f4")
        self.observed_texture = gl.texture(size, 4, self.observed.tobytes(), dtype="f4")
        self.draw_target = gl.framebuffer([self.surface], gl.depth_renderbuffer(size))
        self.fit_target = gl.framebuffer([self.fit])
        self.draw = gl.program(DRAW_VERT, DRAW_FRAG)
        self.judge = gl.program(WHOLE_VERT, FIT_FRAG)
        self.judge["rendered"], self.judge["observed"] = 0, 1
        self.judge["tau"], self.judge["alpha"] = TAU_M, ALPHA
        corners = target.model.vertices[target.model.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        vertices = np.concatenate([corners, np.repeat(normals[:, None], 3, axis=1)], axis=2)
        buffer = gl.buffer(vertices.astype("f4").tobytes())
        self.mesh = gl.vertex_array(self.draw, [(buffer, "3f 3f", "position", "normal")])
        self.whole = gl.vertex_array(self.judge, [])
        near, far, w, h = 0.01, 5.0, *size
        projection = np.array(
            [
                [2 * CAMERA.fx / w, 0, 2 * (CAMERA.cx + 0.5) / w - 1, 0],
                [0, 2 * CAMERA.fy / h, 2 * (CAMERA.cy + 0.5) / h - 1, 0],
                [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
                [0, 0, 1, 0],
            ]
        )
        self.draw["projection"] = tuple(projection.T.ravel())

    def render(self, T: Poses) -> None:
        self.draw_target.use()
        self.draw_target.clear()
        self.gl.enable_only(moderngl.DEPTH_TEST)
        self.draw["T_cam_obj"] = tuple(T.T.ravel())
        self.mesh.render()
        self.gl.enable_only(moderngl.NOTHING)

    def by_mipmaps(self, T: Poses) -> float:
        """The authors' way: two passes, mipmaps, level 4 read back."""
        self.render(T)
        self.fit_target.use()
        self.surface.use(0)
        self.observed_texture.use(1)
        self.whole.render(vertices=3)
        self.fit.build_mipmaps(0, 4)
        total = np.frombuffer(self.fit.read(level=4), "f4").reshape(-1, 4).sum(axis=0)
        return float(0.5 * (total[0] + total[1]) / total[2])

    def by_numpy(self, T: Poses) -> float:
        """Depth and normals of the whole frame read back, Eq. 1 in numpy."""
        self.render(T)
        r = np.frombuffer(self.surface.read(), "f4").reshape(*CAMERA.shape, 4)
        d = self.observed
        both = (r[..., 3] > 0) & (d[..., 3] > 0)
        f_d = np.where(both, np.maximum(0, 1 - np.abs(d[..., 3] - r[..., 3]) / TAU_M), 0)
        dot = np.clip(np.einsum("hwk,hwk->hw", d[..., :3], r[..., :3]), 0, 1)
        f_n = np.where(both, np.maximum(0, 1 - (1 - dot) / ALPHA), 0)
        n = ((r[..., 3] > 0) | (d[..., 3] > 0)).sum()
        return float(0.5 * (f_d.sum() + f_n.sum()) / n)


def bottle() -> ObjectModel:
    """A closed, dented shape of 0.19 m and 20 480 triangles, about what a scanned household object has."""
    mesh = trimesh.creation.icosphere(5, 0.05)
    x, y, z = mesh.vertices.T / 0.05
    dents = 1 + 0.03 * np.sin(7 * x + 2 * y) * np.cos(5 * z) + 0.1 * np.cos(3 * z)
    vertices = mesh.vertices * dents[:, None] * [1.0, 0.8, 1.7]
    points = vertices[:8]
    bands = np.stack([np.sin(3 * x), np.cos(4 * y), np.sin(5 * z)], axis=1)
    colors = (127 * (1 + bands)).astype(np.uint8)
    return ObjectModel(1, "bottle", vertices, mesh.faces, points, points * 0 + 1, 0.19, np.eye(4)[None], colors)


def scene() -> tuple[Target, Poses]:
    """The object on a table at 0.8 m, with sensor noise, and poses around its own."""
    model = bottle()
    T = transform(axis_angle([1.0, 0.4, 0.2], 1.9), [0.02, 0.0, 0.8])
    plate = trimesh.creation.box([2.0, 2.0, 0.02])
    table = ObjectModel(2, "table", plate.vertices, plate.faces, plate.vertices, plate.vertices, 2.8, np.eye(4)[None])
    T_table = transform(axis_angle([1.0, 0, 0], 0.6), [0, 0.05, 0.95])
    seen = render_scene([Placed(0, model, T), Placed(1, table, T_table)], CAMERA)
    rng = np.random.default_rng(0)
    depth = np.where(seen.depth_m > 0, seen.depth_m + rng.normal(0, 0.001, CAMERA.shape), 0)
    mask = seen.labels == 0
    observation = Observation(CAMERA, depth, seen.normals_cam, seen.rgb, mask, None)
    target = Target(observation, Instance(0, 1, mask, np.zeros((0, 3)), (), T), model)
    Ts = [T]
    for _ in range(N_POSES - 1):
        Ts.append(T @ transform(axis_angle(rng.normal(size=3), rng.uniform(0, 0.3)), rng.normal(0, 0.008, 3)))
    return target, np.stack(Ts)


def run() -> list[dict[str, Any]]:
    """One row per way to score: ms per pose for a single pose and in a batch, and how the scores compare.

    The largest difference is to the CPU's scores with every triangle.
    """
    target, Ts = scene()
    simplified = ScoreSettings(pixels="published", tau_m=TAU_M, alpha=ALPHA)
    whole = structs.replace(simplified, simplify_mm=0.0)
    coloured = structs.replace(simplified, colour_weight=0.1)
    witness = CpuVerifier(whole)
    ways = [
        ("ours, CPU", _by(CpuVerifier(simplified), target)),
        ("ours, CPU, with colour", _by(CpuVerifier(coloured), target)),
        ("ours, CPU, every triangle", _by(witness, target)),
    ]
    software = None
    if gl_problem() is None:
        full = FullFrame(target)
        info = info_of(full.gl)
        software = info.is_software
        ways += [
            (f"ours, OpenGL ({info.renderer})", _by(GlVerifier(simplified), target)),
            ("ours, OpenGL, with colour", _by(GlVerifier(coloured), target)),
            ("ours, OpenGL, every triangle", _by(GlVerifier(whole), target)),
            ("authors' scheme: full frame, mipmap level 4", lambda poses: _in_turn(full.gl, full.by_mipmaps, poses)),
            ("full frame read back, numpy", lambda poses: _in_turn(full.gl, full.by_numpy, poses)),
        ]
    reference = witness.score(target, Ts).score
    difference = [float(np.abs(np.asarray(way(Ts)) - reference).max()) for _, way in ways]
    # In turns, so that what else the machine does hits all of them alike.
    times = np.array([[[_ms(way, poses) for poses in (Ts[:1], Ts)] for _, way in ways] for _ in range(REPEATS)])
    ms = np.median(times, axis=0) / [1, N_POSES]
    rows = [
        {"score": name, "1 pose [ms]": float(ms[i, 0]), BATCH: float(ms[i, 1]), "largest difference": difference[i]}
        for i, (name, _) in enumerate(ways)
    ]
    authors = next((r for r in rows if r["score"].startswith("authors")), None)
    if authors:
        rows = [{**row, "times the authors'": authors[BATCH] / row[BATCH], "software GL": software} for row in rows]
    return rows


def _by(verifier: Verifier, target: Target) -> Way:
    return lambda poses: verifier.score(target, poses).score


def _in_turn(gl: moderngl.Context, way: Callable[[Poses], float], poses: Poses) -> list[float]:
    with gl:
        return [way(T) for T in poses]


def _ms(way: Way, poses: Poses) -> float:
    start = perf_counter()
    way(poses)
    return (perf_counter() - start) * 1e3
