"""A folder, a made-up data set, and what the command line says about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.scenes.bop_folder import Made
from verefine_viz import cli


@dataclass(frozen=True)
class CommandLine:
    """What a case of bad input works with."""

    folder: Path
    made: Made
    capsys: pytest.CaptureFixture[str]

    def file(self, name: str, content: str | bytes = "") -> Path:
        """A file in the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def refused(self, *words: object, leaves: tuple[str, ...] = ()) -> str:
        """The one line with which these words are refused, without the program's name; they write nothing but below
        what ``leaves`` names.
        """
        before = {*self.folder.rglob("*")}
        assert cli.main([str(word) for word in words]) == 2
        captured = self.capsys.readouterr()
        assert captured.out == ""
        lines = captured.err.splitlines()
        assert len(lines) == 1, captured.err
        assert lines[0].startswith("verefine-viz: ")
        assert lines[0].isprintable()
        assert {path.relative_to(self.folder).parts[0] for path in {*self.folder.rglob("*")} - before} <= {*leaves}
        return lines[0].removeprefix("verefine-viz: ")
