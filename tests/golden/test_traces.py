"""Each method against the trace that was reviewed when it was written."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.golden.regenerate import FOLDER, trace
from verefine_viz.methods.registry import METHOD_NAMES


@pytest.mark.parametrize("name", METHOD_NAMES)
def test_the_trace_is_the_reviewed_one(name: str) -> None:
    golden = json.loads((FOLDER / f"duck_{name}.json").read_text())
    made = trace(name)
    assert [(s["arm"], s["accepted"]) for s in made] == [(s["arm"], s["accepted"]) for s in golden]
    for a, b in zip(made, golden, strict=True):
        assert np.allclose(a["T_cam_obj"], b["T_cam_obj"], atol=1e-6)
        assert a["scores"].keys() == b["scores"].keys()
        assert all(abs(a["scores"][k] - b["scores"][k]) < 1e-6 for k in a["scores"])
