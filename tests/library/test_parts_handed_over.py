"""Parts that are handed over as objects, classes or functions: the bits of registered ones, and what runs call them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import verefine_viz as vv
from tests.library.frames import box_file, boxes
from tests.library.test_runs_and_batches import PIR, QUIET, bits
from verefine_viz.core.errors import ArgumentTypeError, InputError, PartError, SettingsError
from verefine_viz.core.problem import Hypothesis
from verefine_viz.library import plugins
from verefine_viz.page.share import opened


@pytest.fixture(autouse=True)
def own_registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What tests register is gone with them, in whatever module it is looked up."""
    for name in ("REFINERS", "ESTIMATORS", "VERIFIERS", "SIMULATORS"):
        registry = getattr(plugins, name)
        before = dict(registry)
        monkeypatch.setattr(plugins, name, registry)
        for key in ("Shifts", "Nearest", "Lifts", "Starts", "shifts"):
            monkeypatch.setitem(registry, key, None)
            if key not in before:
                del registry[key]


class Shifts:
    """A refiner with weights."""

    def __init__(self, weights: Any = (0.0, 0.0, 0.001)) -> None:
        self.weights = np.array(weights)

    def refine(self, target: Any, T_cam_obj: Any, fixed: Any = ()) -> Any:
        T_cam_obj[:3, 3] += self.weights
        return T_cam_obj


class Nearest:
    def scores(self, target: Any, Ts_cam_obj: Any, placed: Any) -> Any:
        seen = target.instance.points_cam
        seen -= seen.mean(axis=0)  # In place, in an array of its own.
        return np.clip(1 - np.linalg.norm(Ts_cam_obj[:, :3, 3] - [0, 0, 0.6], axis=1), 0, 1) + 0 * seen.sum()


class Lifts:
    def settle(self, moving: Any, fixed: Any, support: Any, n_steps: int) -> Any:
        return np.tile(moving.T_cam_obj, (n_steps + 1, 1, 1))


class Starts:
    def hypotheses(self, target: Any, n: int, progress: Any = None) -> Any:
        T = np.eye(4)
        T[:3, 3] = np.median(target.instance.points_cam, axis=0)
        return (Hypothesis(T, 1.0, "starts"),) * min(n, 2)


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    return box_file(tmp_path)


def test_an_object_a_class_and_a_function_are_a_registered_part(mesh: Path) -> None:
    vv.refiner("shifts")(Shifts)
    by_name = vv.solve(boxes(mesh), PIR, refiner="shifts")
    for part in (Shifts(), Shifts, lambda: Shifts()):
        run = vv.solve(boxes(mesh), PIR, refiner=part)
        assert bits(run) == bits(by_name)
        assert run.session.method.refiner == "Shifts"
    inside = vv.solve(boxes(mesh), {**PIR, "refiner": Shifts()})
    assert bits(inside) == bits(by_name)
    heavier = vv.solve(boxes(mesh), PIR, refiner=Shifts([0, 0, 0.01]))
    assert bits(heavier) != bits(by_name)


def test_every_kind_of_part_is_handed_over(mesh: Path) -> None:
    frame = boxes(mesh)
    parts: dict[str, Any] = {"verifier": Nearest(), "simulator": Lifts, "estimator": Starts(), "refiner": Shifts()}
    run = vv.solve(frame, PIR, **parts)
    session = run.session
    names = (session.score.verifier, session.physics.simulator, session.hypotheses.source, session.method.refiner)
    assert names == ("Nearest", "Lifts", "Starts", "Shifts")
    assert run["box 0"].n_hypotheses == 2
    T = run["box 0"].T_cam_obj
    assert T is not None
    one = vv.score(frame, "box 0", T, verifier=Nearest()).score
    assert np.array_equal(one, vv.score(frame, "box 0", T, score={"verifier": Nearest}).score)
    assert vv.settle(frame, "box 0", T, 3, simulator=Lifts()).shape == (4, 4, 4)
    assert len(vv.estimate(frame, "box 0", Starts)) == 2
    assert np.allclose(vv.refine(frame, "box 0", T, Shifts())[:3, 3] - T[:3, 3], (0, 0, 0.001))


def test_runs_that_are_stepped_side_by_side_keep_their_own_parts(mesh: Path) -> None:
    one, other = (vv.step(boxes(mesh), PIR, refiner=Shifts([0, 0, w])) for w in (0.001, 0.002))
    apart = [vv.solve(boxes(mesh), PIR, refiner=Shifts([0, 0, w])) for w in (0.001, 0.002)]
    for pair in zip(one.iterations, other.iterations, strict=True):
        assert len(pair) == 2
    assert [bits(run) for run in (one, other)] == [bits(run) for run in apart]


def test_a_run_of_a_part_that_is_not_there_opens_and_says_what_it_lacks(mesh: Path, tmp_path: Path) -> None:
    run = vv.solve(boxes(mesh), PIR, refiner=Shifts(), estimator=Starts())
    file = run.save(tmp_path / "own.vfrun")
    assert opened(file).space.work.first.run.is_done  # In this process the page finds the part.
    for registry in (plugins.REFINERS, plugins.ESTIMATORS):
        for name in ("Shifts", "Starts"):
            registry.pop(name, None)
    there = vv.open_run(file)
    assert bits(there) == bits(run)
    assert there.allowed("box 0").extents
    with pytest.raises(SettingsError, match="Shifts"):
        vv.solve(boxes(mesh), there.session.method.refiner, refiner="Shifts")  # type: ignore[arg-type]


def test_what_is_no_part_is_one_line(mesh: Path, tmp_path: Path) -> None:
    def broken() -> Any:
        raise KeyError("no weights")

    for part, kind, message in (
        (3, ArgumentTypeError, "refiner is 3, expected a name, or an object with refine"),
        (lambda: 4, ArgumentTypeError, "which makes 4"),
        (broken, PartError, "refiner broken raised KeyError: 'no weights'"),
        (type("icp", (Shifts,), {}), InputError, "'icp' is the name of a part of this package"),
    ):
        with pytest.raises(kind, match=message):
            vv.solve(boxes(mesh), PIR, refiner=part)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="other processes do not have the parts of this one"):
        vv.batch([boxes(mesh)], tmp_path / "out", workers=2, refiner=Shifts(), **QUIET)
    batch = vv.batch([boxes(mesh)], tmp_path / "out", method=PIR, refiner=Shifts(), **QUIET)  # type: ignore[arg-type]
    assert bits(batch.runs["0/1"]) == bits(vv.solve(boxes(mesh), PIR, refiner=Shifts()))
