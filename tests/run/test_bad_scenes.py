"""Scenes in which something is missing or contradicts itself: one line says what, the other objects are solved."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.scenes.bop_folder import OBJ_IDS, Made, make
from verefine_viz.core.problem import Problem
from verefine_viz.methods.registry import ALL_METHOD_NAMES
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

SCENE_METHODS = ("rir", "vf_breadth", "vf_depth", "physim_mcts")


def _solved(made: Made, method: str, **sections: dict[str, Any]) -> tuple[Problem, dict[int, np.ndarray | None]]:
    raw: dict[str, Any] = {
        "scene": {"source": "bop", "dataset": str(made.root), "model_points": 200, "cloud_points": 200},
        "hypotheses": {"max_per_object": 2},
        "method": {"name": method, "iterations": 1},
        "mcts": {"expansions": 2},
    }
    box = Toolbox(resolve(raw | sections))
    problem = box.problem(made.frame)
    best = box.run(problem).finish().best
    ids = [t.instance.instance_id for t in problem.targets]
    return problem, {i: None if b is None else b.T_cam_obj for i, b in zip(ids, best, strict=True)}


def _without_a_mask_file(made: Made) -> None:
    (made.scene / "mask_visib" / "000003_000001.png").unlink()


def _with_an_empty_mask(made: Made) -> None:
    Image.fromarray(np.zeros((60, 80), np.uint8)).save(made.scene / "mask_visib" / "000003_000001.png")


def _flat_model(made: Made) -> None:
    flat = made.root / "models" / "obj_000005.ply"
    flat.write_text(re.sub(r"(?m)^(-?[\d.]+) (-?[\d.]+) -?[\d.]+$", r"\1 \2 0", flat.read_text()))


def _no_depth(made: Made) -> None:
    path = made.scene / "depth" / "000003.png"
    depth, mask = np.array(Image.open(path)), np.array(Image.open(made.scene / "mask_visib" / "000003_000001.png"))
    depth[mask > 0] = 0
    Image.fromarray(depth).save(path)


SPOILT: dict[str, tuple[Callable[[Made], None], str]] = {
    "no mask file": (_without_a_mask_file, r"obj_000005 \(#1\) is left out.*mask"),
    "empty mask": (_with_an_empty_mask, r"obj_000005 \(#1\).*mask"),
    "no depth in the mask": (_no_depth, r"obj_000005 \(#1\).*depth"),
    "no solid": (_flat_model, r"object 5 is left out"),
}


@pytest.mark.usefixtures("long_run")
@pytest.mark.parametrize(("method", "case"), zip(SCENE_METHODS, SPOILT, strict=True))
def test_one_spoilt_object_is_said_and_the_two_others_are_solved(method: str, case: str, tmp_path: Path) -> None:
    spoil, said = SPOILT[case]
    made = make(tmp_path)
    spoil(made)
    problem, found = _solved(made, method)
    assert [note for note in problem.notes if re.search(said, note)], problem.notes
    assert found[0] is not None
    assert found[2] is not None


@pytest.mark.parametrize("method", ALL_METHOD_NAMES)
def test_two_instances_of_one_class_get_answers_of_their_own(method: str, tmp_path: Path) -> None:
    made = make(tmp_path)
    problem, found = _solved(made, method)
    assert [i.obj_id for i in problem.instances] == [2, 5, 2]
    for k, T_gt in enumerate(made.truth):
        T = found[k]
        own, *others = (np.linalg.norm(T[:3, 3] - one[:3, 3]) for one in (T_gt, *made.truth[:k], *made.truth[k + 1 :]))
        assert own < min(others)


@pytest.mark.parametrize(
    ("method", "order", "said"),
    [
        ("rir", [["#0", "#1", "#0"]], r"the given order names obj_000002 \(#0\) twice; its first place counts"),
        ("vf_breadth", [[999], [5]], "given order: unknown object 999; available: 2, 5; it is ignored"),
        ("vf_depth", [["#1", "#77"]], "given order: unknown instance '#77'; available: #0, #1, #2; it is ignored"),
        ("physim_mcts", [["#1", "#77"]], "given order: unknown instance '#77'; available: #0, #1, #2; it is ignored"),
    ],
)
def test_a_bad_given_order_is_said_and_everything_is_solved(
    method: str, order: list[list[int | str]], said: str, tmp_path: Path
) -> None:
    problem, found = _solved(make(tmp_path), method, dependency={"order": order})
    assert [note for note in problem.notes if re.search(said, note)], problem.notes
    assert sorted(i for cluster in problem.clusters for i in cluster) == [0, 1, 2]
    assert all(T is not None for T in found.values())


@pytest.mark.parametrize("method", SCENE_METHODS)
def test_an_object_without_initial_poses_has_no_answer_and_the_others_do(method: str, tmp_path: Path) -> None:
    made = make(tmp_path)
    results = tmp_path / "estimator.csv"
    rows = []
    for obj_id, T in zip(OBJ_IDS[::2], made.truth[::2], strict=True):
        R, t_mm = " ".join(map(str, T[:3, :3].ravel())), " ".join(map(str, 1e3 * T[:3, 3]))
        rows.append(f"7,3,{obj_id},1.0,{R},{t_mm},-1")
    results.write_text("scene_id,im_id,obj_id,score,R,t,time\n" + "\n".join(rows))
    _, found = _solved(made, method, hypotheses={"source": "results", "files": [str(results)]})
    assert found[1] is None
    assert found[0] is not None
    assert found[2] is not None
