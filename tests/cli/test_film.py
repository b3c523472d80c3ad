"""``film``: a run told in pictures, as one picture or as an animation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from verefine_viz import cli
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS

SESSION = Path(__file__).resolve().parents[2] / "sessions" / "failure_score_prefers_flip.toml"


@pytest.mark.usefixtures("processes")
def test_a_strip_and_an_animation_of_the_same_moments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    png, gif = tmp_path / "run.png", tmp_path / "run.gif"
    for out in (png, gif):
        assert cli.main(["film", str(SESSION), "--out", str(out)]) == 0
    said = capsys.readouterr().out.splitlines()
    n = said.index(next(line for line in said if line.startswith(str(png)))) - 1  # Below the title a line for each.
    assert 4 <= n <= 6
    with Image.open(gif) as film:
        assert getattr(film, "n_frames", 1) == n
    with Image.open(png) as strip:
        colors = {tuple(color) for color in np.asarray(strip.convert("RGB")).reshape(-1, 3).tolist()}
    assert {CLASS_COLORS["explained"], STAGE_COLORS["best"], STAGE_COLORS["ground truth"]} <= colors


def test_a_file_that_is_no_film_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["film", str(SESSION), "--out", str(tmp_path / "run.jpg")]) == 2
    assert ".gif" in capsys.readouterr().err
