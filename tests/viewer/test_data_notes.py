"""A frame whose camera does not look right says so above all else when it is opened."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.calibration.sizes import WithoutTruth, scene, written
from tests.fakes import box_problem
from tests.made_runs import answer
from tests.run.kept_frames import box_mesh, found, kept
from tests.viewer.fake_tools import FakeTools
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, SceneSettings, Session
from verefine_viz.run.record import DATA_FIRST
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.verdict_panel import why_html
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.text.findings import findings
from verefine_viz.viewer.text.verdict import DATA_DOUBTED, verdict

SESSION = Session(method=MethodSettings(iterations=2))


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("focal", "noted"), [(1.0, 0), (0.9, 1)])
def test_an_opened_frame_says_so_first_and_in_red(tmp_path: Path, focal: float, noted: int) -> None:
    folder = written(tmp_path / "clutter", [scene()], focal)
    opened = Session(
        scene=SceneSettings(source="bop", dataset=str(folder)), hypotheses=HypothesesSettings(source="perturb")
    )
    view = Debugger(opened, None, Toolbox).view(deep=False)
    found = [one for one in findings(view) if "objects appear" in one.text]
    assert len(found) == noted
    for one in found:
        assert "objects appear 11% larger" in one.text
        assert "check that cam_K" in one.text
        assert findings(view)[0] == one
        assert one.red


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("depth", "noted"), [(1.0, 0), (0.8, 1)])
def test_without_ground_truth_initial_poses_show_a_wrong_depth_scale_before_the_run_and_after(
    tmp_path: Path, depth: float, noted: int
) -> None:
    session = Session(
        scene=SceneSettings(source="bop", dataset=str(written(tmp_path / "clutter", [scene()], depth=depth))),
        hypotheses=HypothesesSettings(max_per_object=1, rotation_deg=15, translation_mm=15),
        method=MethodSettings(name="refine", refiner="identity", iterations=1),
    )
    debugger = Debugger(session, None, WithoutTruth)
    for _ in range(2):
        first = findings(debugger.view(deep=False))[:1]
        assert bool(first and "check depth_scale in scene_camera.json (about 1.2" in first[0].text) == bool(noted)
        debugger.carry_out([c.RunUntil("end")])


def test_an_object_whose_rows_another_one_took_says_so(tmp_path: Path) -> None:
    problem = box_problem(n_instances=2)
    posed, bare = (found(problem, box_mesh(tmp_path / "box.stl"), k) for k in range(2))
    kept(tmp_path / "kept", problem, [posed, replace(bare, poses={})])
    view = Debugger(load_session(tmp_path / "kept" / "session.toml"), None, Toolbox).carry_out([c.Focus(1)]).view()
    (said,) = [one.text for one in findings(view) if "no hypothesis" in one.text]
    assert "all 3 rows for object 1 of this frame in net went to #0" in said


def test_evidence_of_a_batch_does_not_say_it_a_second_time(tmp_path: Path) -> None:
    row = answer(scene_id=0, im_id=1, instance_id=0, obj_id=1, name="box", status="ok", has_truth=True, add_s_mm=50.0,
        diameter_mm=100.0, cause="score", evidence=f"The score misleads. {DATA_FIRST} objects appear larger: check.",
    )  # fmt: skip
    batch = Gallery([BatchIndex(tmp_path, SESSION, BatchInfo(), (row,))])
    view = Debugger(SESSION, None, FakeTools, batch=batch).carry_out([batch.opens(batch.entries[0])]).view()
    (first,) = [one for one in findings(view) if "objects appear larger" in one.text]
    assert first == findings(view)[0], "the frame itself says nothing of it"
    assert first.text == "Look at the data first: objects appear larger: check."
    doubted = replace(view, doubts=("objects appear larger: check",))
    assert sum("objects appear larger" in one.text for one in findings(doubted)) == 1
    assert any("The score misleads." in one.text for one in findings(doubted))
    why = why_html(doubted, verdict(doubted), findings(doubted))
    assert why.count('class="bad"') == 2
    assert why.index("objects appear larger") < why.index("The score misleads.")
    assert verdict(doubted).cause == DATA_DOUBTED


def test_an_answer_without_ground_truth_is_opened_with_what_the_batch_found(tmp_path: Path) -> None:
    row = answer(scene_id=0, im_id=1, instance_id=0, obj_id=1, name="box", status="ok", score=0.6, best_iteration=1,
        evidence=f"{DATA_FIRST} refinement moved the objects: check cam_K.",
    )  # fmt: skip
    batch = Gallery([BatchIndex(tmp_path, SESSION, BatchInfo(), (row,))])
    view = Debugger(SESSION, None, FakeTools, batch=batch).carry_out([batch.opens(batch.entries[0])]).view()
    assert not view.doubts, "the run is not over, and a single object tells nothing"
    first = findings(view)[0]
    assert (first.text, first.red) == (row.evidence, True)
