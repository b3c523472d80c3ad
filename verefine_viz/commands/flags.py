"""Every field of a session as a command line option: ``--method.name sir --score.tau-m 0.01``.

The options are made from the settings models, so names, defaults and texts are written once. Values are only parsed
here; they are checked together with the session file, by the same rules and with the same messages.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from typing import Annotated, Any

import msgspec
import tyro
from msgspec import Struct
from msgspec.inspect import StructType

from verefine_viz.batch.worker_tasks import MOST_PER_CORE
from verefine_viz.core.errors import SettingsError, quoted, unknown
from verefine_viz.core.presets import preset_fields
from verefine_viz.core.setting_types import descriptions, fields_of, kinds_of, limits
from verefine_viz.core.settings import Session

HELP_SETTINGS = "--help-settings"
_HINT = """
Every setting of a session file is an option too, and wins over the file: --method.name sir --score.tau-m 0.01;
--preset paper sets every choice as the paper has it, --preset published as the authors' public code does.
--help-settings lists them with unit, default and source, --help-settings SECTION those of one section:
{sections}.
"""
NOT_OPTIONS = ("edits", "tracked", "starts", "changes", "waiting")
"""Fields that are no options: lists of tables, which are too long to type, and thresholds that are switched off."""


def _flags_of(settings: Struct) -> Any:
    """A plain dataclass with the fields and texts of some settings, their values as defaults, without checks."""
    model = type(settings)
    fields: list[tuple[str, Any, Any]] = []
    kinds, texts = kinds_of(model), descriptions(model)
    for name, field in fields_of(model).items():
        if name in NOT_OPTIONS:
            continue
        if isinstance(field.type, StructType):
            group = _flags_of(getattr(settings, name))
            fields.append((name, group, dataclasses.field(default_factory=group)))
        else:
            bounds = limits(field.type)
            text = f"{texts.get(name, '')}{f' {bounds[0].upper()}{bounds[1:]}.' if bounds else ''}"
            kind = Annotated[kinds[name], tyro.conf.arg(help=text)]
            fields.append((name, kind, dataclasses.field(default=getattr(settings, name))))
    flags = dataclasses.make_dataclass(model.__name__, fields, frozen=True)
    flags.__doc__ = model.__doc__
    return flags


SessionFlags: Any = _flags_of(msgspec.convert(preset_fields(Session().preset), Session))
"""Dataclass of all options of a session; only those that were written on the command line count."""

SECTIONS: dict[str, Any] = {f.name: f for f in dataclasses.fields(SessionFlags) if isinstance(f.type, type)}
"""The fields of :data:`SessionFlags` that are groups of settings, by name."""

AnySettings = Annotated[Any, tyro.conf.arg(name="", constructor=SessionFlags), tyro.conf.FlagConversionOff]
"""The type of a command's field that takes all options of a session."""


def show_help(command: type, prog: str, words: Sequence[str]) -> None:
    """Show the help that ``--help`` or ``--help-settings`` asks for and exit; do nothing where ``words`` has neither.

    ``--help`` fits on a screen: the settings, hundreds of lines, are shown by ``--help-settings`` only.

    Raises:
        SettingsError: there is no section of that name.
        SystemExit: the help was shown.
    """
    if not any(field.name == "settings" for field in dataclasses.fields(command)):
        return
    if HELP_SETTINGS in words:
        sections = [word for word in words[words.index(HELP_SETTINGS) + 1 :][:1] if not word.startswith("-")]
        shown: Any = _section(sections[0]) if sections else SessionFlags
        about = f"Settings of a session, as options of {prog}."
        tyro.cli(shown, prog=prog, args=["--help"], description=about, config=(tyro.conf.FlagConversionOff,))
    elif "-h" in words or "--help" in words:
        hint = _HINT.format(sections=", ".join(SECTIONS))
        tyro.cli(_without_settings(command), prog=prog, args=["--help"], description=f"{command.__doc__}\n{hint}")


