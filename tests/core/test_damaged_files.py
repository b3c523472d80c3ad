"""Whatever lies in a file that is read: one line in words of this program, with what a library said as its context."""

from __future__ import annotations

import ast
import json
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
import scipy.io
import trimesh
from PIL import Image

import verefine_viz
from tests.learned.tiny_network import constant_network
from tests.recording.runs import run_file, session
from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.files import Numbered, Numbers3x3, Numbers4x4, read_json, read_yaml
from verefine_viz.grasping.grasp_poses import read_annotated
from verefine_viz.learned.depth_crops import FORMAT
from verefine_viz.learned.onnx_network import OnnxNetwork
from verefine_viz.recording.reader import read_recording
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.detections import mask_of
from verefine_viz.scenes.graspa_layout import read_layout
from verefine_viz.scenes.image_files import read_color, read_depth
from verefine_viz.scenes.mat_file import mat_arrays
from verefine_viz.scenes.meshes import read_geometry, read_mesh
from verefine_viz.scenes.recorded_frame import numbers_in
from verefine_viz.scenes.results_csv import read_results
from verefine_viz.scenes.results_files import read_estimates

LAYOUT = (
    '<A><ManipulationObject name="YcbBanana"><T><Matrix4x4>'
    + "".join(f'<row{k} c1="{k == 1:d}" c2="{k == 2:d}" c3="{k == 3:d}" c4="5"/>' for k in (1, 2, 3))
    + "</Matrix4x4></T></ManipulationObject></A>"
)
CSV = "scene_id,im_id,obj_id,score,R,t,time\n1,2,3,0.5,1 0 0 0 1 0 0 0 1,1 2 3,0.1\n"
Read = Callable[[Path], object]


