"""A folder of run files none of which has an answer."""

from __future__ import annotations

from pathlib import Path

import pytest

from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.page.gallery import read_gallery
from verefine_viz.run.record import FORMAT, RunEnd, RunHeader
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.session_file import session_toml


def test_it_is_one_line(tmp_path: Path) -> None:
    file = RunFile(tmp_path / "a.vfrun", Session())
    file.begin(RunHeader(FORMAT, session_toml(Session()), "0/0", "", {}, ()))
    file.finish(RunEnd(answers=()))
    with pytest.raises(InputError, match=r"no run in .* has an answer; open one by itself"):
        read_gallery(tmp_path)
