"""Help that fits a screen, and the settings for whoever asks for them."""

from __future__ import annotations

import dataclasses

import msgspec
import pytest

from verefine_viz import cli
from verefine_viz.core.settings import Session

WITH_SETTINGS = [
    name for name, kind in cli.COMMANDS.items() if "settings" in {f.name for f in dataclasses.fields(kind)}
]


def shown(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(words))
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", WITH_SETTINGS)
def test_help_is_about_the_command_and_names_the_sections(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(capsys, name, "--help")
    assert len(text.splitlines()) < 70
    for field in dataclasses.fields(cli.COMMANDS[name]):
        if field.name not in ("settings", "sessions", "session", "folder", "other", "name"):
            assert f"--{field.name.replace('_', '-')}" in text
    assert "--score.tau-m FLOAT" not in text
    for section, value in msgspec.to_builtins(Session()).items():
        assert section in text or not isinstance(value, dict)
    assert text == shown(capsys, name, "-h")


def test_the_settings_of_a_section_can_be_asked_for_alone(capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(capsys, "batch", "--help-settings", "score")
    assert "--score.tau-m FLOAT" in text
    assert "Paper Sec. V: 20 mm" in text
    assert "--method.name" not in text
    every = shown(capsys, "batch", "--help-settings", "--seeds", "3")
    assert "--score.tau-m FLOAT" in every
    assert "--method.name" in every
    assert "--preset" in every
    assert shown(capsys, "--help-settings", "score") == shown(capsys, "view", "--help-settings", "score")
