"""Run-length masks: both encodings against pycocotools, damage refused before it can do harm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as coco

from tests.scenes.bop_folder import run_lengths
from verefine_viz.core.errors import InputError
from verefine_viz.scenes.detections import decode_rle

masks = hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40))


@settings(max_examples=150, deadline=None)
@given(masks)
def test_both_encodings_are_inverted(mask: np.ndarray) -> None:
    shape = (mask.shape[0], mask.shape[1])
    as_list = {"size": list(shape), "counts": run_lengths(mask)}
    code: Any = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    as_string = {"size": list(shape), "counts": code["counts"].decode("ascii")}
    np.testing.assert_array_equal(decode_rle(as_list, shape, "here"), mask)
    np.testing.assert_array_equal(decode_rle(as_string, shape, "here"), mask)


def test_long_runs_of_a_whole_image() -> None:
    mask = np.zeros((480, 640), bool)
    mask[100:300, 200:500] = True
    code: Any = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    back = decode_rle({"size": [480, 640], "counts": code["counts"].decode("ascii")}, (480, 640), "here")
    np.testing.assert_array_equal(back, mask)


@settings(max_examples=150, deadline=None)
@given(st.text(st.characters(min_codepoint=32, max_codepoint=200), max_size=12))
def test_any_other_string_is_refused_or_a_whole_mask(text: str) -> None:
    segmentation = {"size": [4, 5], "counts": text}
    try:
        mask = decode_rle(segmentation, (4, 5), "entry 3")
    except InputError:
        with pytest.raises(InputError, match="entry 3: the mask's run lengths are damaged, expected a sum of 20"):
            decode_rle(segmentation, (4, 5), "entry 3")
        return
    # What is not refused was whole: it says something about every pixel.
    again: Any = coco.decode({"size": [4, 5], "counts": text.encode("ascii")})
    np.testing.assert_array_equal(mask, again.astype(bool))


def refused(segmentation: Any, shape: tuple[int, int] = (4, 5)) -> str:
    with pytest.raises(InputError) as caught:
        decode_rle(segmentation, shape, "here")
    return str(caught.value)


def test_run_lengths_that_do_not_fill_the_image_are_refused() -> None:
    for counts in ([9, 2, 8], [9, 2, 10], [], [-1, 2, 19], [9.0, 11], ["20"], None, {"a": 1}, True):
        assert "run lengths are damaged" in refused({"size": [4, 5], "counts": counts}), counts


def test_other_segmentations_are_refused() -> None:
    assert "no polygons" in refused([[1, 2, 3, 4]])
    assert "needs 'counts' and 'size'" in refused({"counts": [20]})
    for size in ([5, 4], "4x5"):
        assert "made for" in refused({"size": size, "counts": [20]})


def run_string(runs: list[int]) -> str:
    """COCO's compressed string of run lengths, also of impossible ones."""
    text = ""
    for k, run in enumerate(runs):
        value, is_more = run - (runs[k - 2] if k > 2 else 0), True
        while is_more:
            bits, value = value & 0x1F, value >> 5
            is_more = value != (-1 if bits & 0x10 else 0)
            text += chr((bits | 0x20 * is_more) + 48)
    return text


@pytest.mark.parametrize("write", [run_string, list], ids=["string", "list"])
def test_negative_runs_are_refused(write: Any) -> None:
    for runs in ([10, -4, 6], [-3, 15], [4, 20, -12], [0, 30, -20, 2]):
        assert sum(runs) == 12
        said = refused({"size": [3, 4], "counts": write(runs)}, (3, 4))
        assert "run lengths are damaged, expected a sum of 12 pixels, none below 0" in said


def test_a_size_that_is_none_is_reported_in_short() -> None:
    assert len(refused({"size": [3] * 10_000, "counts": [12]}, (3, 4))) < 200
