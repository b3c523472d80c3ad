"""Whatever lies in the files: a problem that can be solved, or one line. Never a traceback, a hang, or a write.

Each case spoils one file of a folder of some kind and opens it. VEREFINE_FUZZ="600" has it go on for so many seconds,
"600 5000" from that number on.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from msgspec import structs
from PIL import Image

from tests.learned.tiny_network import constant_network
from tests.made_runs import answer, finished, written
from tests.recording.runs import run_file, session
from tests.scenes.bop_folder import detections, make
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_graspa_layout import _layout
from tests.scenes.test_image_files import to_array
from tests.scenes.test_layouts import CASES
from tests.scenes.test_mesh_colours import textured_ply, write_gltf, write_obj
from tests.scenes.test_trace import write_box, write_trace
from verefine_viz import cli
from verefine_viz.batch.answer_tags import read_tags
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.motion_table import MOTION, MotionRow, read_tracks, write_motion
from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, PhysicsSettings, SceneSettings, Session
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.grasping.grasp_poses import read_annotated
from verefine_viz.learned.depth_crops import FORMAT
from verefine_viz.learned.onnx_network import OnnxNetwork
from verefine_viz.observation.given_order import read_orders
from verefine_viz.recording.reader import read_recording
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.imported_folder import imported
from verefine_viz.run.session_file import load_session, save_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.graspa_layout import read_layout
from verefine_viz.scenes.meshes import FORMATS, read_geometry, read_mesh
from verefine_viz.scenes.models import model_of_mesh
from verefine_viz.scenes.results_csv import ResultRow, write_results

SECONDS, FIRST = (*map(int, os.environ.get("VEREFINE_FUZZ", "25").split()), 0)[:2]
LONGEST_S, LONGEST_LINE = 60.0, 1200
METHOD, NO_PHYSICS = MethodSettings(name="refine", refiner="identity"), PhysicsSettings(enabled=False)
QUICK = {"physics": {"enabled": False}}
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2.5, 1e-300, 1e308, -1e30, 10**30, 65535, float("nan"), float("inf"), "", "x", "\ud800",
    "a\0b", "\x1b[2J\n", "../..", "/dev/zero", "9" * 5000, [], {}, [[]], [1] * 9, [1] * 17, [[1], [1, 2]], {"a": None},
    [None], [{}], "y" * 100_000,
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of input: what writes a good folder, and what opens it."""

    write: Callable[[Path], object]
    open: Callable[[Path], object]


def write_bop(folder: Path) -> None:
    made = make(folder)
    (folder / "det.json").write_text(json.dumps(detections(made)))
    (folder / "models/obj_names.json").write_text('{"2": "a", "5": "b"}')
    rows = [ResultRow(7, 3, i.obj_id + 1, 0.5, T) for i, T in zip(made.problem.instances, made.truth, strict=True)]
    write_results(folder / "est_x-test.csv", [*rows, ResultRow(7, 3, 5, 0.5, made.truth[1])])


def open_bop(folder: Path) -> None:
    for masks in ("mask_visib", str(folder / "det.json")):
        scene = SceneSettings(source="bop", dataset=str(folder), model_points=50, masks=masks)
        files = HypothesesSettings(source="results", files=(str(folder / "est_x-test.csv"),))
        for hypotheses in (HypothesesSettings(), files):
            with suppress(VerefineError):
                session = Session(scene=scene, hypotheses=hypotheses)
                solve(Toolbox(structs.replace(session, method=METHOD, physics=NO_PHYSICS)))
    evaluate_files([folder / "est_x-test.csv"], folder)


def check_bop(folder: Path) -> None:
    for words in (("datasets", "check", folder), ("evaluate", folder / "est_x-test.csv", "--dataset", folder)):
        assert cli.main([str(word) for word in words]) in (0, 1, 2)


def solve(tools: Toolbox) -> None:
    for frame in tools.frames:
        answers = tools.run(tools.problem(frame)).finish().best
        assert all(best is None or np.isfinite(best.T_cam_obj).all() for best in answers)


def open_folder(folder: Path) -> None:
    solve(Toolbox(open_session(folder, QUICK)))


def open_layout(opened: str, folder: Path) -> None:
    open_folder(folder / opened)


def import_folder(folder: Path) -> None:
    assert all("Traceback" not in line for line in imported(folder, folder.with_name(f"{folder.name}-out")))


def write_meshes(folder: Path) -> None:
    folder.mkdir()
    textured_ply(folder, True)
    trimesh.creation.box((1, 2, 3)).export(folder / "a.ply")
    (folder / "b.ply").write_text(textured_ply(folder / "..", False).read_text())
    trimesh.creation.box((1, 2, 3)).export(folder / "b.stl")
    trimesh.creation.box((1, 2, 3)).export(folder / "c.glb")
    for name, content in trimesh.creation.box((1, 2, 3)).export(file_type="gltf").items():
        (folder / name).write_bytes(content)
    (folder / "m.mtl").write_text("newmtl m\nKd 1 0 0\nmap_Kd skin.png\n")
    write_gltf(folder, "gltf")
    text = "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    (folder / "d.obj").write_text(text)


