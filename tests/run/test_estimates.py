"""Initial poses by an estimator for single instances: whose they are, and names that nothing is called by."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import make
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators import registry
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox


class Estimator:
    """Finds one pose of everything."""

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        return (Hypothesis(transform(np.eye(3), [0, 0, 0.6]), 0.5, "ppf"),)


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Frame "7/3" with instances 0, 1 and 2."""
    for name in registry.ESTIMATORS:
        monkeypatch.setitem(registry.ESTIMATORS, name, lambda session: Estimator())
    return str(make(tmp_path).root)


def toolbox(dataset: str, *estimate: tuple[str, int, str], **scene: Any) -> Toolbox:
    return Toolbox(
        resolve(
            {
                "scene": {"source": "bop", "dataset": dataset, "model_points": 200, **scene},
                "hypotheses": {"estimate": estimate},
                "physics": {"enabled": False},
            }
        )
    )


def test_a_frame_is_the_same_however_it_is_written(dataset: str) -> None:
    for frame in ("7/3", "007/0003", " 7/3"):
        problem = toolbox(dataset, (frame, 1, "ppf")).problem("7/3")
        assert [i.hypotheses[0].source.split()[0] for i in problem.instances] == ["perturbed", "ppf", "perturbed"]


def test_what_is_not_there_is_named(dataset: str) -> None:
    for estimate, named in (
        ([("x", 1, "ppf")], "'x'"),
        ([("7/4", 1, "ppf")], "image 4"),
        ([("7/3", 9, "ppf")], "instance 9"),
        ([("7/3", 1, "ppf"), ("007/3", 1, "pcs")], "instance 1 of frame 7/3 twice"),
    ):
        with pytest.raises(VerefineError, match=f"^hypotheses.estimate.*{named}"):
            toolbox(dataset, *estimate).problem("7/3")
    session = resolve({"scene": {"demo": "mug"}, "hypotheses": {"estimate": [("0/7", 0, "ppf")]}})
    with pytest.raises(VerefineError, match=r"^hypotheses\.estimate.*'0/7'"):
        _ = Toolbox(session).frames


def test_an_instance_of_an_object_that_is_not_solved_now_is_no_mistake(dataset: str) -> None:
    problem = toolbox(dataset, ("7/3", 1, "ppf"), objects=[2]).problem("7/3")
    assert [i.instance_id for i in problem.instances] == [0, 2]
