"""Input files are regular files; anything else is one line at once, never a hang."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_file, read_json, reading
from verefine_viz.scenes.image_files import read_color
from verefine_viz.scenes.meshes import read_mesh


def test_a_regular_file_is_read_whole_also_through_a_link(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes(b"content")
    link.symlink_to(file)
    assert read_file(file) == read_file(link) == b"content"
    with reading(link) as opened:
        assert opened.read(3) == b"con"


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _loop(path: Path) -> None:
    path.symlink_to(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_pipe, "is a pipe, expected a file"),
        (_socket, "is a socket, expected a file"),
        (_device, "is a device, expected a file"),
        (Path.mkdir, "is a folder, expected a file"),
        (_loop, "cannot be read: Too many levels of symbolic links"),
        (lambda path: None, "does not exist"),
    ],
)
def test_what_is_no_file_is_named_with_its_label(tmp_path: Path, make, message: str) -> None:
    path = tmp_path / "it"
    make(path)
    with pytest.raises(InputError) as error:
        read_file(path, "session file")
    assert str(error.value) == f"session file {path} {message}"


def test_a_nul_in_a_path_is_said_so() -> None:
    with pytest.raises(InputError, match=r"'a\\x00b' is no path: it holds a NUL"):
        read_file(Path("a\0b"))


def _loaded(path: Path) -> None:
    with reading(path) as file:
        np.load(file)


def test_a_file_that_is_cut_off_or_empty_is_to_be_fetched_again(tmp_path: Path) -> None:
    Image.effect_noise((60, 80), 50).save(tmp_path / "a.png")
    Image.effect_noise((60, 80), 50).save(tmp_path / "a.jpg")
    trimesh.creation.icosphere().export(tmp_path / "a.ply")
    trimesh.creation.icosphere().export(tmp_path / "a.glb")
    (tmp_path / "a.json").write_text('{"1": [1, 2, 3], "2": [4, 5, 6]}')
    np.save(tmp_path / "a.npy", np.zeros(1000))
    readers = {".png": read_color, ".jpg": read_color, ".json": lambda path: read_json(path, dict), ".npy": _loaded}
    for path in sorted(tmp_path.iterdir()):
        read = readers.get(path.suffix, lambda path: read_mesh(path, 1.0))
        read(path)
        for n, why in ((path.stat().st_size // 2, "cut off"), (0, "empty")):
            path.write_bytes(path.read_bytes()[:n])
            with pytest.raises(InputError, match=f"it is {why}, fetch it again$"):
                read(path)
