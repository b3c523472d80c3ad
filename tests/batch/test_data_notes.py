"""A batch says beside its frames where a wrong camera may be behind wrong answers."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenes.sizes import scene, written
from verefine_viz.batch.frame import explain_frame
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, RecordingSettings, SceneSettings, Session
from verefine_viz.session.toolbox import Toolbox


@pytest.mark.parametrize(
    ("focal", "translation_mm", "noted"),
    [(1.0, 60.0, False), (0.75, 60.0, True), (0.75, 0.0, False)],
)
def test_a_wrong_focal_length_is_noted_where_answers_are_wrong(
    tmp_path: Path, focal: float, translation_mm: float, noted: bool
) -> None:
    folder = written(tmp_path / "clutter", [scene()], focal)
    unmoved = MethodSettings(name="refine", refiner="identity", iterations=1)
    disturbed = HypothesesSettings(max_per_object=1, rotation_deg=0.0, translation_mm=translation_mm)
    session = Session(
        scene=SceneSettings(source="bop", dataset=str(folder)),
        hypotheses=disturbed,
        method=unmoved,
        recording=RecordingSettings(keep="none"),
    )
    result = explain_frame(Toolbox(session), "0/0", tmp_path)
    assert any(row.cause for row in result.objects) == (translation_mm > 0)
    assert any("fx and fy of cam_K look too small" in note for note in result.notes) == noted
