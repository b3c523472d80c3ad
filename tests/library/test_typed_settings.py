"""Types of settings: those of the structs, and what a strict type checker makes of a program."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import verefine_viz as vv
from scripts.write_sections import SECTIONS, sections
from tests.library.frames import box_file, boxes

GOOD = '''
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import verefine_viz as vv
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target


class ShiftNet:
    """A refiner with weights: what is seen beside the model's middle, through two layers, is a shift."""

    def __init__(self, weights: dict[str, Float]) -> None:
        self.weights = weights

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        seen = target.instance.points_cam
        seen -= T_cam_obj[:3, :3] @ target.model.middle_m + T_cam_obj[:3, 3]
        T_cam_obj[:3, 3] += self.weights["out"] @ np.tanh(self.weights["in"] @ seen.mean(axis=0))
        return T_cam_obj


def solved(mesh: tuple[Float, Float], K: Float, depth_m: Float, poses: Float, net: ShiftNet) -> float:
    frame = vv.Frame(K, depth_m).add("box", mesh, None, poses, unit_m=np.float64(0.001))
    run = vv.solve(frame, method={"name": "rir", "iterations": np.int64(2)}, refiner=net, score={"tau_m": 0.01})
    for name, answer in run.items():
        print(name, answer.score, len(run.iterations))
    for iteration in vv.step(frame, "sir", refiner=lambda: net, physics={"enabled": False}).iterations:
        print(iteration.accepted)
    saved = vv.open_run(run.save("box.vfrun"))
    batch = vv.batch([frame], Path("out"), method="pir", refiner=net, recording={"keep": "none"}, progress=False)
    print(batch.failures, batch.runs["0/1"].iterations[0])
    return saved["box"].score or 0.0
'''
BAD = """
import verefine_viz as vv

vv.solve(vv.open_frame("mug"), method="rirr")
vv.solve(vv.open_frame("mug"), method={"name": "rir", "iterations": "ten"})
vv.solve(vv.open_frame("mug"), refiner=3)
"""


def test_the_types_are_those_of_the_settings() -> None:
    """Where this fails: ``make sections``."""
    assert SECTIONS.read_text("utf-8") == sections()


@pytest.mark.usefixtures("processes")
def test_a_strict_type_checker_takes_a_right_program_and_no_wrong_setting(tmp_path: Path) -> None:
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "bad.py").write_text(BAD)
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict", "include": ["."]}')
    words = [sys.executable, "-m", "pyright", "-p", str(tmp_path), "--pythonpath", sys.executable]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    faults = [line.strip() for line in done.stdout.splitlines() if " - error: " in line]
    assert [fault.split(" - ")[0].split("/")[-1].split(":")[:2] for fault in faults] == [
        ["bad.py", "4"],
        ["bad.py", "5"],
        ["bad.py", "6"],
    ], done.stdout


def test_that_program_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    monkeypatch.chdir(tmp_path)
    names: dict = {"__name__": "good"}
    exec(GOOD, names)
    mesh = trimesh.load(box_file(tmp_path), process=False)
    seen = boxes(box_file(tmp_path), n=1).problem()
    (target,) = seen.targets
    net = names["ShiftNet"]({"in": np.eye(3), "out": 0.5 * np.eye(3)})
    poses = np.array([h.T_cam_obj for h in target.instance.hypotheses])
    camera, depth_m = seen.observation.camera, seen.observation.depth_m
    assert names["solved"]((mesh.vertices, mesh.faces), camera.K, depth_m, poses, net) > 0.3


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    frame = boxes(box_file(tmp_path), unit_m=np.float64(0.001))
    plain = vv.solve(frame, {"name": "pir", "iterations": 2}, score={"tau_m": 0.02}, scene={"gravity": (0.0, 1.0, 0.5)})
    numpy = vv.solve(
        frame,
        {"name": "pir", "iterations": np.int64(2)},
        score={"tau_m": np.float64(0.02)},
        scene={"gravity": np.array([0.0, 1.0, 0.5])},
    )
    assert numpy.session == plain.session
    with pytest.raises(vv.VerefineError, match=r"write method=\{'seed': …\} or hypotheses="):
        vv.solve(frame, seed=3)  # type: ignore[call-arg]
