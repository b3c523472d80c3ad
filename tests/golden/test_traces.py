"""Each method against the trace that was reviewed when it was written."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.golden.regenerate import trace, trace_file
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES

CHOSEN = ("instance", "arm", "accepted")


@pytest.mark.parametrize("name", ALL_METHOD_NAMES)
def test_the_trace_is_the_reviewed_one(name: str) -> None:
    golden = json.loads(trace_file(name).read_text())
    made = trace(name)
    assert [[s[k] for k in CHOSEN] for s in made] == [[s[k] for k in CHOSEN] for s in golden]
    for a, b in zip(made, golden, strict=True):
        assert np.allclose(a["T_cam_obj"], b["T_cam_obj"], atol=1e-6)
        assert a["scores"].keys() == b["scores"].keys()
        assert all(abs(a["scores"][k] - b["scores"][k]) < 1e-6 for k in a["scores"])
