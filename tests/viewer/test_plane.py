"""A wrong support plane is doubted, a right one is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import Session
from verefine_viz.diagnosis.data_doubts import plane_doubt
from verefine_viz.run.session_file import load_session, resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.panels.physics_panel import plane_warning
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.findings import findings

pytestmark = pytest.mark.usefixtures("long_run")

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"


def opened() -> Snapshot:
    return Debugger(Session(), None, FakeTools).view()


def test_walls_are_doubted_and_tables_are_not() -> None:
    """Shares of walls and of the right planes in real frames."""
    view = opened()
    assert view.target.observation.support is not None
    for share, is_doubted in ((0.37, True), (0.24, True), (0.432, False), (0.589, False)):
        support = replace(view.target.observation.support, inlier_share=share)
        assert bool(plane_doubt(support)) == is_doubted, share
        observation = replace(view.target.observation, support=support)
        seen = replace(view, target=replace(view.target, observation=observation))
        assert bool(plane_warning(seen)) == bool(findings(seen)) == is_doubted, share


def test_the_remedy_for_a_wrong_plane_is_one_that_was_not_taken() -> None:
    support = opened().target.observation.support
    assert support is not None
    doubted = replace(support, inlier_share=0.3, gravity_source="plane")
    assert "give scene.gravity" in plane_doubt(doubted)
    assert "choose a frame" in plane_doubt(replace(doubted, gravity_source="world"))


def doubts(session: Session) -> list[bool]:
    """Of every frame of a session."""
    tools = Toolbox(session)
    supports = [tools.source.problem(frame).observation.support for frame in tools.frames]
    return [support is None or bool(plane_doubt(support)) for support in supports]


def test_the_built_in_wrong_plane_is_doubted_and_tables_are_not() -> None:
    for name, is_doubted in (("clutter", False), ("failure_mask_leaks", False), ("failure_wrong_plane", True)):
        assert set(doubts(load_session(SESSIONS / f"{name}.toml"))) == {is_doubted}, name


def test_tables_of_real_frames_are_not_doubted(shared_data: Path) -> None:
    scene = {"source": "bop", "dataset": str(shared_data / "ycbv"), "frames": []}
    assert doubts(resolve({"scene": scene, "hypotheses": {"source": "perturb"}})) == [False] * 8
