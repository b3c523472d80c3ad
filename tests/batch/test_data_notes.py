"""A batch says beside its frames where a wrong camera may be behind wrong answers."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.calibration.sizes import WithoutTruth, scene, written
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo, Runs
from verefine_viz.batch.solve_frame import explain_frame
from verefine_viz.batch.totals import Totals
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, RecordingSettings, SceneSettings, Session
from verefine_viz.page.gallery import Gallery
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")


@pytest.mark.parametrize(
    ("focal", "translation_mm", "noted"), [(1.0, 60.0, False), (0.75, 60.0, True), (0.75, 0.0, False)]
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
    result = explain_frame(Toolbox(session), "0/0", tmp_path).end
    assert any(row.cause for row in result.answers) == (translation_mm > 0)
    assert any("fx and fy of cam_K look too small" in doubt for doubt in result.doubts) == noted


@pytest.mark.parametrize(("depth", "in_doubt"), [(1.0, 0), (0.8, 1)])
def test_without_ground_truth_every_answer_of_the_frame_says_so(tmp_path: Path, depth: float, in_doubt: int) -> None:
    folder = written(tmp_path / "clutter", [scene()], depth=depth)
    session = Session(
        scene=SceneSettings(source="bop", dataset=str(folder)),
        hypotheses=HypothesesSettings(max_per_object=2, rotation_deg=15, translation_mm=15),
        method=MethodSettings(name="rir", iterations=2),
        recording=RecordingSettings(keep="none"),
    )
    result = explain_frame(WithoutTruth(session), "0/0", tmp_path).end
    assert len(result.doubts) == in_doubt
    assert all(row.evidence.startswith(DATA_FIRST) == bool(in_doubt) for row in result.answers)
    totals = Totals()
    # A batch that goes on later still knows.
    (record,) = totals.passing(Runs(tmp_path / "runs").records(["0/0"]))
    assert record.end.doubts == result.doubts
    rows = record.end.answers
    said = totals.as_json(1)["data_in_doubt"]
    assert said.startswith(f"{DATA_FIRST} in frame 0/0, ") == bool(in_doubt)
    assert Gallery([BatchIndex(tmp_path, session, BatchInfo(), rows)]).doubt.startswith(DATA_FIRST) == bool(in_doubt)
