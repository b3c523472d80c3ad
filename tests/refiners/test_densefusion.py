"""DenseFusion's pool and refiner with networks made by hand: they need neither torch nor trained weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from tests.learned.test_densefusion_steps import OFFSET, QUAT, coloured_target
from tests.learned.tiny_network import pose_network, refine_network
from tests.recording.runs import ending
from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.settings import Session
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.pictures.refiner_crops import step_picture
from verefine_viz.recording.verify import first_difference, verify
from verefine_viz.refiners.registry import WEIGHTS, make_refiner
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.session_file import resolve
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.toolbox import Toolbox

TARGET = coloured_target()
START = TARGET.instance.hypotheses[0].T_cam_obj
SMALL_TURN = np.array([1.0, 0.02, -0.03, 0.01])
TOWARDS = np.array([3.0, -2.0, 1.0])


def settings(folder: Path, classes: tuple[int, ...] = (1,), **more: Any) -> dict[str, Any]:
    """Of hand-made weights, which are written."""
    pose, refine = folder / "pose.onnx", folder / "refine.onnx"
    pose.write_bytes(pose_network(QUAT, OFFSET, TOWARDS, len(classes), classes=classes, points=100))
    refine.write_bytes(refine_network(SMALL_TURN, 0.3, len(classes), classes=classes))
    return {"weights": str(pose), "refiner_weights": str(refine), **more}


def session(folder: Path, **more: Any) -> Session:
    return Session(densefusion=DenseFusionSettings(**settings(folder, **more)))


def test_the_pool_is_the_most_confident_pose_and_others_drawn_by_the_seed(tmp_path: Path) -> None:
    pools = {}
    for seed in range(8):
        estimator = make_estimator("densefusion", session(tmp_path, seed=seed))
        pools[seed] = estimator.hypotheses(TARGET, 5)
        again = estimator.hypotheses(TARGET, 5)
        assert [h.confidence for h in again] == [h.confidence for h in pools[seed]]
    for pool in pools.values():
        confidences = [h.confidence for h in pool]
        assert len({h.T_cam_obj.tobytes() for h in pool}) == 5
        assert confidences == sorted(confidences, reverse=True)
    assert len({tuple(h.confidence for h in pool[1:]) for pool in pools.values()}) == 8


def test_the_first_of_the_pool_is_the_most_confident_of_all_points(tmp_path: Path) -> None:
    estimator = make_estimator("densefusion", session(tmp_path))
    every = estimator.hypotheses(TARGET, 10_000)
    (best,) = estimator.hypotheses(TARGET, 1)
    assert best.confidence == max(h.confidence for h in every)
    assert len(every) == 100


def test_others_are_drawn_from_everywhere(tmp_path: Path) -> None:
    """Uniformly: how confident a point is does not matter; the mean rank of many draws is that of the middle."""
    every = make_estimator("densefusion", session(tmp_path)).hypotheses(TARGET, 10_000)
    rank = {h.T_cam_obj.tobytes(): k for k, h in enumerate(every)}
    estimator = make_estimator("densefusion", session(tmp_path))
    drawn = []
    for seed in range(60):
        estimator.settings = DenseFusionSettings(seed=seed)  # type: ignore[attr-defined]
        drawn += [rank[h.T_cam_obj.tobytes()] for h in estimator.hypotheses(TARGET, 11)[1:]]
    assert np.mean(drawn) == pytest.approx(50, abs=5)
    assert np.std(drawn) == pytest.approx(100 / np.sqrt(12), abs=3)


def test_answers_depend_on_the_arguments_only(tmp_path: Path) -> None:
    used, fresh = (make_refiner("densefusion", session(tmp_path)) for _ in range(2))
    first = used.refine(TARGET, START)
    assert not np.array_equal(first, START)
    assert np.allclose(first[:3, :3].T @ first[:3, :3], np.eye(3), atol=1e-12)
    for h in TARGET.instance.hypotheses:
        used.refine(TARGET, h.T_cam_obj)
        used.refine(coloured_target(), h.T_cam_obj)
    assert np.array_equal(used.refine(TARGET, START), first)
    assert np.array_equal(fresh.refine(TARGET, np.array(START)), first)


def test_a_call_is_so_many_steps(tmp_path: Path) -> None:
    one, three = (make_refiner("densefusion", session(tmp_path, iterations=n)) for n in (1, 3))
    T = START
    for _ in range(3):
        T = one.refine(TARGET, T)
    np.testing.assert_allclose(three.refine(TARGET, START), T, atol=1e-6)


def test_without_depth_in_the_mask_there_is_no_pose_and_none_changes(tmp_path: Path) -> None:
    instance = replace(TARGET.instance, mask=np.zeros_like(TARGET.instance.mask), points_cam=np.empty((0, 3)))
    nothing = replace(TARGET, instance=instance)
    s = session(tmp_path)
    assert make_estimator("densefusion", s).hypotheses(nothing, 5) == ()
    assert np.array_equal(make_refiner("densefusion", s).refine(nothing, START), START)


@pytest.mark.usefixtures("processes")
def test_without_named_weights_the_packages_are_used_and_know_the_built_in_objects() -> None:
    box = Toolbox(resolve({"scene": {"demo": "duck"}, "hypotheses": {"source": "densefusion", "max_per_object": 5}}))
    (target,) = box.problem(box.frames[0]).targets
    pool = target.instance.hypotheses
    assert len(pool) == 5
    assert {h.source for h in pool} == {"densefusion"}
    T_gt = target.instance.T_cam_obj_gt
    # At the duck, whatever way it is turned.
    assert np.linalg.norm(pool[0].T_cam_obj[:3, 3] - T_gt[:3, 3]) < 0.5 * target.model.diameter_m
    T = make_refiner("densefusion", Session()).refine(target, pool[0].T_cam_obj)
    assert not np.array_equal(T, pool[0].T_cam_obj)


def test_weights_know_other_objects_of_the_same_id() -> None:
    """Those of the package are of the built-in objects; object 1 of another data set is another one."""
    estimator = make_estimator("densefusion", Session())
    with pytest.raises(InputError, match=r"slim\.onnx do not know .*: their object 1 measures 82 × 122 × 100 mm, the"):
        estimator.hypotheses(TARGET, 5)


def test_weights_that_are_missing_or_of_one_network_only_are_one_line(tmp_path: Path) -> None:
    for make in (make_refiner, make_estimator):
        with pytest.raises(InputError, match=r"weights .*no\.onnx does not exist"):
            make("densefusion", Session(densefusion=DenseFusionSettings(weights=str(tmp_path / "no.onnx"))))
    only_pose, only_refiner = settings(tmp_path) | {"refiner_weights": ""}, settings(tmp_path) | {"weights": ""}
    for only, empty, other in ((only_pose, "refiner_weights", "weights"), (only_refiner, "weights", "refiner_weights")):
        with pytest.raises(
            SettingsError, match=rf"densefusion\.{empty} is empty and densefusion\.{other} is not; name"
        ):
            make_refiner("densefusion", Session(densefusion=DenseFusionSettings(**only)))


def test_networks_of_two_trainings_do_not_go_together(tmp_path: Path) -> None:
    other = settings(tmp_path)
    (tmp_path / "refine.onnx").write_bytes(refine_network(SMALL_TURN, 0.3, 2, classes=[1, 2]))
    with pytest.raises(InputError, match=r"know 1 objects and .* 2, or others; give those of one training"):
        make_refiner("densefusion", Session(densefusion=DenseFusionSettings(**other)))


def test_pth_weights_name_the_extra_where_torch_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.delitem(sys.modules, "verefine_viz.networks.official_weights", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    (tmp_path / "pose_model.pth").write_bytes(b"whatever")
    s = Session(densefusion=DenseFusionSettings(weights=str(tmp_path / "pose_model.pth")))
    with pytest.raises(UnavailableError, match=r"need torch once, .*: pip install 'verefine-viz\[torch\]'"):
        make_estimator("densefusion", s)


def test_recordings_name_the_weights_by_their_hashes(tmp_path: Path) -> None:
    of_refiner = structs.replace(session(tmp_path), method=structs.replace(Session().method, refiner="densefusion"))
    (name,) = weights_of(of_refiner)
    assert name == "densefusion weights"
    assert weights_of(of_refiner)[name] == WEIGHTS["densefusion"](of_refiner)
    pose, refine = weights_of(of_refiner)[name].split()
    assert pose != refine
    of_pool = session(tmp_path)
    of_pool = structs.replace(of_pool, hypotheses=structs.replace(of_pool.hypotheses, source="densefusion"))
    assert weights_of(of_pool) == {"densefusion estimator weights": pose}


def test_paths_are_relative_to_the_session_file(tmp_path: Path) -> None:
    from verefine_viz.run.session_file import load_session

    settings(tmp_path)
    (tmp_path / "s.toml").write_text('[densefusion]\nweights = "pose.onnx"\nrefiner_weights = "refine.onnx"\n')
    loaded = load_session(tmp_path / "s.toml", {}).densefusion
    assert (loaded.weights, loaded.refiner_weights) == (str(tmp_path / "pose.onnx"), str(tmp_path / "refine.onnx"))


@pytest.mark.usefixtures("long_run")
def test_stepping_headless_and_replaying_are_the_same(tmp_path: Path) -> None:
    raw = {
        "scene": {"demo": "clutter"},
        "hypotheses": {"source": "densefusion", "max_per_object": 3},
        "method": {"name": "rir", "refiner": "densefusion", "iterations": 2},
        "densefusion": settings(tmp_path, tuple(range(1, 16))),
    }
    box = Toolbox(resolve(raw))
    whole = box.problem(box.frames[0])
    problem = whole.only([i.instance_id for i in whole.instances[:2]])
    assert {h.source for i in problem.instances for h in i.hypotheses} == {"densefusion"}
    file = RunFile(tmp_path / "run.vfrun", box.session)
    headless = box.run(problem, (file,))
    headless.finish()
    file.finish(ending(headless))
    assert any(it.stage("refined") is not None for it in headless.iterations)
    stepped = box.run(problem)
    while not stepped.at_end:
        stepped.step()
        fork = stepped.fork(stepped.cursor // 2)
        if not fork.at_end:
            fork.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    other = Toolbox(resolve(raw)).run(problem)
    other.finish()
    assert first_difference(headless.iterations, other.iterations) is None
    again = verify(file.path)
    assert again.difference is None
    assert again.n_compared == headless.length


def test_its_explanation_is_what_it_does(tmp_path: Path) -> None:
    """Turn and shift of the steps, one after another, lead from the start to the refined pose."""
    refiner = make_refiner("densefusion", session(tmp_path, iterations=3))
    assert isinstance(refiner, LearnedRefiner)
    steps = refiner.explain(TARGET, START)
    assert len(steps) == 3
    T, colours = np.array(START), TARGET.observation.rgb
    for step in steps:
        T[:3, :3] = Rotation.from_rotvec(step.turn).as_matrix() @ T[:3, :3]
        T[:3, 3] += step.shift_m
    np.testing.assert_allclose(T, refiner.refine(TARGET, START), atol=1e-9)
    seen = colours[TARGET.instance.mask].astype(int)
    at = steps[0].crops["image"][tuple(steps[0].points_px.astype(int).T[::-1])]
    assert all((np.abs(seen - one).max(axis=1) <= 1).any() for one in at[:20].astype(int))
    assert 0 < (steps[0].confidence or 0) < 1
    assert step_picture(steps[0]).shape[2] == 3
