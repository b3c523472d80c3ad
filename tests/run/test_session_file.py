"""Session files: round trip, presets, relative paths, and errors that name the field."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.inspect import StructType

from verefine_viz.core.algorithm_settings import DepthNetSettings
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.presets import PRESETS, preset_fields
from verefine_viz.core.setting_types import descriptions, fields_of
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import FILES, load_session, resolve, save_session


def write(folder: Path, text: str) -> Path:
    path = folder / "s.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_saved_sessions_load_the_same(tmp_path: Path) -> None:
    raw = {
        "preset": "published",
        "title": 'quotes " and \\ and ünïcode',
        "score": {"tau_m": 0.01},
        "breakpoints": {"jump_mm": 5.0},
        "edits": [{"after_iteration": 2, "instance": 1, "hypothesis": 0, "T_cam_obj": [0.1] * 16}],
        "changes": [{"after_iteration": 3, "settings": {"method": {"exploration": 0.3}}}],
    }
    session = resolve(raw)
    save_session(session, tmp_path / "out.toml")
    assert load_session(tmp_path / "out.toml") == session
    assert list(tmp_path.iterdir()) == [tmp_path / "out.toml"]


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_sets_every_choice_and_explicit_fields_win(preset: str) -> None:
    session = resolve({"preset": preset})
    raw, defaults = msgspec.to_builtins(session), msgspec.to_builtins(Session())
    for section, values in preset_fields(preset).items():
        assert {name: raw[section][name] for name in values} == values
        raw[section] |= {name: defaults[section][name] for name in values}
    assert raw == {**defaults, "preset": preset}
    assert resolve({"preset": "published", "icp": {"stop": "tolerance"}}).icp.stop == "tolerance"
    assert resolve({"preset": "published", "icp": {"stop": "tolerance"}}).icp.gate == "published"
    assert resolve({}) == resolve({"preset": "recommended"})


def test_colour_and_flips_come_with_the_network_that_is_recommended() -> None:
    def chosen(**raw: object) -> tuple[str, float, bool]:
        session = resolve(raw)
        return session.method.refiner, session.score.colour_weight, session.hypotheses.flips

    assert chosen() == chosen(method={"refiner": "depth_net_icp"}) == ("depth_net_icp", 0.1, True)
    for refiner in ("icp", "densefusion"):
        assert chosen(method={"refiner": refiner}) == (refiner, 0.0, False)
    assert chosen(preset="paper") == chosen(preset="published") == ("icp", 0.0, False)
    assert chosen(preset="paper", method={"refiner": "depth_net_icp"}) == ("depth_net_icp", 0.0, False)
    assert chosen(score={"colour_weight": 0.3}, hypotheses={"flips": False}) == ("depth_net_icp", 0.3, False)
    assert resolve({"method": {"refiner": "icp"}}) == Session()


def test_the_paper_has_a_budget_for_each_of_its_refiners() -> None:
    def budget(**method: object) -> tuple[int, int, int]:
        session = resolve({"preset": "paper", "method": method})
        return session.hypotheses.max_per_object, session.method.iterations, session.physics.steps

    assert budget() == budget(refiner="icp") == (3, 5, 3)  # RIR has 3 · 5 calls of 10 iterations, 150 in all.
    assert budget(refiner="trimmed_icp") == (25, 2, 60)  # Three objects have 150 calls.
    assert budget(refiner="densefusion") == (5, 2, 3)  # 10 calls of one iteration.
    assert budget(refiner="densefusion", iterations=7) == (5, 7, 3)


def test_paths_are_taken_from_the_file_and_overrides_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = '[scene]\nsource="bop"\ndataset="../data"\nmasks="d.json"\n[hypotheses]\nsource="results"\nfiles=["a.csv"]'
    text += '\n[dependency]\norder_file="o.json"'
    path = write(tmp_path, text)
    session = load_session(path)
    assert session.scene.dataset == str((tmp_path / ".." / "data").resolve())
    assert session.scene.masks == str(tmp_path / "d.json")
    assert session.hypotheses.files == (str(tmp_path / "a.csv"),)
    assert session.dependency.order_file == str(tmp_path / "o.json")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert load_session(path, {"scene": {"dataset": "x"}}).scene.dataset == str(elsewhere / "x")


def test_every_setting_that_names_a_file_is_known_as_one() -> None:
    """The same type as the weights' marks them."""
    kind = fields_of(DepthNetSettings)["weights"].type
    named = {
        (section, name)
        for section, about in fields_of(Session).items()
        if isinstance(about.type, StructType)
        for name, field in fields_of(about.type.cls).items()
        if field.type == kind
    }
    assert named == {*FILES, ("scene", "dataset"), ("scene", "split"), ("scene", "masks")}


