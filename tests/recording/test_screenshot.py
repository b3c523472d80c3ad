from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.recording.runs import recorded_run, session
from tests.recording.screenshots import screenshots
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS


@pytest.mark.usefixtures("processes")
def test_the_viewer_shows_the_recording(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session())
    try:
        first, last = screenshots(tmp_path / "run.rrd", (1, 30), tmp_path / "pictures")
    except UnavailableError as error:
        pytest.skip(str(error))
    pixels = np.asarray(Image.open(first).convert("RGB"))
    assert pixels.shape[:2] == (1000, 1600)
    # The fitting pixels of the class map, and the curve of the best score.
    for color in (CLASS_COLORS["explained"], STAGE_COLORS["best"]):
        near = np.abs(pixels.astype(int) - color).max(axis=-1) < 25
        assert near.sum() > 100
    assert (pixels != np.asarray(Image.open(last).convert("RGB"))).any()
