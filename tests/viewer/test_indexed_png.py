from __future__ import annotations

import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from verefine_viz.viewer.drawing.score_maps import indexed_png

IMAGES = arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40)))
PALETTES = st.binary(min_size=768, max_size=768)


@given(IMAGES, PALETTES)
def test_others_read_the_places_and_the_palette(image: NDArray[np.uint8], palette: bytes) -> None:
    with Image.open(io.BytesIO(indexed_png(image, palette))) as read:
        read.verify()
    with Image.open(io.BytesIO(indexed_png(image, palette))) as read:
        assert read.mode == "P"
        np.testing.assert_array_equal(np.asarray(read), image)
        colors = np.frombuffer(palette, np.uint8).reshape(256, 3)
        np.testing.assert_array_equal(np.asarray(read.convert("RGB")), colors[image])


def test_a_smooth_picture_takes_a_fraction_of_its_pixels() -> None:
    image = np.add.outer(np.arange(128), np.arange(256)).astype(np.uint8)
    assert len(indexed_png(image, bytes(768))) < image.size / 20
