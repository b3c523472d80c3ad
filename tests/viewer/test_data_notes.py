"""A frame whose camera does not look right says so when it is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scenes.sizes import scene, written
from verefine_viz.core.settings import HypothesesSettings, SceneSettings, Session
from verefine_viz.session.toolbox import Toolbox
from verefine_viz.viewer.workspace import Workspace


@pytest.mark.parametrize(("focal", "noted"), [(1.0, 0), (0.9, 1)])
def test_an_opened_frame_carries_it_as_a_note(tmp_path: Path, focal: float, noted: int) -> None:
    folder = written(tmp_path / "clutter", [scene()], focal)
    opened = Session(
        scene=SceneSettings(source="bop", dataset=str(folder)), hypotheses=HypothesesSettings(source="perturb")
    )
    problem = Workspace(opened, None, Toolbox).work.problem
    notes = [note for note in problem.notes if "objects appear" in note]
    assert len(notes) == noted
    for note in notes:
        assert note.startswith("objects appear 11% larger than their models in their true poses and lie farther from ")
        assert note.endswith("about 1.11 times as much would fit; check that cam_K belongs to images of this size")
