"""docs/measured.md shows what its CSV files hold."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_measured", ROOT / "scripts" / "draw_measured.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_its_tables_are_those_of_the_files(script: ModuleType):
    assert script.filled(PAGE) == PAGE
    assert len(script.TABLE.findall(PAGE)) >= 15


def test_a_table_can_cross_two_columns(script: ModuleType):
    rows = [{"what": "a", "by": "x", "n": "1"}, {"what": "a", "by": "y", "n": "2"}, {"what": "b", "by": "y", "n": "3"}]
    assert script.crossed(rows, ["what"], "by", "n") == [
        {"what": "a", "x": "1", "y": "2"},
        {"what": "b", "x": "", "y": "3"},
    ]


def test_every_figure_is_shown_and_every_file_is_named(script: ModuleType):
    shown = re.findall(r"!\[[^\]]+\]\(measured/(\w+)\.svg\)", PAGE)
    assert sorted(shown) == sorted(script.FIGURES)
    for name in shown:
        svg = (script.FOLDER / f"{name}.svg").read_text(encoding="utf-8")
        assert script.fingerprint(name) in svg, f"{name}.csv has changed: make measured"
    files = {path.stem for path in script.FOLDER.glob("*.csv")}
    named = {match[2] for match in script.TABLE.finditer(PAGE)} | {*re.findall(r"measured/(\w+)\.csv", PAGE)}
    assert files == named


def test_figures_are_drawn_from_the_files(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    for path in script.FOLDER.glob("*.csv"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    text = (tmp_path / "verdicts.csv").read_text()
    (tmp_path / "verdicts.csv").write_text(text.replace("symmetric", "upside_down"))
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    script.draw("verdicts")
    assert "upside_down" in (tmp_path / "verdicts.svg").read_text()
