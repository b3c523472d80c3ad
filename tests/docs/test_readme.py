"""What README and guide promise: their files exist, their sessions load, their code runs."""

from __future__ import annotations

import csv
import importlib.util
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.fakes import BOX_M, box_problem
from verefine_viz import cli
from verefine_viz.commands.batch import BatchCommand
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import transform
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.settings import Session
from verefine_viz.library.solving import Run
from verefine_viz.page.share import opened
from verefine_viz.pictures.refiner_crops import step_picture
from verefine_viz.refiners.registry import REFINERS, make_refiner
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.run_file import read_run_file
from verefine_viz.run.session_file import load_session, resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.trace import Trace

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUIDE = (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", f"{README}\n{GUIDE}", re.MULTILINE | re.DOTALL)


def example(name: str) -> str:
    """Return the program of the guide that registers a part by this name."""
    (code,) = (code for code in blocks("python") if re.search(rf'^@vv\.\w+\("{name}"\)', code, re.MULTILINE))
    return code


def make_targets() -> set[str]:
    return set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def test_every_file_it_links_to_is_there() -> None:
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert len(links) >= 8
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_every_make_target_it_names_exists() -> None:
    named = set(re.findall(r"\bmake (app|test|lint|bench|[a-z]+)(?=`|\s+#)", README))
    assert {"app", "test", "lint", "bench"} <= named <= make_targets()


def test_its_commands_are_commands() -> None:
    lines = re.findall(r"^verefine-viz ([^#\n]+)", "".join(blocks("sh")), re.MULTILINE)
    commands = [cli.parse(line.split()) for line in lines]
    assert [type(command) for command in commands[:3]] == [ViewCommand, BatchCommand, ViewCommand]
    batch = commands[1]
    assert isinstance(batch, BatchCommand)
    assert load_session(ROOT / "sessions" / f"{batch.sessions[0]}.toml").scene.source == "demo"


def test_its_system_packages_are_those_that_make_installs() -> None:
    script = (ROOT / "scripts" / "system-packages").read_text()
    needed = re.findall(r"^need (\S+)", script.partition("find-python")[0], re.MULTILINE)
    assert re.findall(r"apt-get install (.+)", README) == [" ".join(needed)]


def test_on_a_package_index_it_leads_to_the_repository() -> None:
    spec = importlib.util.spec_from_file_location("readme_links", ROOT / "scripts" / "readme_links.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shown = module.absolute(README, "https://example.org/o/r", "v1")
    assert "](https://example.org/o/r/raw/v1/docs/tour/tour.gif)" in shown
    links = [link for link in re.findall(r"\]\(([^)]+)\)", shown) if not link.startswith("https://")]
    assert links == []
    assert (
        module.absolute("[![a](b.png)](c.md#d) [e](#f)", "R", "T") == "[![a](R/raw/T/b.png)](R/blob/T/c.md#d) [e](#f)"
    )


def test_its_session_file_is_a_session() -> None:
    (text,) = blocks("toml")
    session = resolve(tomllib.loads(text))
    assert session.scene.frames == ("3/120",)
    assert len(session.hypotheses.files) == 2


def test_every_shipped_session_is_one() -> None:
    for path in sorted((ROOT / "sessions").glob("*.toml")):
        session = load_session(path)
        assert session.title, path


def test_its_frame_is_solved_saved_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code, *_ = blocks("python")
    problem = box_problem()
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box(BOX_M * 1000).export(tmp_path / "meshes" / "mug.stl")
    seen, (instance,) = problem.observation, problem.instances
    arrays = {"K": seen.camera.K, "depth_m": seen.depth_m, "rgb": seen.rgb, "mask": instance.mask}
    monkeypatch.chdir(tmp_path)
    shown: list[Run] = []
    monkeypatch.setattr(Run, "show", lambda run: shown.append(run))
    exec(code, arrays | {"poses": instance.hypotheses[0].T_cam_obj})
    assert shown[0]["mug"].score is not None
    assert read_run_file(tmp_path / "drop.vfrun").is_complete
    (kept,) = Toolbox(load_session(tmp_path / "frames" / "session.toml")).problem("1/1").instances
    np.testing.assert_allclose(kept.hypotheses[0].T_cam_obj, instance.hypotheses[0].T_cam_obj, atol=1e-12)


def test_its_traces_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (own,) = (code for code in blocks("python") if 'with Trace("runs/drop_17"' in code)
    (foundation_pose,) = (code for code in blocks("python") if "est.register(" in code)
    problem = box_problem()
    trimesh.creation.box(BOX_M * 1000).export(tmp_path / "mug.stl")
    (tmp_path / "mesh").mkdir()
    trimesh.creation.box(BOX_M).export(tmp_path / "mesh" / "textured_simple.obj")
    seen, (instance,) = problem.observation, problem.instances
    poses = np.array([h.T_cam_obj for h in instance.hypotheses])
    arrays = {"K": seen.camera.K, "depth_m": seen.depth_m, "rgb": seen.rgb, "mask": instance.mask}
    arrays |= {"depth": seen.depth_m, "color": seen.rgb, "initial_poses": poses, "scores": [0.1] * len(poses)}
    monkeypatch.chdir(tmp_path)
    exec(own, arrays | {"my_refiner": lambda T_cam_obj: [(T_cam_obj, 0.4)] * 3})
    shift = transform(np.eye(3), np.array([0.01, 0, 0]))
    # As NVlabs/FoundationPose has it: after tracking pose_last is (1, 4, 4).
    est = SimpleNamespace(
        register=lambda K, rgb, depth, ob_mask, iteration: poses[0] @ shift,
        track_one=lambda rgb, depth, K, iteration: poses[0] @ shift,
        get_tf_to_centered_mesh=lambda: shift,
        pose_last=poses[None, 0],
        poses=np.array([poses[0]] * 5),
        scores=np.arange(5.0),
    )
    for i in (0, 1):
        exec(foundation_pose, arrays | {"est": est, "Trace": Trace, "i": i})
    toolbox = Toolbox(open_session(tmp_path / "runs", {}))
    assert toolbox.frames == ("0/0", "0/1", "0/17")
    first, second, of_own = (toolbox.problem(frame).instances[0] for frame in toolbox.frames)
    assert [step.name for step in of_own.recorded] == ["refined"] * 3 + ["answer"]
    assert (len(first.hypotheses), len(second.hypotheses)) == (5, 1)
    for one in (first, second):
        np.testing.assert_allclose(one.recorded[-1].T_cam_obj, poses[0] @ shift)


@pytest.mark.usefixtures("processes")
def test_its_refiner_runs(tmp_path: Path) -> None:
    code = example("nudge")
    assert len([line for line in code.splitlines() if line.strip()]) <= 20
    script, out = tmp_path / "nudge.py", tmp_path / "out"
    script.write_text(code)
    words = ["batch", ROOT / "sessions/mug.toml", "--out", out, "--workers", "1", "--method.refiner", "nudge"]
    words += ["--recording.keep", "none", "--method.iterations", "2", "--hypotheses.rotation-deg", "0"]
    done = subprocess.run([sys.executable, script, *words], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    with (out / "frames.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    # Nothing is turned, only moved: that is what this refiner can mend.
    assert row["status"] == "ok"
    assert float(row["score"]) > float(row["initial_score"])
    assert float(row["add_s_mm"]) < float(row["initial_add_s_mm"])


@pytest.mark.usefixtures("processes")
def test_its_verifier_scores_poses(tmp_path: Path) -> None:
    code = example("crops")
    assert len([line for line in code.splitlines() if line.strip()]) <= 30
    script, out = tmp_path / "crops.py", tmp_path / "out"
    script.write_text(code)
    words = ["batch", ROOT / "sessions/mug.toml", "--out", out, "--workers", "1"]
    words += ["--score.verifier", "crops", "--method.exploration", "0.7"]  # As the guide has it.
    done = subprocess.run([sys.executable, script, *words], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    with (out / "frames.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["status"] == "ok"
    assert float(row["add_s_mm"]) < 0.05 * float(row["diameter_mm"]) < float(row["initial_add_s_mm"])
    (recording,) = out.rglob("*.rrd")
    verify = [sys.executable, script, "replay", recording, "--verify"]
    done = subprocess.run(verify, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "no difference in 25 iterations" in done.stdout, done.stderr


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("option", ["--physics.simulator drop", "--hypotheses.source sweep"])
def test_its_simulator_and_its_estimator_run(option: str, tmp_path: Path) -> None:
    name = option.split()[-1]
    script, out = tmp_path / f"{name}.py", tmp_path / "out"
    script.write_text(example(name))
    words = ["batch", "mug", "--out", out, "--workers", "1", *option.split()]
    words += ["--hypotheses.rotation-deg", "20"]
    done = subprocess.run([sys.executable, script, *words], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    with (out / "frames.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["status"] == "ok"
    assert float(row["add_s_mm"]) < 0.1 * float(row["diameter_mm"])
    (recording,) = out.rglob("*.rrd")
    verify = ["replay", str(recording), "--verify"]
    done = subprocess.run([sys.executable, script, *verify], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "no difference" in done.stdout, done.stderr
    shown = opened(recording).space  # What it did is shown without it.
    assert shown.work.first.run.is_done
    assert len(shown.problem.targets[0].instance.hypotheses) == 5
    kind = "simulator" if name == "drop" else "estimator"
    with pytest.raises(SettingsError, match=f"made with the {kind} '{name}', which this program does not have"):
        cli.parse(verify).run(verify[1:])


def test_its_refiner_explains_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    code = example("nudge")
    (explained,) = (code for code in blocks("python") if "class ExplainedNudge" in code)
    names: dict[str, Any] = {"__name__": "nudge"}
    with monkeypatch.context() as patched:
        patched.setitem(REFINERS, "nudge", None)
        exec(code + explained, names)
        patched.setitem(REFINERS, "nudge", lambda session: names["ExplainedNudge"]())
        refiner = make_refiner("nudge", Session())
    (target,) = box_problem().targets
    T = target.instance.hypotheses[0].T_cam_obj
    assert isinstance(refiner, LearnedRefiner)
    (step,) = refiner.explain(target, T)
    np.testing.assert_allclose(T[:3, 3] + step.shift_m, refiner.refine(target, T)[:3, 3])
    assert step_picture(step).any()
