"""Every call of the library with every wrong argument: an error of this package in one plain line, or an answer."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import verefine_viz as vv
from tests.fakes import BOX_M, box_problem
from verefine_viz.page import notebook

POSE = np.eye(4)
POSE[2, 3] = 0.7
WRONG: dict[str, Any] = {
    "None": None, "True": True, "0": 0, "5": 5, "-3": -3, "10**9": 10**9, "10**5000": 10**5000, "1.5": 1.5,
    "nan": math.nan, "inf": math.inf, "1j": 1j, "empty text": "", "x": "x", "digit": "5", "NUL": "a\0b",
    "surrogate": "\udcff", "codes": "\x1b[2J\nx", "long text": "y" * 5000, "bytes": b"ab", "[]": [], "[None]": [None],
    "{}": {}, "{1: 2}": {1: 2}, "{'a': None}": {"a": None}, "object": object(), "class": int, "set": {1},
    "empty array": np.zeros((0, 4, 4)), "3×3": np.eye(3), "4×4": np.eye(4), "4×4 NaN": np.full((4, 4), np.nan),
    "4×4 far": POSE * 1e9, "5×4×4": np.tile(POSE, (5, 1, 1)), "image": np.zeros((8, 8)), "texts": np.array([["a"]]),
    "objects": np.array([object(), None]), "ragged": [[1, 2], [3]], "complex": np.eye(4) * 1j, "bools": np.eye(4) > 0,
    "0-d": np.float64(3.0), "lambda": lambda: 1, "nested": [[[[1]]]], "dates": np.array(["2020"], "datetime64[Y]"),
    "records": np.zeros(3, dtype=[("a", "f4")]),
}  # fmt: skip


@dataclass
class Call:
    """A call that is right, and what may be wrong in it."""

    name: str
    call: Callable[..., Any]
    right: dict[str, Any]
    takes: frozenset[str] = frozenset()
    """Wrong values that are right here."""
    sections: bool = False


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mesh") / "box.ply"
    trimesh.creation.box(BOX_M).export(path)
    return path


def frame_of(mesh: Path) -> vv.Frame:
    problem = box_problem(n_instances=1)
    seen, instance = problem.observation, problem.instances[0]
    frame = vv.Frame(seen.camera.K, seen.depth_m, seen.rgb)
    return frame.add("box", mesh, instance.mask, np.array([h.T_cam_obj for h in instance.hypotheses]))


def calls(mesh: Path, folder: Path) -> Iterator[Call]:
    frame = frame_of(mesh)
    problem = box_problem(n_instances=1)
    seen, mask = problem.observation, problem.instances[0].mask
    pose = problem.instances[0].hypotheses[0].T_cam_obj
    trace = frame.save(folder / "one")
    opened = vv.open_frame(trace)
    run = vv.solve(frame, "refine")
    one: dict[str, Any] = {"frame": frame, "name": "box"}
    arrays = {"K": seen.camera.K, "depth_m": seen.depth_m, "rgb": None, "gravity_cam": None}
    about = {"name": "box", "mesh": mesh, "mask": mask, "poses": pose, "scores": None, "unit_m": 1.0}
    yield Call("Frame", vv.Frame, {**arrays, "name": "a"})
    yield Call("Frame.add", lambda **a: frame_of(mesh).add(**a), {**about, "T_cam_obj_gt": None, "symmetry_axis": None})
    yield Call("Frame.tools", frame.tools, {"sections": {}})
    yield Call("Frame.problem", frame.problem, {}, sections=True)
    yield Call("Frame.save", frame.save, {"folder": folder / "saved"})
    yield Call("Frame.keep", frame.keep, {"folder": folder / "kept"})
    yield Call("OpenedFrame.tools", opened.tools, {"sections": {}})
    yield Call("OpenedFrame.problem", opened.problem, {}, sections=True)
    yield Call("open_frame", vv.open_frame, {"path": trace, "frame": ""}, sections=True)
    yield Call("open_dataset", lambda **a: next(iter(vv.open_dataset(**a))), {"path": trace}, sections=True)
    yield Call("score", vv.score, {**one, "poses": pose, "verifier": ""}, sections=True)
    yield Call("score_maps", vv.score_maps, {**one, "pose": pose}, sections=True)
    yield Call("refine", vv.refine, {**one, "poses": pose, "refiner": ""}, sections=True)
    yield Call("settle", vv.settle, {**one, "poses": pose, "steps": 2, "simulator": ""}, sections=True)
    yield Call("estimate", vv.estimate, {**one, "estimator": "ppf", "n": 2}, sections=True)
    yield Call("label", vv.label, {**one, "T_start": pose, "others": None}, sections=True)
    yield Call("evaluate", vv.evaluate, {"results": folder / "a.csv", "dataset": folder, "split": ""})
    parts = {"refiner": "", "verifier": "", "simulator": "", "estimator": ""}
    solving = {"frame": frame, "method": "refine", "preset": "", **parts}
    yield Call("solve", vv.solve, solving, sections=True)
    yield Call("step", vv.step, solving, sections=True)
    yield Call("open_run", vv.open_run, {"path": run.save(folder / "a.vfrun")})
    yield Call("open_batch", vv.open_batch, {"folder": folder / "nothing"})
    batching = {"what": trace, "out": folder / "out", "workers": 1, "method": "refine", "preset": "bogus", **parts}
    flags = {"diagnose": False, "retry_failed": False, "progress": False}
    yield Call("batch", vv.batch, {**batching, **flags}, sections=True)
    reported = {"what": folder / "nothing", "against": None, "out": None, "embed": 1, "beside": 0, "pictures": 1}
    yield Call("report", vv.report, {**reported, "workers": 1, "progress": False})
    yield Call("Run", vv.Run, {"of": None})
    yield Call("Batch", vv.Batch, {"index": None})
    yield Call("Run[]", lambda name: run[name], {"name": "box"})
    yield Call("Run.iterations[]", lambda k: run.iterations[k], {"k": 0})
    yield Call("Run.save", run.save, {"path": folder / "a.vfrun"})
    yield Call("Run.share", run.share, {"out": folder / "a.html", "maps": "end", "with_scene": False})
    yield Call("Run.show", run.show, {"height": 300})
    yield Call("show", vv.show, {"what": run, "height": 300})
    shared = {"what": folder / "a.vfrun", "out": folder / "b.html", "frame": None, "maps": "end", "with_scene": False}
    yield Call("share", vv.share, shared)
    for kind, method in (
        ("refiner", "refine"),
        ("estimator", "hypotheses"),
        ("verifier", "scores"),
        ("simulator", "settle"),
    ):
        part = type("Part", (), {method: lambda *_: None})
        register = getattr(vv, kind)
        yield Call(kind, lambda name, kind, register=register: register(name)(kind), {"name": "wrong", "kind": part})


@pytest.mark.usefixtures("long_run")
def test_a_wrong_call_is_one_plain_line(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from verefine_viz.library import plugins

    class NoServer:
        url = "http://localhost"

        def __init__(self, **_: Any) -> None: ...
        def start(self) -> NoServer:
            return self

        def stop(self) -> None: ...
        def wait_until_ready(self) -> None: ...

    monkeypatch.setattr(notebook, "App", NoServer)
    made = SimpleNamespace(space=SimpleNamespace(frame="0/1"), title="a run")
    for name in ("opened", "shared", "end_scene", "write_shared"):  # What follows when all arguments are right.
        monkeypatch.setattr(f"verefine_viz.page.share.{name}", lambda *_: made)
    monkeypatch.chdir(tmp_path)
    for name in ("REFINERS", "ESTIMATORS", "VERIFIERS", "SIMULATORS"):
        monkeypatch.setattr(plugins, name, dict(getattr(plugins, name)))
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("x")
    wrong = {**WRONG, "folder": tmp_path / "folder", "file": tmp_path / "file", "nothing": tmp_path / "none"}
    faults, n = list[str](), 0
    for call in calls(mesh, tmp_path):
        names = [*call.right, *(("score", "method", "scene", "physics", "bogus") if call.sections else ())]
        for name in names:
            for what, value in wrong.items():
                n += 1
                fault = _fault(lambda call=call, name=name, value=value: call.call(**{**call.right, name: value}))
                if fault:
                    faults.append(f"{call.name}({name}={what}): {fault}")
    capfd.readouterr()
    assert not faults, f"{len(faults)} of {n}:\n" + "\n".join(faults)
    assert n > 3000


def _fault(call: Callable[[], Any]) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            call()
    except vv.VerefineError as error:
        line = str(error)
        is_plain = line.isprintable() and 0 < len(line) < 700 and " at 0x" not in line
        return "" if is_plain else f"not one plain line: {line[:300]}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    return ""


def test_errors_are_those_of_python_too(mesh: Path) -> None:
    frame = frame_of(mesh)
    for call, kind in (
        (lambda: vv.score(frame, "box", "pose"), ValueError),
        (lambda: vv.solve(frame, "rur"), ValueError),
        (lambda: frame.add("box", mesh, poses=np.eye(3)), ValueError),
        (lambda: vv.open_dataset(None), TypeError),  # type: ignore[arg-type]
        (lambda: vv.settle(frame, "box", POSE, steps="5"), TypeError),  # type: ignore[arg-type]
        (lambda: vv.show(frame), TypeError),
    ):
        with pytest.raises(vv.VerefineError) as error:
            call()
        assert isinstance(error.value, kind), error.value


def test_what_show_takes_is_said(mesh: Path) -> None:
    with pytest.raises(vv.VerefineError, match=r"a Frame cannot be shown, expected a run, as vv\.step\(frame\)"):
        vv.show(frame_of(mesh))


def test_a_part_that_cannot_be_made_is_named(mesh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def init(self: object) -> None:
        raise KeyError("no weights")

    from verefine_viz.library import plugins

    used = {
        "refiner": ("REFINERS", "refine", lambda: vv.refine(frame, "box", POSE, refiner="broken")),
        "estimator": ("ESTIMATORS", "hypotheses", lambda: vv.estimate(frame, "box", "broken")),
        "verifier": ("VERIFIERS", "scores", lambda: vv.score(frame, "box", POSE, score={"verifier": "broken"})),
        "simulator": ("SIMULATORS", "settle", lambda: vv.settle(frame, "box", POSE, physics={"simulator": "broken"})),
    }
    frame = frame_of(mesh)
    for kind, (registry, method, use) in used.items():
        monkeypatch.setitem(getattr(plugins, registry), "broken", None)
        getattr(vv, kind)("broken")(type("Broken", (), {"__init__": init, method: lambda *_: None}))
        with pytest.raises(vv.VerefineError, match=f"^{kind} broken raised KeyError: 'no weights' .test_wrong_calls"):
            use()


def test_several_poses_are_all_settled_and_maps_are_of_one(mesh: Path) -> None:
    frame = frame_of(mesh)
    poses = np.tile(POSE, (3, 1, 1))
    poses[:, 0, 3] = (0.0, 0.01, 0.02)
    paths = vv.settle(frame, "box", poses, steps=4)
    assert paths.shape == (3, 5, 4, 4)
    for T, path in zip(poses, paths, strict=True):
        assert np.array_equal(vv.settle(frame, "box", T, steps=4), path)
    with pytest.raises(vv.VerefineError, match="pose is of 3 poses, expected one"):
        vv.score_maps(frame, "box", poses)
    assert vv.score_maps(frame, "box", poses[:1]) is not None


def test_what_would_run_away_or_be_taken_in_silence_is_refused(mesh: Path, tmp_path: Path) -> None:
    frame, problem = frame_of(mesh), box_problem(n_instances=1)
    K, depth = problem.observation.camera.K, problem.observation.depth_m
    skewed = K.copy()
    skewed[0, 1] = 3.0
    (tmp_path / "test").mkdir()
    for call, message in (
        (lambda: vv.Frame(K, np.broadcast_to(np.float32(1), (20_000, 20_000))), "400 megapixels, expected at most 25"),
        (lambda: vv.settle(frame, "box", POSE, steps=10**7), "expected a whole number from 1 to 10000"),
        (lambda: vv.estimate(frame, "box", n=-3), "n is -3, expected a whole number from 1"),
        (lambda: vv.share("a.vfrun", "a.html", maps="none"), "maps is 'none', expected 'end' or 'marked' or 'all'"),  # type: ignore[arg-type]
        (lambda: vv.Frame(skewed, depth), "K has a skew of 3 px, expected 0"),
        (lambda: vv.Frame(K, (depth * 1000).astype(np.uint16)), "depth_m is uint16, expected metres as floats"),
        (lambda: frame.save(tmp_path), "holds something else; choose a new folder for the trace"),
        (lambda: frame.keep(tmp_path), "holds something else; choose a new folder"),
    ):
        with pytest.raises(vv.VerefineError, match=message):
            call()
    assert [*tmp_path.rglob("*")] == [tmp_path / "test"]
