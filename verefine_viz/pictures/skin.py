"""A textured model as renderers of pages and recordings want it: a place in the image for every vertex."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh whose vertices are doubled along the seams of its texture."""

    vertices: Float
    """(V, 3) [m]."""
    faces: NDArray[np.int32]
    """(F, 3), those of the model in its order."""
    uv: NDArray[np.float32]
    """(V, 2) u to the right and v up."""
    image: NDArray[np.uint8]
    """(h, w, 3) RGB."""


@lru_cache(maxsize=64)
def skin_of(model: ObjectModel, largest_px: int) -> Skin | None:
    """The model's skin, its image no larger than ``largest_px``; None without a texture."""
    texture = model.texture
    if texture is None:
        return None
    corners = np.column_stack([model.faces.ravel(), texture.uv.reshape(-1, 2)])
    unique, corner = np.unique(corners, axis=0, return_inverse=True)
    image = PilImage.fromarray(texture.image)
    image.thumbnail((largest_px, largest_px))
    vertices = model.vertices[unique[:, 0].astype(np.intp)]
    return Skin(vertices, corner.reshape(-1, 3).astype(np.int32), unique[:, 1:].astype(np.float32), np.asarray(image))
