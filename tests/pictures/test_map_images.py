"""Score maps have the colours of their scales."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from verefine_viz.core.palette import (
    ANGLE,
    CORRELATION,
    CUBE_PALETTE,
    FIT,
    Scale,
    cube_indices,
    depth_scale,
    difference_scale,
    rgb,
)
from verefine_viz.pictures.map_images import scaled_indices

SCALES = (ANGLE, FIT, depth_scale(0.31, 0.94), difference_scale(0.02), CORRELATION)


@pytest.mark.parametrize("scale", SCALES)
@given(st.data())
def test_compiled_they_are_the_same(scale: Scale, data: st.DataObject) -> None:
    reach = scale.high - scale.low
    ends = [float(np.float32(end)) for end in (scale.low - reach, scale.high + reach)]
    some = st.floats(*ends, width=32) | st.sampled_from([np.nan, np.inf, -np.inf])
    values = data.draw(arrays(np.float32, (3, 4), elements=some))
    assert np.array_equal(scaled_indices(values, 1.0, scale.low, scale.high), scale.shades(values.astype(np.float64)))


@given(arrays(np.uint8, (3, 4, 3)))
def test_a_colour_becomes_the_nearest_of_the_palette_and_never_that_of_no_value(image: np.ndarray) -> None:
    indices = cube_indices(image)
    assert (indices > 0).all()
    # Half a step of the coarsest channel.
    assert np.abs(rgb(indices, CUBE_PALETTE).astype(int) - image).max() <= 26
