"""MATLAB files, against SciPy's writer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from verefine_viz.core.errors import InputError
from verefine_viz.scenes.mat_file import mat_arrays


def test_arrays_come_back_as_they_were_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    dtypes = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    arrays = {f"a{k}_{'long' * (k % 9)}": rng.normal(0, 50, (k, 3, 2)).astype(d) for k, d in enumerate(dtypes)}
    arrays |= {"one": np.ones((1, 1), np.uint8), "row": np.arange(5.0)[None], "words": np.array(["a", "b"])}
    for is_packed in (False, True):
        path = tmp_path / f"{is_packed}.mat"
        scipy.io.savemat(path, arrays, do_compression=is_packed)
        numbers = [name for name in arrays if name != "words"]
        read = mat_arrays(path, *numbers, "missing")
        assert sorted(read) == sorted(numbers)
        for name in numbers:
            np.testing.assert_array_equal(read[name], arrays[name], err_msg=f"{name}, packed: {is_packed}")


def test_what_holds_no_real_numbers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"a": np.array([[1j, 2]]), "b": np.array(["x"]), "c": {"d": 1.0}})
    for name in "abc":
        with pytest.raises(InputError, match=f"'{name}' holds no real numbers"):
            mat_arrays(path, name)
