"""The command line: help, options over session files, exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from verefine_viz import __version__, cli
from verefine_viz.commands import flags
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import load_session, session_toml

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numpy", "open3d", "viser", "rerun", "pybullet", "moderngl", "numba", "trimesh", "scipy")


def overrides(*words: str) -> dict[str, Any]:
    command = cli.parse(["view", *words])
    assert isinstance(command, ViewCommand)
    return flags.given(command.settings, words)


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


def test_the_overview_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert all(name in text for name in cli.COMMANDS)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"verefine-viz {__version__}\n"


def test_every_field_of_a_session_file_has_an_option(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["batch", "--help-settings"])
    text = capsys.readouterr().out
    fields = tomllib.loads(session_toml(Session()))
    for section, value in msgspec.to_builtins(Session()).items():
        if isinstance(value, dict):
            for field in value.keys() - set(flags.NOT_OPTIONS):
                assert f"--{section}.{field} ".replace("_", "-") in text
        elif section not in flags.NOT_OPTIONS:
            assert f"--{section} " in text
    assert fields


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
        with pytest.raises(SettingsError, match=r"^--dependency.order is .*, expected clusters of ids, as"):
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

    # The preset can be typed as well.
    session = load_session(None, overrides("--preset", "published", "--physics.collider", "decomposition"))
    assert session.score.pixels == "published"
    assert session.physics.collider == "decomposition"


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
    (["doctor", "now"], "now"),
)


def test_words_that_cannot_be_read_are_named_and_end_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    for words, named in UNREADABLE:
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        output, error = capsys.readouterr()
        assert (ended.value.code, output) == (2, ""), words
        assert named in error, words


def test_unknown_names_are_answered_with_those_that_exist(capsys: pytest.CaptureFixture[str]) -> None:
    for words, known in ((["veiw"], cli.COMMANDS), (["view", "--help-settings", "scores"], flags.SECTIONS)):
        assert cli.main(words) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert all(name in line for name in known)


@pytest.mark.usefixtures("processes")
def test_a_terminal_without_utf8_is_no_crash() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "verefine_viz.cli", "view", "--recording.kep", "all"],
        capture_output=True, cwd=ROOT, check=False, env=os.environ | {"PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert done.returncode == 2
    assert b"--recording.keep" in done.stderr


def test_compiled_code_that_can_be_kept_nowhere(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    error = RuntimeError("cannot cache function 'score': no locator available for file '/opt/score.py'")
    assert run_with(error, monkeypatch) == 2
    assert "set NUMBA_CACHE_DIR to a folder that can be written to" in capsys.readouterr().err
    with pytest.raises(RuntimeError):
        run_with(RuntimeError("a bug"), monkeypatch)


def run_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> int:
    class Failing:
        def run(self, arguments: Sequence[str]) -> int:
            raise error

    monkeypatch.setattr(cli, "parse", lambda words: Failing())
    return cli.main(["view"])


def test_an_error_is_one_line_whatever_it_quotes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_with(InputError("bad\nname\r\n 'x\x1b[2J'"), monkeypatch) == 2
    assert capsys.readouterr().err == "verefine-viz: bad name 'x�[2J'\n"


def test_debug_shows_what_a_library_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "a.vfrun.npz"
    path.write_bytes(b"no archive")
    words = ["evaluate", str(path), "--dataset", str(tmp_path)]
    for given, is_said in ((words, False), ([*words, "--debug"], True), (["--debug", *words], True)):
        assert cli.main(given) == 2
        lines = capsys.readouterr().err.splitlines()
        assert lines[-1].startswith("verefine-viz: "), given
        assert (len(lines) > 1) == is_said, given
        assert any("Traceback" in line for line in lines) == is_said, given


def test_a_file_that_cannot_be_used_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_with(PermissionError(13, "Permission denied", "/x/y"), monkeypatch) == 2
    assert capsys.readouterr().err == "verefine-viz: /x/y: Permission denied\n"


def test_a_bug_is_not_dressed_up_as_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        run_with(ZeroDivisionError(), monkeypatch)


def test_ctrl_c_is_no_error(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_with(KeyboardInterrupt(), monkeypatch) == 130
    assert capsys.readouterr().err == "stopped\n"


@pytest.mark.usefixtures("processes")
def test_a_reader_that_leaves_early_is_no_error() -> None:
    program = [sys.executable, "-m", "verefine_viz.cli", "view", "--help"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT) as child:
        child.stdout.close()
        assert child.stderr.read() == b""
    assert child.returncode == 0
