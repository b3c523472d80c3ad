"""Run-length masks: both encodings against pycocotools, damage refused before it can do harm."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as coco

from tests.scenes.bop_folder import run_lengths
from verefine_viz.scenes.detections import RunLengths, decode_rle

masks = hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40))


@settings(max_examples=150, deadline=None)
@given(masks)
def test_both_encodings_are_inverted(mask: np.ndarray) -> None:
    shape = (mask.shape[0], mask.shape[1])
    as_list = RunLengths(shape, run_lengths(mask))
    code: Any = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    as_string = RunLengths(shape, code["counts"].decode("ascii"))
    np.testing.assert_array_equal(decode_rle(as_list, shape), mask)
    np.testing.assert_array_equal(decode_rle(as_string, shape), mask)


@settings(max_examples=150, deadline=None)
@given(st.text(st.characters(min_codepoint=32, max_codepoint=200), max_size=12))
def test_any_other_string_is_refused_or_a_whole_mask(text: str) -> None:
    try:
        mask = decode_rle(RunLengths((4, 5), text), (4, 5))
    except ValueError:
        return
    # What is not refused was whole: it says something about every pixel.
    again: Any = coco.decode({"size": [4, 5], "counts": text.encode("ascii")})
    np.testing.assert_array_equal(mask, again.astype(bool))
