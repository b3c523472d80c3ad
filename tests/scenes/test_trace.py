"""Traces: what a program writes call by call, and what is read back; bad calls, kills and folders of several."""

from __future__ import annotations

import ast
import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import FakeVerifier
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.methods.per_object import PerObject
from verefine_viz.methods.recorded_steps import recorded_steps
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.run.data_folder import data_at, open_session
from verefine_viz.run.engine import Run
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.recorded_frame import frame_ids
from verefine_viz.scenes.source import open_scene
from verefine_viz.scenes.trace_files import left_out_of, read_trace, traces_in
from verefine_viz.trace import Trace

K = np.array([[120.0, 0, 80], [0, 120, 60], [0, 0, 1]])
SHAPE = (120, 160)


def write_box(path: Path, size: float = 100.0) -> Path:
    """An OBJ of a box [mm]."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x * size / 2} {y * size / 2} {z * size / 2}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in quads]
    path.write_text("\n".join(lines))
    return path


def pose(degrees: float = 0.0, x: float = 0.0) -> np.ndarray:
    return transform(axis_angle(np.array([0.0, 1, 0]), np.radians(degrees)), np.array([x, 0.0, 0.55]))


def picture() -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] of a box before a wall, and the box's mask."""
    depth = np.full(SHAPE, 0.8, np.float32)
    mask = np.zeros(SHAPE, bool)
    mask[49:71, 69:91] = True
    depth[mask] = 0.5
    return depth, mask


def write_trace(folder: Path, mesh: Path, n_steps: int = 3, with_table: bool = False) -> Trace:
    depth, mask = picture()
    if with_table:  # Seen from 40° above, 60 mm below the box's middle.
        slope = (np.arange(SHAPE[0])[:, None] - K[1, 2]) / K[1, 1] * np.ones(SHAPE)
        a = np.radians(40)
        depth = np.where(mask, depth, (0.55 * np.sin(a) + 0.06) / (slope * np.cos(a) + np.sin(a))).astype(np.float32)
    with Trace(folder, K=K, depth_m=depth, rgb=np.zeros((*SHAPE, 3), np.uint8)) as trace:
        box = trace.object("box", mesh=mesh, mask=mask, unit_m=0.001, truth=pose())
        for h in (0, 1):
            box.hypothesis(h, pose(20 + h, 0.01), score=0.1 * h)
        for k in range(n_steps):
            for h in (1, 0):
                box.step(h, pose(15 - 5 * k + h, 0.005), score=0.5 + 0.1 * k, ms=2.5, name="icp", note=f"round {k}")
        box.answer(pose(5.001, 0.005), score=0.9)
    return trace


def problem_of(folder: Path, frame: str | None = None) -> Problem:
    source = open_scene(SceneSettings(source="folder", dataset=str(folder)), HypothesesSettings(source="recorded"))
    return source.problem(frame or source.frames[0])


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    trace = write_trace(tmp_path / "drop_17", write_box(tmp_path / "box.obj"))
    assert trace.n_problems == 0
    problem = problem_of(tmp_path / "drop_17")
    (instance,) = problem.instances
    depth, mask = picture()
    assert np.array_equal(problem.observation.depth_m, depth)
    assert np.array_equal(instance.mask, mask)
    assert problem.models[instance.obj_id].diameter_m == pytest.approx(0.1 * 3**0.5)
    assert np.allclose(instance.T_cam_obj_gt, pose())
    assert [h.confidence for h in instance.hypotheses] == [0.0, 0.1] == [*instance.recorded_scores]
    assert [s.hypothesis for s in instance.recorded] == [1, 0, 1, 0, 1, 0, 0]  # The answer is nearest to hypothesis 0.
    assert [s.name for s in instance.recorded] == ["icp"] * 6 + ["answer"]
    assert instance.recorded[2].note == "round 1"
    assert instance.recorded[2].ms == 2.5
    assert instance.recorded[2].score == 0.6
    assert not problem.notes
    assert problem.frame == "0/17"


