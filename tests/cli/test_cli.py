"""The command line: help, options over session files, exit codes."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from verefine_viz import __version__, cli
from verefine_viz.commands import flags
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import load_session

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numpy", "open3d", "viser", "rerun", "pybullet", "moderngl", "numba", "trimesh", "scipy")


def overrides(*words: str) -> dict[str, Any]:
    command = cli.parse(["view", *words])
    assert isinstance(command, ViewCommand)
    return flags.given(command.settings, words)


def help_of(*words: str) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit) as ended:
        cli.main([*words])
    assert ended.value.code == 0
    return said.getvalue()


@pytest.mark.usefixtures("processes")
def test_help_is_instant_because_nothing_heavy_is_imported() -> None:
    commands = [[], ["view"], ["batch"], ["estimate"], ["replay"], ["doctor"]]
    code = (
        "import sys, contextlib\nfrom verefine_viz import cli\n"
        f"for command in {commands!r}:\n"
        "    with contextlib.suppress(SystemExit): cli.main([*command, '--help'])\n"
        f"    print(command, [m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stderr.splitlines() == [f"{command} []" for command in commands]
    assert done.stdout.count("usage: verefine-viz") == len(commands)


def test_help_has_every_command_its_options_and_on_demand_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"verefine-viz {__version__}\n"
    overview, settings = help_of("--help"), help_of("batch", "--help-settings", "--seeds", "3")
    assert all(name in overview for name in cli.COMMANDS)
    sections = msgspec.to_builtins(Session())
    for section in sections.keys() - set(flags.NOT_OPTIONS):
        fields = sections[section]
        names = [f".{name}" for name in fields.keys() - set(flags.NOT_OPTIONS)] if isinstance(fields, dict) else [""]
        assert all(f"--{section}{name} ".replace("_", "-") in settings for name in names), section
    one = help_of("view", "--help-settings", "score")
    assert "--score.tau-m FLOAT" in one
    assert "--method.name" not in one
    assert help_of("--help-settings", "score") == one
    positional = {"settings", "sessions", "session", "folder", "other", "name"}
    for name, kind in cli.COMMANDS.items():
        options = {field.name for field in dataclasses.fields(kind)}
        if "settings" in options:
            text = help_of(name, "--help")
            assert "--score.tau-m FLOAT" not in text, name
            assert all(f"--{option.replace('_', '-')}" in text for option in options - positional), name
            assert all(section in text for section, value in sections.items() if isinstance(value, dict)), name


def test_only_what_was_typed_is_an_override() -> None:
    assert overrides() == {}
    assert overrides("a.toml", "--score.tau-m", "0.01") == {"score": {"tau_m": 0.01}}
    assert overrides("--score.tau_m=0.02") == {"score": {"tau_m": 0.02}}
    typed = overrides("--physics.enabled", "False", "--breakpoints.jump-mm", "None", "--scene.frames", "1/2", "3/4")
    assert typed == {
        "physics": {"enabled": False},
        "breakpoints": {"jump_mm": None},
        "scene": {"frames": ("1/2", "3/4")},
    }
    assert overrides("--scene.gravity", "0", "0", "9.81") == {"scene": {"gravity": (0.0, 0.0, 9.81)}}


def test_an_order_can_be_typed_and_one_that_is_cut_off_is_refused() -> None:
    for words, order in (
        (["[3,99]", "[6]"], ((3, 99), (6,))),
        (['[[1, "#2"]]'], ((1, "#2"),)),
        (["3", "#2"], ((3, "#2"),)),
    ):
        assert load_session(None, overrides("--dependency.order", *words)).dependency.order == order
    for cut_off in ("[3,99", "[" * 3000):
        with pytest.raises(SettingsError, match=r"^--dependency.order"):
            load_session(None, overrides("--dependency.order", cut_off))


def test_options_win_over_the_file_and_over_the_preset(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text('preset = "published"\n[method]\nname = "pir"\niterations = 9\n')
    session = load_session(file, overrides("--method.name", "sir", "--score.pixels", "classes"))
    assert (session.method.name, session.method.iterations) == ("sir", 9)
    assert session.score.pixels == "classes"
    assert session.icp.stop == "published"
    # Typing a default is still a choice: it must win over the preset, too.
    assert load_session(file, overrides("--icp.stop", "max_iterations")).icp.stop == "max_iterations"
    typed = load_session(None, overrides("--preset", "published", "--physics.collider", "decomposition"))
    assert (typed.score.pixels, typed.physics.collider) == ("published", "decomposition")


UNREADABLE: tuple[tuple[list[str], str], ...] = (
    ([], "view"),
    (["view", "--scor.tau-m", "1"], "--score.tau-m"),
    (["view", "--port", "abc"], "--port"),
    (["view", "--score.renderer", "vulkan"], "--score.renderer"),
    (["view", "a.toml", "--scene.gravity", "1", "-2"], "--scene.gravity"),
    (["view", "a.toml", "--breakpoints.jump_mm=far"], "--breakpoints.jump-mm"),
    (["view", "--title", "a\udcff", "--nosuch"], "--nosuch"),
    (["batch", "a.toml", "--nosuch"], "--out"),
    (["train", "depth_nett", "--out", "net.onnx"], "depth_nett"),
)


def test_words_that_cannot_be_read_are_named_and_end_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    for words, named in UNREADABLE:
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        output, error = capsys.readouterr()
        assert (ended.value.code, output) == (2, ""), words
        assert named in error, words
    for words, known in ((["veiw"], cli.COMMANDS), (["view", "--help-settings", "scores"], flags.SECTIONS)):
        assert cli.main(words) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert all(name in line for name in known)


@pytest.mark.usefixtures("processes")
def test_a_terminal_without_utf8_and_a_reader_that_leaves_early_are_no_crash() -> None:
    program = [sys.executable, "-m", "verefine_viz", "view"]
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    words = [*program, "--recording.kep", "all"]
    done = subprocess.run(words, capture_output=True, cwd=ROOT, check=False, env=ascii_only)
    assert done.returncode == 2
    assert b"--recording.keep" in done.stderr
    with subprocess.Popen([*program, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT) as child:
        child.stdout.close()
        assert child.stderr.read() == b""
    assert child.returncode == 0


def run_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> int:
    class Failing:
        def run(self, arguments: list[str]) -> int:
            raise error

    monkeypatch.setattr(cli, "parse", lambda words: Failing())
    return cli.main(["view"])


def test_an_error_is_one_line_with_its_exit_code(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for error, code, said in (
        (InputError("bad\nname\r\n 'x\x1b[2J'"), 2, "bad name 'x�[2J'"),
        (PermissionError(13, "Permission denied", "/x/y"), 2, "/x/y"),
        (
            RuntimeError("cannot cache function 'score': no locator available for file '/opt/score.py'"),
            2,
            "NUMBA_CACHE",
        ),
        (KeyboardInterrupt(), 130, "stopped"),
    ):
        assert run_with(error, monkeypatch) == code
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
    for bug in (RuntimeError("a bug"), ZeroDivisionError()):
        with pytest.raises(type(bug)):
            run_with(bug, monkeypatch)


def test_debug_shows_what_a_library_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "a.vfrun.npz"
    path.write_bytes(b"no archive")
    words = ["evaluate", str(path), "--dataset", str(tmp_path)]
    for given, is_said in ((words, False), ([*words, "--debug"], True), (["--debug", *words], True)):
        assert cli.main(given) == 2
        lines = capsys.readouterr().err.splitlines()
        assert lines[-1].startswith("verefine-viz: "), given
        assert (len(lines) > 1) == any("Traceback" in line for line in lines) == is_said, given


@pytest.mark.parametrize("network", ["depth_net", "densefusion"])
def test_without_torch_training_names_the_extra(
    network: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("verefine_viz.training", "verefine_viz.networks"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert cli.main(["train", network, "--out", str(tmp_path / "net.onnx")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'verefine-viz[torch]'" in line
