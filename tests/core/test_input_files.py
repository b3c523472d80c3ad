"""Input files are regular files; anything else is one line at once, never a hang."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
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


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


NO_FILE: dict[str, Callable[[Path], object]] = {
    "is a pipe": os.mkfifo,
    "is a socket": _socket,
    "is a device": lambda path: path.symlink_to("/dev/zero"),
    "is a folder": Path.mkdir,
    "symbolic links": lambda path: path.symlink_to(path),
    "does not exist": lambda path: None,
}


@pytest.mark.parametrize("kind", NO_FILE)
def test_what_is_no_file_is_named_at_once(tmp_path: Path, kind: str) -> None:
    NO_FILE[kind](tmp_path / "it")
    with pytest.raises(InputError, match=f"session file {tmp_path / 'it'} .*{kind}"):
        read_file(tmp_path / "it", "session file")


def test_what_can_be_no_path_is_refused() -> None:
    for name in ("a\0b", "a\ud800b"):
        with pytest.raises(InputError):
            read_file(Path(name))


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
