"""Sessions that come with the package are opened by their names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from verefine_viz.page.openable import read_openable

from verefine_viz.core.errors import InputError
from verefine_viz.run.built_in_sessions import built_in_sessions, named_session
from verefine_viz.run.data_folder import open_session


def test_a_name_is_a_session_and_a_file_of_that_name_goes_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert {"mug", "clutter", "ycbv"} <= built_in_sessions().keys()
    for name in ("mug", "clutter"):
        assert open_session(Path(name), {}).scene.demo == name
        assert read_openable(Path(name)).session.scene.demo == name
    (tmp_path / "mug").mkdir()
    assert named_session(Path("mug")) == Path("mug")
    assert named_session(Path("x/clutter")) == Path("x/clutter")
    with pytest.raises(
        InputError, match=r"muk does not exist, and is no session; did you mean 'mug'.* clutter, .*ycbv_densefusion"
    ):
        named_session(Path("muk"))


@pytest.mark.usefixtures("processes")
def test_the_package_is_a_program(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "verefine_viz", "batch", "clutte", "--out", "x"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "did you mean 'clutter'" in done.stderr
