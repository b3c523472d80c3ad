"""Numba compiles a kernel once for each type of its arguments: those of the rasteriser are the same from everywhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numba import types

from tests.rendering.witness import disturbed, target_of
from verefine_viz.calibration.outlines import _draw
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.learned.depth_crops import crops_at, extent_of, fill_crop
from verefine_viz.pictures.silhouettes import _drawn, _silhouette
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.mesh import render_mesh
from verefine_viz.rendering.rasterizer import draw, draw_depth
from verefine_viz.rendering.score_kernels import draw_at, score_every

KERNELS = (score_every, draw_at, draw_depth, _silhouette, fill_crop)
"""What others call, each of which draws."""


def float64_arrays(signature: Iterable[types.Type]) -> Iterator[types.Array]:
    """The arrays of poses and meshes among the arguments of a kernel."""
    for argument in signature:
        if isinstance(argument, types.BaseTuple):
            yield from float64_arrays(argument)
        elif isinstance(argument, types.Array) and argument.dtype == types.float64:
            yield argument


def test_drawing_is_compiled_once_for_all_callers():
    before = {kernel: set(kernel.signatures) for kernel in (*KERNELS, draw)}
    target, poses = target_of(), disturbed(3)
    poses.flags.writeable = False
    model, frame = target.model, target.observation
    verifier = CpuVerifier(ScoreSettings())
    scored = verifier.score(target, poses)
    assert np.array_equal(scored.score, verifier.score(target, poses.copy()).score)
    verifier.maps(target, poses[0])
    _draw(model, poses[0], frame.camera)
    mesh = render_mesh(model.vertices, model.faces)
    _drawn(mesh, poses[0], frame.camera, 2)
    crops_at(
        frame.depth_m, target.instance.mask, frame.camera, mesh, extent_of(model.vertices, model.diameter_m), poses
    )
    for kernel in KERNELS:
        assert kernel.signatures
        new = set(kernel.signatures) - before[kernel]
        assert all(array.mutable for signature in new for array in float64_arrays(signature))
    # Where those above came from the cache, what they call is within them.
    assert not any(isinstance(a, types.Literal) for signature in set(draw.signatures) - before[draw] for a in signature)
