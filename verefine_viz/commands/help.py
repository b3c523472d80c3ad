"""``--help`` says what a command itself can do on a screen; the settings of a session, hundreds of lines, are asked for
by ``--help-settings``, all of them or those of a section.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import tyro

from verefine_viz.commands.flags import SessionFlags
from verefine_viz.core.errors import SettingsError, unknown

SETTINGS = "--help-settings"
_HINT = """
Every setting of a session file is an option too, and wins over the file: --method.name sir --score.tau-m 0.01;
--preset published sets every choice as the authors' public code has it.
--help-settings lists them with unit, default and source, --help-settings SECTION those of one section:
{sections}.
"""


def show_help(command: type, prog: str, words: Sequence[str]) -> None:
    """Shows what ``--help`` or ``--help-settings`` asks for and ends; does nothing where neither is among ``words``.

    Raises:
        SettingsError: there is no section of that name.
        SystemExit: the help was shown.
    """
    if not any(field.name == "settings" for field in dataclasses.fields(command)):
        return
    if SETTINGS in words:
        asked = [word for word in words[words.index(SETTINGS) + 1 :][:1] if not word.startswith("-")]
        shown: Any = _section(asked[0]) if asked else SessionFlags
        about = f"Settings of a session, as options of {prog}."
        tyro.cli(shown, prog=prog, args=["--help"], description=about, config=(tyro.conf.FlagConversionOff,))
    elif "-h" in words or "--help" in words:
        hint = _HINT.format(sections=", ".join(_sections()))
        tyro.cli(_alone(command), prog=prog, args=["--help"], description=f"{command.__doc__}\n{hint}")


def _sections() -> dict[str, Any]:
    """The groups of settings by name."""
    defaults = SessionFlags()
    return {f.name: f for f in dataclasses.fields(SessionFlags) if dataclasses.is_dataclass(getattr(defaults, f.name))}


def _section(name: str) -> Any:
    if name not in _sections():
        raise SettingsError(unknown("section of settings", name, _sections()))
    field = _sections()[name]
    return dataclasses.make_dataclass(
        "Settings", [(name, field.type, dataclasses.field(default_factory=field.default_factory))]
    )


def _alone(command: type) -> Any:
    """The command without the settings."""
    body = {"__annotations__": {"settings": tyro.conf.Suppress[Any]}, "settings": None, "__doc__": command.__doc__}
    return dataclasses.dataclass(frozen=True)(type(command.__name__, (command,), body))