def open_meshes(folder: Path) -> None:
    for path in sorted(path for path in folder.iterdir() if path.suffix in FORMATS):
        for read in (lambda path: model_of_mesh(read_mesh(path, 1e-3), 1, "a", 10, 0), read_geometry):
            with suppress(VerefineError):
                read(path)


def write_some(folder: Path) -> None:
    folder.mkdir()
    run_file(folder / "run.vfrun", session(maps=False, iterations=2))
    (folder / "net.onnx").write_bytes(constant_network(np.ones(7)))
    (folder / "orders.json").write_text('{"0/1": [[8, 2], ["#3"]]}')
    np.save(folder / "grasps.npy", np.tile(np.eye(4), (3, 1, 1)))
    _layout(folder)
    save_session(Session(), folder / "session.toml")


def open_some(folder: Path) -> None:
    model = model_of_mesh(BOX, 1, "box", 50, 0)
    for read in (
        lambda: read_recording(folder / "run.vfrun"),
        lambda: OnnxNetwork(folder / "net.onnx", "depth_net", FORMAT),
        lambda: read_orders(folder / "orders.json"),
        lambda: read_annotated(folder / "grasps.npy", model, GraspSettings()),
        lambda: read_layout(folder / "layout.xml"),
        lambda: load_session(folder / "session.toml"),
    ):
        with suppress(VerefineError):
            read()


def write_batch(folder: Path) -> None:
    folder.mkdir()
    save_session(Session(), folder / "session.toml")
    for k in range(3):
        written(folder, finished(f"1/{k}", [answer(1, k, obj_id=1, instance_id=0, name="a", score=0.5)]))
    (folder / "run.json").write_text('{"status": "finished", "totals": {"frames": 3, "objects": 3}}')
    (folder / "tags.json").write_text('{"tags": {"1/0#0": ["good"]}}')
    row = {"scene_id": 1, "im_id": 0, "track": "1", "obj_id": 1, "name": "a", "kind": "moved", "reference": "camera"}
    write_motion(folder / MOTION, [MotionRow(**row, moved_mm=0.0, turned_deg=0.0)])


def open_batch(folder: Path) -> None:
    for read in (read_tags, read_tracks, read_batch):
        with suppress(VerefineError):
            read(folder)


BOX: Any = None
KINDS: dict[str, Kind] = {
    "bop": Kind(write_bop, open_bop),
    "bop, checked": Kind(write_bop, check_bop),
    "traces": Kind(lambda folder: _traces(folder), open_folder),
    "traces, imported": Kind(lambda folder: _traces(folder), import_folder),
    "layout of FoundationPose": Kind(lambda folder: write_sequence(folder, 1), open_folder),
    "arrays": Kind(lambda folder: _arrays(folder), open_folder),
    **{f"layout {k}": Kind(case.write, partial(open_layout, case.opened)) for k, case in enumerate(CASES)},
    "meshes": Kind(write_meshes, open_meshes),
    "single files": Kind(write_some, open_some),
    "batch": Kind(write_batch, open_batch),
}


def _traces(folder: Path) -> None:
    folder.mkdir()
    mesh = write_obj(folder.with_name(f"{folder.name}.mesh"), "textures/skin.png")
    (mesh.parent / "textures").mkdir()
    (mesh.parent / "skin.png").rename(mesh.parent / "textures/skin.png")
    for k, one in ((1, mesh), (2, write_box(folder.with_name(f"{folder.name}.obj")))):
        write_trace(folder / f"drop_{k}", one)


def _arrays(folder: Path) -> None:
    write_sequence(folder, 1)
    for kind, dtype in (("depth", np.uint16), ("masks", np.bool_)):
        for path in [*(folder / kind).iterdir()]:
            to_array(path, dtype)


# How a file is spoilt.


def with_a_value(path: Path, rng: random.Random) -> None:
    """Put any value somewhere into a JSON file, or a line of JSON; into another text some word."""
    text, value = path.read_text("latin-1"), rng.choice(VALUES)
    lines = text.splitlines(keepends=True) if path.suffix == ".jsonl" else [text]
    k = rng.randrange(len(lines)) if lines else 0
    try:
        lines[k] = json.dumps(_replaced(json.loads(lines[k]), value, rng)) + "\n"
        path.write_text("".join(lines))
    except (ValueError, IndexError):
        words = text.split(" ")
        words[rng.randrange(len(words))] = json.dumps(value) if rng.random() < 0.5 else str(value)
        path.write_text(" ".join(words), errors="replace")


