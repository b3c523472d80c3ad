"""The Bandit tab says of what μ is the mean: with vf_depth of scores of several objects together."""

from __future__ import annotations

from typing import Any

import pytest

from tests.viewer.test_read_changes import FORK, Clustered
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.drawing.bandit_tables import arms_table

OF_SCENE = "μ_j, mean over the plays, not of this object alone as “best” is."


def table(*commands: c.Command, frame: str = "0/2", **method: Any) -> str:
    d = Debugger(Session(method=MethodSettings(**{"name": "vf_depth", "iterations": 2} | method)), None, Clustered)
    return arms_table(d.carry_out([c.OpenFrame(frame), *commands]).view())


def test_of_scenes_it_says_whose_score_counts() -> None:
    html = table(c.RunUntil("end"))
    assert OF_SCENE in html
    assert "Each pass counts for the hypotheses it chose: the score of all objects together at its poses." in html
    assert "The first play counts that score with this initial pose and the best initial poses of the others." in html


@pytest.mark.parametrize(
    ("method", "tip"),
    [
        ({"scene_prior": "object"}, "the score of the object&#x27;s initial pose"),
        ({"scene_reward": "best_known"}, "together at the best pose of each object so far."),
    ],
)
def test_settings_of_the_reward_are_reported(method: dict[str, str], tip: str) -> None:
    html = table(c.Step(), **method)
    assert tip in html


def test_a_method_that_took_over_says_what_was_counted_before() -> None:
    html = table(c.RunTo(2), FORK, name="rir")
    assert "Plays before vf_depth took over count the object&#x27;s own score." in html


@pytest.mark.parametrize(("name", "frame"), [("rir", "0/2"), ("vf_depth", "0/1")])
def test_of_one_object_it_is_of_its_own_scores(name: str, frame: str) -> None:
    html = table(c.RunUntil("end"), name=name, frame=frame)
    assert "μ_j, mean over the plays: the score of the initial pose" in html
    assert OF_SCENE not in html
