"""Initial poses from point pair features: right on synthetic views, repeatable, distinct, few where few exist."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.estimators.views import CAMERA, bits, random_pose, target_of, view
from tests.progress import asked, cancelled_everywhere
from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Target
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.estimators.ppf import Ppf
from verefine_viz.estimators.registry import ESTIMATORS, make_estimator
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.evaluation.rotation_errors import rotation_error_deg
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_models import demo_model

pytestmark = pytest.mark.usefixtures("long_run")

ROOT = Path(__file__).resolve().parents[2]
QUARTER_TURN = transform(axis_angle([0, 0, 1], -np.pi / 2), [0, 0, 0])
"""What ``np.rot90`` does to the scene: the image turns counter-clockwise, which is about −z as y points down."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tables")


@pytest.fixture(scope="module")
def ppf(folder: Path) -> Ppf:
    return Ppf(PpfSettings(), folder)


def seen(name: str, seed: int) -> Target:
    model = demo_model(name, 500, 0)
    return view(model, random_pose(seed, model), seed=seed)


@pytest.mark.parametrize("name", ["duck", "teddy", "jug", "bracket"])
def test_one_of_five_poses_is_near_the_truth(ppf: Ppf, name: str) -> None:
    for seed in range(3):
        target = seen(name, seed)
        errors = [
            pose_errors(target.model, h.T_cam_obj, target.instance.T_cam_obj_gt) for h in ppf.hypotheses(target, 5)
        ]
        assert min(e.relative for e in errors) < 0.1, seed
        assert min(e.rotation_deg for e in errors) < 15, seed


def test_the_pose_turns_with_the_image(ppf: Ppf) -> None:
    target = seen("duck", 1)
    depth = np.rot90(target.observation.depth_m).astype(np.float64)
    turned = ppf.hypotheses(target_of(target.model, depth, np.rot90(target.instance.mask)), 1)[0].T_cam_obj
    straight = ppf.hypotheses(target, 1)[0].T_cam_obj
    assert pose_errors(target.model, turned, QUARTER_TURN @ straight).relative < 0.03


def test_the_pose_moves_with_the_object(ppf: Ppf) -> None:
    model = demo_model("teddy", 500, 0)
    T = random_pose(0, model)
    motion = transform(axis_angle([1, 2, 0], np.deg2rad(15)), [0, 0, 0])
    there = motion @ T
    there[:3, 3] = T[:3, 3] + [0.02, -0.01, 0.1]
    first, second = (ppf.hypotheses(view(model, pose), 1)[0].T_cam_obj for pose in (T, there))
    change = second @ np.linalg.inv(first)
    assert np.rad2deg(np.arccos((np.trace(change[:3, :3].T @ motion[:3, :3]) - 1) / 2)) < 6
    assert np.linalg.norm(second[:3, 3] - first[:3, 3] - [0.02, -0.01, 0.1]) < 0.06 * model.diameter_m


def test_no_two_hypotheses_look_the_same(ppf: Ppf) -> None:
    for name in ("block", "can", "bracket"):
        target = seen(name, 2)
        pool = ppf.hypotheses(target, 8)
        assert len(pool) >= 2, name
        for i, a in enumerate(pool):
            for b in pool[:i]:
                near = np.linalg.norm(a.T_cam_obj[:3, 3] - b.T_cam_obj[:3, 3]) < 0.1 * target.model.diameter_m
                assert not (near and rotation_error_deg(target.model, a.T_cam_obj, b.T_cam_obj) < 17.9), name


def test_no_more_are_given_than_were_asked_for_the_most_confident_first(ppf: Ppf) -> None:
    target = seen("bracket", 0)
    for n in (1, 3):
        assert bits(ppf.hypotheses(target, n)) == bits(ppf.hypotheses(target, 8))[:n], n
        assert len(ppf.hypotheses(target, n)) == n, n
    pool = ppf.hypotheses(seen("jug", 3), 5)
    confidences = [h.confidence for h in pool]
    assert confidences == sorted(confidences, reverse=True)
    assert 0 < confidences[-1] <= confidences[0] <= 1
    assert [h.source for h in pool] == [f"ppf #{k}" for k in range(1, len(pool) + 1)]


