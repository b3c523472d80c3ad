"""Indexed PNGs: small, and exact in their colours."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def indexed_png(image: NDArray[np.uint8], palette: bytes) -> bytes:
    """A PNG of (H, W) indices into an RGB ``palette`` (768 bytes)."""
    picture, content = Image.fromarray(image), io.BytesIO()
    picture.putpalette(palette)
    # Higher levels take longer and gain next to nothing.
    picture.save(content, "png", compress_level=4)
    return content.getvalue()
