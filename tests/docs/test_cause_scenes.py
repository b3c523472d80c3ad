"""The commands with options in docs/causes.md, and the frames that its pictures are of, show their causes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from scripts.cause_scenes import SCENES, commands, session_of
from verefine_viz.core.causes import Cause
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.diagnosis.impossible import impossible_answers
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes import demo


@pytest.fixture(autouse=True)
def _own_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spoilt scenes are not left among the built-in ones: other tests go through all of those."""
    monkeypatch.setattr(demo, "_ALL", dict(demo._ALL))


def causes_in(cause: Cause, folder: Path) -> set[Cause]:
    """The main causes in the frame that is made for one."""
    tools = Toolbox(session_of(cause, folder))
    run = tools.run(tools.problem(tools.frames[0]))
    answers = [best and best.T_cam_obj for best in run.finish().best]
    check = partial(plausibility, settings=tools.session.physics, surface_of=Surfaces())
    impossible = impossible_answers(run.problem, answers, check, heights=None)
    return {one.main.cause for one in diagnose(run, tools)} | {finding.cause for finding in impossible.values()}


@pytest.mark.usefixtures("long_run", "processes")
@pytest.mark.parametrize("cause", [*SCENES, *(cause for cause in commands() if cause != Cause.UNDECIDED)])
def test_what_is_spoilt_shows_its_cause(cause: Cause, tmp_path: Path) -> None:
    """But for what lies between two basins: on which side it comes to rest may differ from processor to processor."""
    assert cause in causes_in(cause, tmp_path)