def test_a_leaking_mask_does_no_harm(ppf: Ppf) -> None:
    target = seen("jug", 1)
    T_gt = target.instance.T_cam_obj_gt
    mask = np.logical_or.reduce([np.roll(target.instance.mask, s, a) for a in (0, 1) for s in range(-8, 9)])
    leaking = target_of(target.model, target.observation.depth_m.astype(np.float64), mask)
    assert min(pose_errors(target.model, h.T_cam_obj, T_gt).relative for h in ppf.hypotheses(leaking, 5)) < 0.1


def _without(target: Target, what: str) -> Target:
    depth, mask = target.observation.depth_m.astype(np.float64), target.instance.mask.copy()
    if what == "mask":
        mask[:] = False
    elif what == "depth":
        depth = np.where(mask, 0.0, depth)
    else:
        v, u = np.argwhere(mask)[mask.sum() // 2]
        mask[:] = False
        mask[v : v + 2, u : u + 2] = True
    return target_of(target.model, depth, mask)


def test_a_segment_that_says_nothing_gives_no_hypothesis(ppf: Ppf) -> None:
    target = seen("duck", 0)
    assert ppf.hypotheses(target, 5)
    for what in ("mask", "depth", "all but four pixels"):
        assert ppf.hypotheses(_without(target, what), 5) == (), what


def test_the_answer_depends_on_the_arguments_only(ppf: Ppf, folder: Path) -> None:
    target = seen("teddy", 2)
    first = bits(ppf.hypotheses(target, 5))
    ppf.hypotheses(seen("bracket", 1), 5)
    assert bits(ppf.hypotheses(target, 5)) == first
    assert bits(Ppf(PpfSettings(), folder / "another").hypotheses(target, 5)) == first


def test_what_is_cancelled_on_the_way_leaves_nothing_behind(ppf: Ppf) -> None:
    target = seen("bracket", 2)
    first = bits(ppf.hypotheses(target, 5))

    def work(progress: ProgressToken) -> object:
        return ppf.hypotheses(target, 5, progress)

    n = asked(work)
    assert n > 10
    for _ in cancelled_everywhere(work, n):
        assert bits(ppf.hypotheses(target, 5)) == first


def test_another_process_with_other_threads_loads_the_table_and_answers_alike(ppf: Ppf, folder: Path) -> None:
    first = bits(ppf.hypotheses(seen("duck", 0), 5))
    code = (
        "import sys\nfrom pathlib import Path\nfrom tests.estimators import test_ppf as t\n"
        "from tests.progress import hearing\n"
        f"said = []\nppf = t.Ppf(t.PpfSettings(), Path({str(folder)!r}))\n"
        "pool = ppf.hypotheses(t.seen('duck', 0), 5, hearing(said))\n"
        "print(([words for words in said if 'Learning' in words], t.bits(pool)))"
    )
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.stdout.strip() == repr(([], first)), done.stderr


def test_the_registry_hands_on_the_sessions_settings_and_refuses_other_names() -> None:
    estimator = make_estimator("ppf", Session(ppf=PpfSettings(step=0.08)))
    assert isinstance(estimator, Ppf)
    assert estimator.settings == PpfSettings(step=0.08)
    with pytest.raises(SettingsError, match=rf"^unknown estimator 'icp'; available: {', '.join(ESTIMATORS)}$"):
        make_estimator("icp", Session())


def test_objects_of_a_real_frame_are_found(ppf: Ppf, shared_data: Path) -> None:
    scene = {"source": "bop", "dataset": str(shared_data / "ycbv"), "frames": ["50/1"], "objects": [2, 5, 10]}
    problem = Toolbox(resolve({"scene": scene, "hypotheses": {"source": "perturb"}})).problem("50/1")
    for target in problem.targets:
        T_gt = target.instance.T_cam_obj_gt
        found = [pose_errors(target.model, h.T_cam_obj, T_gt).adds_mm for h in ppf.hypotheses(target, 5)]
        assert min(found) < 100 * target.model.diameter_m, target.model.name


def test_the_camera_of_these_tests_may_be_turned() -> None:
    assert CAMERA.width == CAMERA.height == 2 * CAMERA.cx + 1 == 2 * CAMERA.cy + 1
    assert CAMERA.fx == CAMERA.fy
