"""Initial poses by an estimator for single instances: whose they are, and names that nothing is called by."""

from __future__ import annotations

import re
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


def test_what_is_not_there_is_one_clear_line(dataset: str) -> None:
    split = f"{Path(dataset).name}/test"
    for estimate, said in (
        ([("x", 1, "ppf")], 'frame \'x\' is not "scene/image", such as "50/1"'),
        ([("7/4", 1, "ppf")], f"unknown image 4 in scene 7 of {split}; available: 3"),
        ([("7/3", 9, "ppf")], "unknown instance 9; available: 0, 1, 2 (frame 7/3)"),
        ([("7/3", 1, "ppf"), ("007/3", 1, "pcs")], "names instance 1 of frame 7/3 twice; name it once"),
    ):
        with pytest.raises(VerefineError) as refused:
            toolbox(dataset, *estimate).problem("7/3")
        assert re.fullmatch(f"hypotheses.estimate:? {re.escape(said)}", str(refused.value))


def test_frames_of_a_built_in_scene_are_looked_at_too() -> None:
    session = resolve({"scene": {"demo": "mug"}, "hypotheses": {"estimate": [("0/7", 0, "ppf")]}})
    with pytest.raises(VerefineError) as refused:
        _ = Toolbox(session).frames
    assert str(refused.value) == "hypotheses.estimate: unknown frame '0/7'; available: 0/0 (demo scene 'mug')"


def test_an_instance_of_an_object_that_is_not_solved_now_is_no_mistake(dataset: str) -> None:
    problem = toolbox(dataset, ("7/3", 1, "ppf"), objects=[2]).problem("7/3")
    assert [i.instance_id for i in problem.instances] == [0, 2]