def test_the_method_goes_through_the_recorded_poses_and_answers_as_the_program_did(tmp_path: Path) -> None:
    write_trace(tmp_path / "t", write_box(tmp_path / "box.obj"))
    problem = problem_of(tmp_path / "t")
    run = Run(PerObject(recorded_steps(FakeVerifier())), problem)
    run.finish()
    recorded = problem.instances[0].recorded
    assert [i.arm for i in run.iterations] == [s.hypothesis for s in recorded]
    for iteration, step in zip(run.iterations, recorded, strict=True):
        assert np.array_equal(iteration.accepted_stage.T_cam_obj, step.T_cam_obj)
        assert iteration.accepted_stage.score is not None
    assert np.array_equal(run.final_state.best[0].T_cam_obj, recorded[-1].T_cam_obj)


def test_an_edited_pose_is_played_and_the_recorded_steps_follow(tmp_path: Path) -> None:
    write_trace(tmp_path / "t", write_box(tmp_path / "box.obj"))
    run = Run(PerObject(recorded_steps(FakeVerifier())), problem_of(tmp_path / "t"))
    run.finish()
    forked = run.fork(2, edit=(0, 1, pose(40)))
    forked.finish()
    assert forked.is_done
    assert forked.length >= 7


BAD_CALLS = {
    "wrong shape": lambda box: box.step(0, np.eye(3)),
    "NaN": lambda box: box.step(0, np.full((4, 4), np.nan)),
    "no rotation": lambda box: box.hypothesis(0, np.diag([2.0, 1, 1, 1])),
    "text": lambda box: box.step(0, "somewhere"),
    "millimetres": lambda box: box.step(0, transform(np.eye(3), np.array([0.0, 0, 700]))),
    "None": lambda box: box.answer(None),
    "no number": lambda box: box.step("first", pose()),
    "time": lambda box: box.step(0, pose(), ms="fast"),
    "word for a score": lambda box: box.step(0, pose(), score="good"),
}
BAD_PARTS = {"mesh": Path("none.obj"), "mask": np.ones((50, 160), bool), "unit_m": -1, "truth": np.eye(3)}


