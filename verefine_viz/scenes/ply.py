"""Models as BOP has them: binary PLY files in millimetres, and their entries in models_info.json."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float


def ply_bytes(vertices_m: Float, faces: NDArray[np.int32], vertex_colors: NDArray[np.uint8] | None) -> bytes:
    """The content of a PLY file; coordinates are doubles, so that the vertices come back as they were.

    Args:
        vertices_m: (V, 3) [m]; millimetres in the file.
        faces: (F, 3) vertex indices.
        vertex_colors: (V, 3) RGB, or None.
    """
    fields: list[tuple[str, str]] = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]
    if vertex_colors is not None:
        fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.empty(len(vertices_m), dtype=fields)
    for k, axis in enumerate("xyz"):
        vertices[axis] = vertices_m[:, k] * 1e3
    if vertex_colors is not None:
        for k, channel in enumerate(("red", "green", "blue")):
            vertices[channel] = vertex_colors[:, k]
    records = np.empty(len(faces), dtype=[("n", "u1"), ("vertex_indices", "<i4", 3)])
    records["n"], records["vertex_indices"] = 3, faces
    properties = "".join(f"property {'uchar' if kind == 'u1' else 'double'} {name}\n" for name, kind in fields)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(records)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode("ascii") + vertices.tobytes() + records.tobytes()


def size_entry(vertices_m: Float, diameter_m: float) -> dict[str, Any]:
    """What models_info.json says of a model's size [mm]."""
    low, high = vertices_m.min(axis=0) * 1e3, vertices_m.max(axis=0) * 1e3
    entry: dict[str, Any] = {"diameter": diameter_m * 1e3}
    entry |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    entry |= {f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)}
    return entry
