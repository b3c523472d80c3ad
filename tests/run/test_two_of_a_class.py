"""Two instances of one class in a frame, solved by every method."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import make
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox


@pytest.mark.parametrize("method", ALL_METHOD_NAMES)
def test_two_instances_of_one_class_get_answers_of_their_own(method: str, tmp_path: Path) -> None:
    made = make(tmp_path)
    raw: dict[str, Any] = {
        "scene": {"source": "bop", "dataset": str(made.root), "model_points": 200, "cloud_points": 200},
        "hypotheses": {"max_per_object": 2},
        "method": {"name": method, "iterations": 1},
        "mcts": {"expansions": 2},
    }
    box = Toolbox(resolve(raw))
    problem = box.problem(made.frame)
    assert [i.obj_id for i in problem.instances] == [2, 5, 2]
    best = dict(zip((t.instance.instance_id for t in problem.targets), box.run(problem).finish().best, strict=True))
    for k, T_gt in enumerate(made.truth):
        T = best[k].T_cam_obj
        own, *others = (np.linalg.norm(T[:3, 3] - one[:3, 3]) for one in (T_gt, *made.truth[:k], *made.truth[k + 1 :]))
        assert own < min(others)