def test_a_bad_call_or_a_bad_part_of_an_object_is_counted_and_never_raises(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    depth, mask = picture()
    right = {"mesh": write_box(tmp_path / "box.obj"), "mask": mask, "unit_m": 0.001, "truth": pose()}
    for name in (*BAD_CALLS, *BAD_PARTS):
        caplog.clear()
        with caplog.at_level(logging.WARNING), Trace(tmp_path / name, K=K, depth_m=depth) as trace:
            box = trace.object("box", **right | {part: bad for part, bad in BAD_PARTS.items() if part == name})
            box.hypothesis(0, pose())
            BAD_CALLS.get(name, lambda box: box.step(0, pose(5)))(box)
        assert (trace.n_problems, len(caplog.records)) == (1, 1), name
        if name in ("mesh", "unit_m"):
            with pytest.raises(InputError, match="no mesh"):
                problem_of(tmp_path / name)
        elif name in BAD_PARTS:
            problem = problem_of(tmp_path / name)
            assert len(problem.instances[0].recorded) == 1
            assert any("its first pose covers" in note for note in problem.notes) == (name == "mask")
        else:
            assert any("1 not recorded" in note for note in read_trace(tmp_path / name).notes), name


def test_a_mesh_that_is_none_and_a_skew_are_counted(tmp_path: Path) -> None:
    skewed = K + np.array([[0, 5.0, 0], [0, 0, 0], [0, 0, 0]])
    with Trace(tmp_path / "t", K=skewed, depth_m=picture()[0]) as trace:
        trace.object("box", mesh=None)  # type: ignore[arg-type]
    assert trace.n_problems == 2


def test_calls_after_the_end_are_counted_and_the_first_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    trace = Trace(tmp_path / "t", K=K, depth_m=picture()[0])
    box = trace.object("box", mesh=write_box(tmp_path / "box.obj"), unit_m=0.001)
    trace.close()
    before = (tmp_path / "t" / "calls.jsonl").read_bytes()
    with caplog.at_level(logging.WARNING):
        for _ in range(100):
            box.step(0, pose())
        trace.object("other", mesh="none.obj")
        trace.close()
    assert trace.n_problems > 100
    assert len(caplog.records) == 1
    assert (tmp_path / "t" / "calls.jsonl").read_bytes() == before


UNUSABLE: tuple[tuple[dict[str, object], str], ...] = (
    ({"K": None}, "K"),
    ({"depth_m": None}, "depth_m"),
    ({"K": np.eye(4)}, "K has shape"),
    ({"K": K.T}, "transposed"),
    ({"K": np.diag([0.75, 1.0, 1.0])}, "normalised K"),
    ({"K": K * 2}, "expected rows fx s cx"),
    ({"depth_m": np.full(SHAPE, 800, np.uint16)}, "divide millimetres by 1000"),
    ({"depth_m": (picture()[0] * 1000).astype(np.uint16)}, "uint16"),
    ({"depth_m": np.ones(SHAPE, int)}, "int64"),
    ({"depth_m": np.zeros(SHAPE)}, "no measured pixel"),
    ({"rgb": np.zeros((60, 80, 3), np.uint8)}, "uint8"),
    ({"gravity_cam": (0, 0, 0)}, "no direction"),
)


def test_a_frame_or_a_folder_that_cannot_be_used_is_refused_at_once(tmp_path: Path) -> None:
    for given, message in UNUSABLE:
        with pytest.raises(ValueError, match=message):
            Trace(tmp_path / "t", **{"K": K, "depth_m": picture()[0], **given})  # pyright: ignore[reportArgumentType]
        assert not (tmp_path / "t").exists()
    for name in ("t", "\x1b[31m"):
        (tmp_path / name).write_text("a file")
    for folder, message in (
        (None, "expected a path"),
        (b"t", "expected a path"),
        (tmp_path / ("a" * 300), "File name too long"),
        (tmp_path / "t", "is a file"),
        (tmp_path / "\x1b[31m", "is a file"),
    ):
        with pytest.raises((ValueError, OSError), match=message) as error:
            Trace(folder, K, picture()[0])  # pyright: ignore[reportArgumentType]
        assert str(error.value).isprintable(), folder


def test_a_second_trace_in_a_folder_gets_a_name_of_its_own(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "box.obj")
    first, second = write_trace(tmp_path / "runs" / "t", mesh), write_trace(tmp_path / "runs" / "t", mesh)
    assert (first.folder.name, second.folder.name, second.n_problems) == ("t", "t-2", 1)
    assert [path.name for path in traces_in(tmp_path / "runs")] == ["t", "t-2"]
    assert len(problem_of(tmp_path / "runs", "0/2").instances[0].recorded) == 7


def test_lines_that_are_damaged_are_left_out_and_a_trace_without_a_head_is_refused(tmp_path: Path) -> None:
    write_trace(tmp_path / "t", write_box(tmp_path / "box.obj"))
    calls = tmp_path / "t" / "calls.jsonl"
    lines = calls.read_bytes().splitlines()
    calls.write_bytes(b"\n".join([*lines[:4], b"\xff{", *lines[4:7], lines[7][:30]]))
    frame = read_trace(tmp_path / "t")
    assert len(frame.objects[0].steps) == 3
    assert any("2 lines " in note and "line 5: " in note for note in frame.notes)
    assert any("cut short" in note for note in frame.notes)
    another = json.dumps({**json.loads(lines[0]), "trace": 99}).encode()
    for content, message in ((b"\n".join([another, *lines[1:]]), "another version"), (b"", "not begun")):
        calls.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_trace(tmp_path / "t")


@pytest.mark.usefixtures("processes")
def test_a_killed_process_leaves_a_trace_that_opens(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "box.obj")
    program = (
        "import sys, numpy as np\n"
        "from tests.scenes.test_trace import K, picture, pose\n"
        "from verefine_viz.trace import Trace\n"
        "depth, mask = picture()\n"
        "trace = Trace(sys.argv[1], K=K, depth_m=depth)\n"
        "box = trace.object('box', mesh=sys.argv[2], mask=mask, unit_m=0.001)\n"
        "box.hypothesis(0, pose(20))\n"
        "for k in range(10**9):\n"
        "    box.step(0, pose(20 - 0.001 * k), score=0.5)\n"
        "    if k == 99: print('now', flush=True)\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "t"), str(mesh)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]) as process:
        assert process.stdout.readline() == b"now\n"
        os.kill(process.pid, signal.SIGKILL)
    problem = problem_of(tmp_path / "t")
    assert len(problem.instances[0].recorded) >= 100
    assert any("cut short" in note for note in problem.notes)


def test_a_copy_of_the_file_needs_numpy_alone_and_an_old_python() -> None:
    source = (Path(__file__).parents[2] / "verefine_viz" / "trace.py").read_text()
    tree = ast.parse(source, feature_version=(3, 8))
    at_run_time = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {alias.name for node in at_run_time if isinstance(node, ast.Import) for alias in node.names}
    names |= {f"{node.module}.{a.name}" for node in at_run_time if isinstance(node, ast.ImportFrom) for a in node.names}
    stdlib = {"json", "logging", "math", "os", "re", "shutil", "time", "pathlib.Path", "__future__.annotations"}
    typing = {"numbers.Real", "typing.TYPE_CHECKING", "typing.Any", "typing.BinaryIO"}
    assert names == stdlib | typing | {"numpy", "urllib.parse.unquote"}


def test_frames_have_the_number_of_their_name_where_it_is_clear() -> None:
    for names, numbers in (
        (("drop_17", "drop_3"), (17, 3)),
        (("a_1", "b_1"), (1, 2)),
        (("000001", "000005"), (1, 5)),
        (("1581120424100262102", "1581120424148532296"), (1, 2)),
        (("mug", "bowl"), (1, 2)),
    ):
        assert [k for _, k in frame_ids(names)] == [*numbers]


def test_a_trace_opens_without_solids_for_a_simulator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Making them may take minutes, and nothing is simulated."""
    write_trace(tmp_path / "t", write_box(tmp_path / "box.obj"), with_table=True)
    made: list[str] = []
    monkeypatch.setattr(BulletSimulator, "collider", lambda self, model, progress=None: made.append(model.name))
    toolbox = Toolbox(open_session(tmp_path / "t", {}))
    problem = toolbox.problem(toolbox.frames[0])
    assert problem.observation.support is not None
    run = toolbox.run(problem)
    run.finish()
    assert run.length == 7
    assert made == []
    Toolbox(open_session(tmp_path / "t", {"method": {"name": "rir"}})).problem(toolbox.frames[0])
    assert made == ["box"]


def test_what_a_trace_holds_in_silence_is_named(tmp_path: Path) -> None:
    mesh, folder = write_box(tmp_path / "box.obj"), tmp_path / "traces"
    for name in ("whole", "damaged", "undeclared", "millimetres", "far"):
        write_trace(folder / name, mesh)
    (folder / "damaged" / "calls.jsonl").write_bytes(b"\0garbage" * 100)
    line = {"step": 0, "object": 7, "T": pose().ravel().tolist(), "name": "icp"}
    with (folder / "undeclared" / "calls.jsonl").open("a") as file:
        file.write(json.dumps(line) + "\n")
    depth = np.load(folder / "far" / "depth.npy") * 1000
    np.save(folder / "millimetres" / "depth.npy", depth.astype(np.uint16))
    np.save(folder / "far" / "depth.npy", depth)
    for name in ("x" * 280, "x" * 5000):  # The first is a name that no system takes, the second none of a trace.
        calls = write_trace(folder / f"long {len(name)}", mesh).folder / "calls.jsonl"
        calls.write_text(calls.read_text().replace("mesh_0/box.obj", name))
    for path in folder.rglob("*"):
        os.utime(path, (1e9, 1e9))
    left_out = left_out_of(folder)
    assert [one.partition(" (")[0] for one in left_out] == ["damaged", "long 280"]
    assert "damaged (damaged)" in data_at(folder, {}).notes[0]
    assert any("1 line " in note and "$.mesh" in note for note in read_trace(folder / "long 5000").notes)
    (note,) = read_trace(folder / "undeclared").notes
    assert "number 7" in note
    assert read_trace(folder / "whole").notes == ()
    for name, said in (("millimetres", "uint16"), ("far", "800")):
        with pytest.raises(InputError, match=said):
            read_trace(folder / name)
