"""Numba compiles a kernel once for each type of its arguments: those of the rasteriser are the same from everywhere."""

from __future__ import annotations

import numpy as np
from numba import types

from tests.rendering.witness import disturbed, target_of
from verefine_viz.calibration.outlines import _draw
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.learned.depth_crops import crops_at, extent_of
from verefine_viz.page.views.pose_outlines import _drawn
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.mesh import render_mesh
from verefine_viz.rendering.rasterizer import draw


def is_as_all_others(argument: types.Type) -> bool:
    return argument.mutable if isinstance(argument, types.Array) else not isinstance(argument, types.Literal)


def test_drawing_is_compiled_once_for_all_callers():
    before = set(draw.signatures)
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
    assert draw.signatures
    assert all(is_as_all_others(argument) for types_of in set(draw.signatures) - before for argument in types_of)