def _section(name: str) -> Any:
    if name not in SECTIONS:
        raise SettingsError(unknown("section of settings", name, SECTIONS))
    field = SECTIONS[name]
    return dataclasses.make_dataclass(
        "Settings", [(name, field.type, dataclasses.field(default_factory=field.default_factory))]
    )


def _without_settings(command: type) -> Any:
    body = {"__annotations__": {"settings": tyro.conf.Suppress[Any]}, "settings": None, "__doc__": command.__doc__}
    return dataclasses.dataclass(frozen=True)(type(command.__name__, (command,), body))


def given(flags: Any, arguments: Sequence[str]) -> dict[str, Any]:
    """The options that were written on the command line, nested as in a session file.

    Which ones were written is read from the arguments themselves: an option that repeats a default is still explicit,
    and wins over a preset.
    """
    settings: dict[str, Any] = {}
    for word in arguments:
        if word.startswith("--"):
            section, _, name = word[2:].partition("=")[0].replace("-", "_").rpartition(".")
            group = getattr(flags, section, None) if section else flags
            # A command may have a flag that is called as a section is: batch --grasp.
            if hasattr(group, name) and (section or name not in SECTIONS):
                (settings.setdefault(section, {}) if section else settings)[name] = getattr(group, name)
    if "order" in settings.get("dependency", ()):
        settings["dependency"]["order"] = _clusters(settings["dependency"]["order"])
    return settings


def _clusters(order: tuple[tuple[int | str, ...], ...]) -> Any:
    """Clusters written as "[[8, 2], [3]]", or as "[8, 2]" "[3]", which come as one cluster of words."""
    words = [word for cluster in order for word in cluster if isinstance(word, str) and word.lstrip().startswith("[")]
    if not words or [words] != [[*cluster] for cluster in order]:
        return order
    try:
        clusters = msgspec.json.decode(f"[{','.join(words)}]", type=list[list[Any]])
    except (msgspec.MsgspecError, RecursionError):
        wrong = quoted(" ".join(words))
        raise SettingsError(f'--dependency.order is {wrong}, expected clusters of ids, as "[[8, 2], [3]]"') from None
    is_nested = len(clusters) == 1 and all(isinstance(entry, list) for entry in clusters[0])
    return clusters[0] if is_nested else clusters


# Bounds of options that several commands have.

MOST_SEEDS = 1000
"""Seeds of a sweep or a study; the paper has 10 to 20 repetitions."""
MOST_MEMORY_GB = 100_000


def check_workers(n: int) -> None:
    """Raise SettingsError where there are no workers, or more than this machine can use."""
    if n < 1:
        raise SettingsError(f"--workers is {n}, expected 1 or more")
    cores = os.cpu_count() or 1
    if n > MOST_PER_CORE * cores:
        raise SettingsError(
            f"--workers is {n}, expected {MOST_PER_CORE * cores} or fewer, {MOST_PER_CORE} for each core of this "
            "machine: more of them take memory and save no time"
        )


def check_seeds(n: int | None) -> None:
    """Raise SettingsError where a number is given that is below 1 or above :data:`MOST_SEEDS`."""
    if n is not None and n < 1:
        raise SettingsError(f"--seeds is {n}, expected 1 or more")
    if n is not None and n > MOST_SEEDS:
        raise SettingsError(f"--seeds is {quoted(n)}, expected {MOST_SEEDS} or fewer")


def check_memory(gigabytes: float | None) -> None:
    """Raise SettingsError where an amount is given that is not above 0, or is above :data:`MOST_MEMORY_GB`."""
    if gigabytes is None:
        return
    if not gigabytes > 0:
        raise SettingsError(f"--worker-memory-gb is {gigabytes:g}, expected more than 0")
    if math.isinf(gigabytes) or gigabytes > MOST_MEMORY_GB:
        raise SettingsError(
            f"--worker-memory-gb is {gigabytes:g}, expected {MOST_MEMORY_GB} or less; leave it out to share this "
            "machine's memory"
        )
