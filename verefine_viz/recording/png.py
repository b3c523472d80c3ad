"""Indexed PNGs, packed by Intel's ISA-L: half the time that zlib takes at its fastest, and smaller.

A PNG is a signature, then chunks: each its length, its kind, its content, and the CRC-32 of the last two.
"""

from __future__ import annotations

import struct

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_SIZE = struct.Struct(">IIBBBBB")
_EIGHT_BITS, _INDEXED = 8, 3


def indexed_png(image: NDArray[np.uint8], palette: bytes) -> bytes:
    """A PNG of (H, W) places in an RGB ``palette`` (768 bytes)."""
    height, width = image.shape
    # Every row begins with how it is filtered: 0 = not at all.
    rows = np.zeros((height, 1 + width), np.uint8)
    rows[:, 1:] = image
    return b"".join(
        (
            _SIGNATURE,
            _chunk(b"IHDR", _SIZE.pack(width, height, _EIGHT_BITS, _INDEXED, 0, 0, 0)),
            _chunk(b"PLTE", palette),
            _chunk(b"IDAT", isal_zlib.compress(rows, 1)),
            _chunk(b"IEND", b""),
        )
    )


def _chunk(kind: bytes, content: bytes) -> bytes:
    return b"".join(
        (struct.pack(">I", len(content)), kind, content, struct.pack(">I", isal_zlib.crc32(kind + content)))
    )