def _good(folder: Path) -> dict[str, list[Read]]:
    """A good file of each kind, and what reads it."""
    folder.mkdir()
    box = trimesh.creation.box((1, 2, 3))
    for ending in ("ply", "obj", "stl", "glb"):
        box.export(folder / f"a.{ending}")
    box.export(folder / "ascii.ply", encoding="ascii")
    Image.effect_noise((8, 6), 50).save(folder / "a.png")
    Image.effect_noise((8, 6), 50).save(folder / "a.jpg")
    np.save(folder / "pose.npy", np.eye(4))
    np.save(folder / "grasps.npy", np.tile(np.eye(4), (3, 1, 1)))
    one = np.ones(1)
    np.savez(folder / "a.npz", scene_id=one, im_id=one, obj_id=one, poses=np.eye(4)[None])
    (folder / "pose.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (folder / "a.json").write_text(json.dumps({"1": {"K": [1] * 9}, "2": {"K": [1] * 9}}))
    (folder / "a.yml").write_text("1: {2: {3: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}\n")
    (folder / "a.csv").write_text(CSV)
    (folder / "a.toml").write_text('title = "a"\n[method]\nname = "rir"\n[scene]\ndemo = "mug"\n')
    (folder / "a.xml").write_text(LAYOUT)
    scipy.io.savemat(folder / "a.mat", {"poses": np.eye(4)})
    (folder / "a.onnx").write_bytes(constant_network(np.ones(7)))
    run_file(folder / "a.vfrun", session(maps=False, iterations=2))
    model = cast(Any, SimpleNamespace(points=np.array([[0, 0, 0.04]]), name="box", obj_id=1))
    mesh: list[Read] = [lambda path: read_mesh(path, 1.0), read_geometry]
    kind = dict[int, dict[int, dict[int, Numbers4x4]]]
    return {
        **dict.fromkeys(("a.ply", "ascii.ply", "a.obj", "a.stl", "a.glb"), mesh),
        **dict.fromkeys(("a.png", "a.jpg"), cast(list[Read], [read_color, lambda path: read_depth(path, 1.0)])),
        "pose.npy": [numbers_in],
        "pose.txt": [numbers_in],
        "grasps.npy": [lambda path: read_annotated(path, model, GraspSettings())],
        "a.npz": [read_estimates],
        "a.json": [
            lambda path: read_json(path, dict[int, _Camera]),
            lambda path: [*Numbered(path, _Camera, "image").values()],
        ],
        "a.yml": [lambda path: read_yaml(path, kind), read_estimates],
        "a.csv": [read_results, read_estimates],
        "a.toml": [load_session],
        "a.xml": [read_layout],
        "a.mat": [lambda path: mat_arrays(path, "poses")],
        "a.onnx": [lambda path: OnnxNetwork(path, "depth_net", FORMAT)],
        "a.vfrun": [read_recording],
    }


class _Camera(msgspec.Struct):
    K: Numbers3x3


def _damages(content: bytes, others: list[bytes]) -> Iterator[tuple[str, bytes]]:
    rng = np.random.default_rng(0)
    yield "empty", b""
    yield "blank", b"\n"
    for share in (0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        yield f"cut off at {share:.0%}", content[: int(share * len(content))]
    for k, other in enumerate(others):
        yield f"another kind of file ({k})", other
    yield "random bytes", rng.bytes(500)
    yield "random bytes after its head", content[:12] + rng.bytes(500)
    for old, new in (
        (b"property float z", b"property float q"), (b"property double z", b"property double q"),
        (b"vertex_indices", b"vertex_indexes"), (b"element vertex 8", b"element vertex 9"),
        (b"element face 12", b"element face 99999999"), (b"1", b"x"), (b"0", b"\xff"), (b"K", b"q"), (b"[", b"{"),
        (b":", b""), (b"c4", b"c5"), (b"poses", b"pases"), (b"int32", b"int99"), (b"name", b"nume"), (b'"', b""),
        (b"(4, 4)", b"(4, 9)"), (b"<f8", b"|O8"), (b"v ", b"v z "), (b"f ", b"f 9999999/"), (b"\x00", b"\x01"),
    ):  # fmt: skip
        if old in content:
            yield f"{new!r} for {old!r}", content.replace(old, new)
    for k in range(20):
        spoilt = bytearray(content)
        for at in rng.integers(len(content), size=4):
            spoilt[at] = rng.integers(256)
        yield f"other bytes ({k})", bytes(spoilt)


def _said_by_libraries(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        # Those of JSON and TOML name the line and what is expected there; the system's are in the user's language.
        if not isinstance(error, VerefineError | msgspec.MsgspecError | tomllib.TOMLDecodeError | OSError):
            yield error
        error = error.__context__


def test_a_damaged_file_is_refused_in_words_of_this_program(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    readers = _good(tmp_path / "good")
    contents = {name: (tmp_path / "good" / name).read_bytes() for name in readers}
    place, n, faults = tmp_path / "bad", 0, list[str]()
    place.mkdir()
    for name, reads in readers.items():
        path = place / name
        others = [content for other, content in contents.items() if other != name]
        for what, content in [("whole", contents[name]), *_damages(contents[name], others)]:
            path.write_bytes(content)
            for read in reads:
                try:
                    read(path)
                except VerefineError as error:
                    n += 1
                    line = str(error)
                    raw = [str(one).strip() for one in _said_by_libraries(error)]
                    names = {type(one).__name__ for one in _said_by_libraries(error)}
                    foreign = [text for text in (*raw, *names) if len(text) > 3 and text[:40] in line]
                    if foreign or not (path.name in line and line.isprintable() and len(line) < 700) or what == "whole":
                        faults.append(f"{name}, {what}: {line}  <- {foreign}")
                except Exception as error:
                    faults.append(f"{name}, {what}: {type(error).__name__}: {error}")
    assert not faults, "\n".join(faults)
    assert n > 500
    assert capfd.readouterr() == ("", "")


def test_what_a_file_lacks_is_named(tmp_path: Path) -> None:
    head = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n{}element face 1\n{}end_header\n"
    )
    body, z, faces = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "property float z\n", "property list uchar int vertex_index\n"
    lines = (
        ("a.ply", head.format("", faces) + body, "the PLY has no z"),
        ("b.ply", head.format(z, "property list uchar int corner\n") + body, "the PLY has no vertex_indices"),
        ("c.ply", "solid a", "it does not begin as a PLY file does"),
        ("d.txt", "1 2 x", "it holds words, expected numbers alone"),
        ("e.xml", LAYOUT.replace('c1="1"', 'c1="x"'), "expected a Matrix4x4 of finite numbers"),
        ("f.onnx", "x" * 99, "it cannot be read as an ONNX network: it is damaged, or of another kind"),
        ("g.yml", "a: [1\nb: 2", "not YAML from line 2, column 2 on"),
        ("h.yml", "a: &x 1\nb: *x", "aliases (*) are not read"),
        ("i.yml", "a: 1\n---\nb: 2", "not YAML from line 2, column 1 on"),
    )
    reads: dict[str, Read] = {
        ".ply": lambda path: read_mesh(path, 1.0), ".txt": numbers_in, ".xml": read_layout,
        ".onnx": lambda path: OnnxNetwork(path, "depth_net", FORMAT), ".yml": lambda path: read_yaml(path, dict),
    }  # fmt: skip
    for name, content, message in lines:
        path = tmp_path / name
        path.write_text(content)
        with pytest.raises(VerefineError) as error:
            reads[path.suffix](path)
        assert message in str(error.value), name
    (tmp_path / "whole.ply").write_text(head.format(z, faces) + body)
    assert len(read_mesh(tmp_path / "whole.ply", 1.0).faces) == 1


def test_readers_raise_what_is_shown() -> None:
    """An error of Python counts as a library's, whose words are not shown: what a reader says is a ContentError."""
    package = Path(verefine_viz.__file__).parent
    found = [
        f"{path.relative_to(package)}:{node.lineno}"
        for folder in ("scenes", "grasping", "learned", "core", "evaluation/ground_truth.py", "physics/given_parts.py")
        for path in ([package / folder] if folder.endswith(".py") else (package / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Raise) and node.exc is not None and ast.unparse(node.exc).startswith("ValueError(")
    ]
    assert not found


def test_what_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    n = 500_001
    ids = np.zeros(n, np.int8)
    np.savez_compressed(tmp_path / "a.npz", scene_id=ids, im_id=ids, obj_id=ids, poses=np.zeros((n, 3, 4), np.int8))
    with pytest.raises(VerefineError, match="it has 500001 poses, expected at most 500000"):
        read_estimates(tmp_path / "a.npz")
    one = np.ones(1)
    np.savez(tmp_path / "b.npz", scene_id=one, im_id=1.5 * one, obj_id=one, poses=np.eye(4)[None])
    with pytest.raises(VerefineError, match="entry 0: expected the numbers of scene, image and object"):
        read_estimates(tmp_path / "b.npz")
    mask = {"size": [6, 8], "counts": [0, 0] * 500 + [48]}
    for counts in (mask["counts"], "0" * 2000):
        raw = msgspec.Raw(json.dumps({**mask, "counts": counts}).encode())
        with pytest.raises(VerefineError, match="'segmentation' is larger than a mask of 8×6 pixels can be"):
            mask_of(raw, (6, 8), "a.json, entry 0")
    assert mask_of(msgspec.Raw(json.dumps({"size": [6, 8], "counts": [1] * 48}).encode()), (6, 8), "").sum() == 24