def _replaced(content: Any, value: Any, rng: random.Random) -> Any:
    keys = [*content] if isinstance(content, dict) else [*range(len(content))] if isinstance(content, list) else []
    if not keys or rng.random() < 0.15:
        return value
    key, copy = rng.choice(keys), content.copy()
    if rng.random() < 0.1:
        del copy[key]
    else:
        copy[key] = _replaced(content[key], value, rng)
    return copy


def cut_off(path: Path, rng: random.Random) -> None:
    path.write_bytes(path.read_bytes()[: rng.randrange(path.stat().st_size + 1)])


def with_other_bytes(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    for _ in range(rng.randrange(1, 6)):
        content[rng.randrange(len(content))] = rng.randrange(256)
    path.write_bytes(content)


def swapped(path: Path, rng: random.Random) -> None:
    others = sorted(other for other in path.parents[1].rglob("*") if other.is_file() and other != path)
    path.write_bytes(rng.choice(others).read_bytes() if others else b"")


def no_file(path: Path, rng: random.Random) -> None:
    path.unlink()
    rng.choice((
        lambda: None, path.mkdir, lambda: os.mkfifo(path), lambda: path.symlink_to(path.name),
        lambda: path.symlink_to("/dev/zero"), lambda: path.symlink_to("nowhere"), lambda: path.symlink_to(path.parent),
    ))()  # fmt: skip


def another_image(path: Path, rng: random.Random) -> None:
    """Write an image of another size or type, or an array of another kind, where there is one."""
    kinds = (np.uint8, np.uint16, np.float32, np.float64, np.complex64, np.bool_, np.int64)
    array = np.full(rng.choice(((60, 80), (1, 1), (60, 80, 3), (60, 80, 4), (0, 5), (120, 160))), 7, rng.choice(kinds))
    with suppress(Exception):
        np.save(path, array) if path.suffix == ".npy" else Image.fromarray(array).save(path)


def renamed(path: Path, rng: random.Random) -> None:
    names = ("\x1b[31mred", "\udcff", "a\nb", "\u202e", "x" * 250, "-s 1 1 1", "..", "%2e%2e", "\\", " ")
    path = path if path.parent.name == "it" else rng.choice((path, path.parent))
    with suppress(OSError):
        path.rename(path.with_name(rng.choice(names) + path.suffix))


SPOILS = (renamed, with_a_value, with_a_value, with_a_value, cut_off, with_other_bytes, swapped, no_file, another_image)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A good folder of each kind, opened once."""
    global BOX
    root = tmp_path_factory.mktemp("good")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(root / "box.stl")
    BOX = read_mesh(root / "box.stl", 1.0)
    folders = {}
    for k, (name, kind) in enumerate(KINDS.items()):
        folders[name] = root / f"kind{k}" / "it"
        folders[name].parent.mkdir()
        kind.write(folders[name])
        kind.open(folders[name])
    return folders


def test_whatever_lies_in_the_files_it_is_a_problem_or_one_line(
    good: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    end, number, faults, answers = time.monotonic() + SECONDS, FIRST, list[str](), Counter[str]()
    while time.monotonic() < end and len(faults) < 20:
        rng = random.Random(number)
        name = rng.choice([*KINDS])
        place = tmp_path / str(number)
        place.mkdir()
        shutil.copytree(good[name], place / "it")
        files = sorted(path for path in (place / "it").rglob("*") if path.is_file())
        path, spoil = rng.choice(files), rng.choice(SPOILS)
        spoil(path, rng)
        before, started = _listing(place), time.monotonic()
        what = f"case {number}, {name}: {spoil.__name__} {path.relative_to(place)}"
        try:
            KINDS[name].open(place / "it")
            answers[name, "solved"] += 1
        except VerefineError as error:
            answers[name, "one line"] += 1
            if not (str(error).isprintable() and 0 < len(str(error)) < LONGEST_LINE):
                faults.append(f"{what}: {error!s:.300}")
        except Exception:
            faults.append(f"{what}:\n{traceback.format_exc(limit=-6)}")
        if time.monotonic() - started > LONGEST_S:
            faults.append(f"{what}: {time.monotonic() - started:.0f} s")
        if before != _listing(place):
            faults.append(f"{what}: wrote {_listing(place) ^ before}")
        shutil.rmtree(place)
        number += 1
    capsys.readouterr()
    print(f"fuzz: {number - FIRST} cases, {dict(answers)}", file=sys.stderr)
    assert not faults, "\n".join(faults)
    assert number - FIRST > 20


def _listing(place: Path) -> set[str]:
    return {str(path) for path in place.rglob("*") if not path.relative_to(place).parts[0].endswith("-out")}
