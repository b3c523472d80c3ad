"""Where the data of a frame do not fit together, each diagnosis says so beside its cause."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.calibration.sizes import scene, written
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, SceneSettings, Session
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_models import demo_obj_id

DOUBT = "Look at the data first: objects appear"


@pytest.mark.parametrize("focal", [1.0, 0.75])
def test_a_wrong_focal_length_is_reported_beside_the_cause(tmp_path: Path, focal: float) -> None:
    folder = written(tmp_path / "clutter", [scene()], focal)
    toolbox = Toolbox(
        Session(
            scene=SceneSettings(source="bop", dataset=str(folder), objects=(demo_obj_id("can"),)),
            hypotheses=HypothesesSettings(max_per_object=1, rotation_deg=90, translation_mm=60),
            method=MethodSettings(name="rir", iterations=2),
        )
    )
    run = toolbox.run(toolbox.problem("0/0"))
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, threshold=1e-3)
    assert (DOUBT in diagnosis.main.text) == (focal != 1)
    if focal != 1:
        assert "fx and fy of cam_K look too small, about 1.3" in diagnosis.main.text
        assert diagnosis.main.text.endswith(".")
