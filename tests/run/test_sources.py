"""Data that a session names and its source would not look at: refused, unless the source was chosen with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from verefine_viz.core.errors import SettingsError
from verefine_viz.run.session_file import load_session, resolve, save_session

ROOT = Path(__file__).resolve().parents[2]


FORGOTTEN: tuple[tuple[dict[str, Any], str], ...] = (
    (
        {"hypotheses": {"files": ["a.csv"]}},
        r'hypotheses.files is set, but hypotheses.source is "perturb" .*; set hypotheses.source = "results"',
    ),
    ({"scene": {"dataset": "d"}}, r'scene.dataset is set, but scene.source is "demo" .*; set scene.source = "bop"'),
    ({"ppf": {"step": 0.1}}, r'\[ppf\] is set, but hypotheses.source is "perturb" .*; set .* = "ppf", or write'),
    ({"ppf": {"step": 0.1}, "hypotheses": {"estimate": [["0/0", 0, "pcs"]]}}, r"\[ppf\] is set, but"),
)
CHOSEN: tuple[dict[str, Any], ...] = (
    {"hypotheses": {"files": ["a.csv"], "source": "perturb"}},
    {"hypotheses": {"files": ["a.csv"], "source": "results"}},
    {"scene": {"dataset": "d", "source": "demo"}},
    {"scene": {"dataset": "d", "demo": "mug", "source": "bop"}},
    {"ppf": {"step": 0.1}, "hypotheses": {"source": "ppf"}},
    {"ppf": {"step": 0.1}, "hypotheses": {"estimate": [["0/0", 0, "ppf"]]}},
)


def test_a_forgotten_source_is_named() -> None:
    for raw, expected in FORGOTTEN:
        with pytest.raises(SettingsError, match=f"^session: {expected}"):
            resolve(raw)


def test_a_source_that_was_chosen_is_taken() -> None:
    for raw in CHOSEN:
        session = resolve(raw)
        for section in ("scene", "hypotheses"):
            source = raw.get(section, {}).get("source")
            assert source is None or getattr(session, section).source == source


def test_what_is_typed_over_a_file_needs_a_source_that_reads_it(tmp_path: Path) -> None:
    demo, bop = tmp_path / "demo.toml", tmp_path / "bop.toml"
    demo.write_text('[scene]\nsource = "demo"\n[hypotheses]\nsource = "perturb"\n')
    bop.write_text('[scene]\nsource = "bop"\ndataset = "d"\n[hypotheses]\nsource = "results"\nfiles = ["a.csv"]\n')
    for typed in ({"scene": {"dataset": "d"}}, {"hypotheses": {"files": ("a.csv",)}}):
        with pytest.raises(SettingsError, match=r"^command line: .* is set, but"):
            load_session(demo, typed)
    with pytest.raises(SettingsError, match=r'^command line: scene.demo is set, but scene.source is "bop"'):
        load_session(bop, {"scene": {"demo": "bowl"}})
    assert load_session(demo, {"scene": {"dataset": "d", "source": "bop"}}).scene.source == "bop"
    assert load_session(bop, {"scene": {"dataset": "e"}}).scene.dataset.endswith("e")
    # The file's results stay named when somebody asks for another source.
    assert load_session(bop, {"hypotheses": {"source": "ppf"}}).hypotheses.source == "ppf"
    assert load_session(bop, {"scene": {"source": "demo"}}).scene.source == "demo"


def test_a_file_named_twice_is_refused_however_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(
        '[hypotheses]\nsource = "results"\nfiles = ["a.csv", "b.csv", "../x/a.csv"]\n'.replace("x", tmp_path.name)
    )
    with pytest.raises(SettingsError, match=rf"^{path}: hypotheses.files names {tmp_path}/a.csv twice; name each"):
        load_session(path)
    assert len(load_session(path, {"hypotheses": {"files": ("a.csv", "b.csv")}}).hypotheses.files) == 2


def test_sessions_that_come_along_load_and_so_do_saved_ones(tmp_path: Path) -> None:
    paths = sorted((ROOT / "sessions").glob("*.toml"))
    assert len(paths) > 10
    for path in paths:
        for source in (None, "perturb", "pcs"):
            session = load_session(path, {"hypotheses": {"source": source}} if source else None)
            assert session.title, path
            save_session(session, tmp_path / "saved.toml")
            assert load_session(tmp_path / "saved.toml") == session, path