WRONG_FILES: tuple[tuple[str, str], ...] = (
    ("[method]\nnam = 'rir'", "method: unknown field 'nam'; did you mean 'name'[?] available: .*iterations"),
    ('[scene]\n"x` - at `$.method" = 1', "scene: unknown field 'x.*'; available: cloud_points, "),
    ('"x` - at `$.nothing" = 1', "unknown field 'x"),
    ("[score]\ntau_m = nan", "score.tau_m: "),
    ("[score]\npixels = 'all'", "score.pixels: .*'all'.* classes, observed, published$"),
    ("[method]\niterations = 2020-01-01", "method.iterations: "),
    ("[method]\ntrack = 3", "method.track: "),
    ("scene = 3", "scene: "),
    ("[scene]\nobjects = ['mug']", "scene.objects.0: .*'mug'$"),
    ("[scene]\nobjects = 3", "scene.objects: "),
    ('[method]\nname = "rir\nseed = 1', "line 2.*; a quote is opened there or before and"),
    ("[scene]\ngravity = 'down'", "scene.gravity: .*plane, world"),
    ("[scene]\ngravity = [0, 0]", "scene.gravity: "),
    ("[scene]\ngravity = [0, 0, 0]", "scene.gravity: "),
    ("preset = 'theirs'", "preset: .*'theirs'.* paper, published, recommended$"),
    ("preset = ['paper']", "preset: "),
    ("[[edits]]\nafter_iteration=1", "edits.0: .*`instance`"),
    ("[[changes]]\nafter_iteration=1\nsettings = 3", "changes.0.settings: "),
    ("[[changes]]\nafter_iteration=1\n[changes.settings.scene]\nseed=1", "changes.0: .*'scene'"),
    ("[[changes]]\nafter_iteration = 1\nsettings = {method = {iterations = 1000000000}}", "changes.0: .*iterations: "),
    (f"[scene]\nobjects = {'[' * 2000}{']' * 2000}", "more than 20 levels$"),
    (f"[{'.'.join('a' * 3000)}]", "more than 20 levels$"),
    (f"[scene]\nseed = 0x{'f' * 5000}", "scene.seed: "),
    (f"[scene]\nseed = {'9' * 5000}", "5000 digits"),
    ('[scene]\nsplit = "a\\u0000b"', "scene.split: "),
)


def test_wrong_files_are_refused_in_a_line_with_file_and_field(tmp_path: Path) -> None:
    for text, named in WRONG_FILES:
        path = write(tmp_path, text)
        with pytest.raises(SettingsError, match=rf"{path}.*{named}") as caught:
            load_session(path)
        assert len(str(caught.value)) < 700, text


def test_what_cannot_be_read_or_written_is_named_at_once(tmp_path: Path) -> None:
    kinds: dict[str, Callable[[Path], object]] = {
        "missing": lambda path: None,
        "folder": lambda path: path.mkdir(),
        "bytes": lambda path: path.write_bytes(b"\xff\xfe\x00"),
        "pipe": os.mkfifo,
        "device": lambda path: path.symlink_to("/dev/zero"),
        "loop": lambda path: path.symlink_to(path),
        "large": lambda path: path.write_bytes(b"#" * 10_000_001),
    }
    for kind, make in kinds.items():
        path = tmp_path / f"{kind}.toml"
        make(path)
        with pytest.raises(InputError, match=str(path)):
            load_session(path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file.s\.toml"):
        save_session(Session(), tmp_path / "file" / "s.toml")


def test_a_byte_order_mark_and_the_line_ends_of_windows_are_read_over(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf[method]\r\nname = 'sir'\r\n")
    assert load_session(tmp_path / "s.toml").method.name == "sir"


def test_a_file_that_says_nothing_is_refused_unless_options_do(tmp_path: Path) -> None:
    for text in ("", "\n", "# [scene]\n"):
        path = write(tmp_path, text)
        with pytest.raises(SettingsError, match=str(path)):
            load_session(path)
        assert load_session(path, {"scene": {"demo": "mug"}}) == resolve({})


def test_who_wrote_a_mistake_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, "[method]\niterations = 5\n[scene]\nseed = 3")
    for typed in ({"method": {"iterations": 0}, "scene": {"seed": 4}}, {"score": {"tau_m": -1}}, {"title": "a\udcff"}):
        with pytest.raises(SettingsError, match=r"^command line: "):
            load_session(path, typed)
    for wrong in ("[method]\niterations = 0", "[scene]\ngravity = [0, 0, 0]"):
        with pytest.raises(SettingsError, match=f"^{path}: "):
            load_session(write(tmp_path, wrong), {"method": {"name": "sir"}, "scene": {"seed": 4}})


def test_every_field_has_a_docstring() -> None:
    pending: list[Any] = [Session]
    while pending:
        model = pending.pop()
        for name, field in fields_of(model).items():
            if isinstance(field.type, StructType):
                pending.append(field.type.cls)
            else:
                assert descriptions(model).get(name), f"{model.__name__}.{name}"


# Data that a session names and its source would not look at: refused, unless the source was chosen with them.


ROOT = Path(__file__).resolve().parents[2]


RECORDED = {"scene": {"source": "folder", "dataset": "/runs"}, "hypotheses": {"source": "recorded"}}
FORGOTTEN: tuple[tuple[dict[str, Any], str], ...] = (
    ({"hypotheses": {"files": ["a.csv"]}}, "hypotheses.files "),
    ({"scene": {"dataset": "d"}}, "scene.dataset "),
    ({"physics": {"mesh": "a.ply"}}, "physics.mesh "),
    ({"ppf": {"step": 0.1}}, r"\[ppf\] "),
    ({"ppf": {"step": 0.1}, "hypotheses": {"estimate": [["0/0", 0, "pcs"]]}}, r"\[ppf\] "),
    ({"method": {"name": "trace"}}, 'method "trace" '),
    (RECORDED | {"method": {"name": "trace", "track": True}}, 'method "trace" .*track'),
    ({"hypotheses": {"source": "recorded"}}, 'hypotheses.source "recorded" '),
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
        with pytest.raises(SettingsError, match=r"^command line: "):
            load_session(demo, typed)
    with pytest.raises(SettingsError, match=r"^command line: scene\.demo "):
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
    with pytest.raises(SettingsError, match=rf"^{path}: hypotheses.files: {tmp_path}/a.csv "):
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
