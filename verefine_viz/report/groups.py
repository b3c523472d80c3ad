"""Groups of runs that differ only in their seeds, named by what differs among the groups."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from verefine_viz.batch.runs import read_run
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.settings import Session
from verefine_viz.report.run_results import LoadedRun, check_same_data, load
from verefine_viz.run.record import Answer

Progress = Callable[[int, int], None]
"""Called with how many parts of a long work are done, and how many there are."""
Seeds = tuple[int, int]
"""hypotheses.seed and method.seed of a run."""
SEEDS = ("hypotheses.seed", "method.seed")
WITHOUT_EFFECT = ("title", "recording", "breakpoints")
"""Settings that change no result."""
FIRST = ("method.name", "preset")
"""Settings that name a group before any other."""


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of the same session with different seeds."""

    name: str
    runs: tuple[LoadedRun, ...]
    """By seed."""

    @property
    def method(self) -> str:
        return self.runs[0].method

    @property
    def session(self) -> Session:
        """Of the first run."""
        return self.runs[0].index.session

    @cached_property
    def objects(self) -> tuple[Answer, ...]:
        """Objects of all runs."""
        return tuple(row for run in self.runs for row in run.objects)


@dataclass(frozen=True, eq=False)
class Groups:
    """What a report compares."""

    groups: tuple[Group, ...]
    """By name."""
    left_out: tuple[tuple[str, str], ...]
    """Runs that are not part of it: folder and reason."""

    @property
    def runs(self) -> tuple[LoadedRun, ...]:
        return tuple(run for group in self.groups for run in group.runs)


def load_groups(folders: Sequence[Path], progress: Progress = lambda done, of: None) -> Groups:
    """The finished runs in ``folders``, grouped.

    Raises:
        InputError: none is finished, or they are about different data sets.
    """
    runs: list[LoadedRun] = []
    left_out: list[tuple[str, str]] = []
    for done, folder in enumerate(folders):
        progress(done, len(folders))
        try:
            status = read_run(folder).status
            if status == "finished":
                runs.append(load(folder))
            else:
                left_out.append((folder.name, f"not finished ({status})"))
        except VerefineError as error:
            left_out.append((folder.name, str(error)))
    progress(len(folders), len(folders))
    if not runs:
        name, why = left_out[0]
        raise InputError(f"none of the {len(folders)} runs in {folders[0].parent} can be used; {name}: {why}")
    check_same_data(runs)
    return Groups(_grouped(runs), tuple(left_out))


def seeds_of(run: LoadedRun) -> Seeds:
    """How the runs of a group differ."""
    session = run.index.session
    return session.hypotheses.seed, session.method.seed


def seed_words(run: LoadedRun) -> str:
    """``seed 3``; ``seeds 3, 4`` where hypotheses and method have different ones."""
    of_poses, of_method = seeds_of(run)
    return f"seed {of_poses}" if of_poses == of_method else f"seeds {of_poses}, {of_method}"


def names(sessions: Sequence[Session]) -> list[str]:
    """Short names by what differs among sessions, the method first; all different but for seeds.

    A setting is named only where those before it are the same for two of them.
    """
    flat = [_settings(session) for session in sessions]
    parts: list[tuple[str, ...]] = [()] * len(flat)
    for field in sorted(_differing(flat), key=lambda f: FIRST.index(f) if f in FIRST else len(FIRST)):
        values = [mine[field] for mine in flat]
        together = [[k for k, other in enumerate(parts) if other == mine] for mine in parts]
        parts = [
            (*mine, _part(field, values[k])) if any(values[j] != values[k] for j in together[k]) else mine
            for k, mine in enumerate(parts)
        ]
    method = flat[0]["method.name"]
    return [" · ".join(mine) or method for mine in parts]


def differing(sessions: Sequence[Session]) -> dict[str, tuple[str, ...]]:
    """Settings in which sessions differ, and what each has."""
    flat = [_settings(session) for session in sessions]
    return {field: tuple(_words(mine[field]) for mine in flat) for field in _differing(flat)}


def _grouped(runs: Sequence[LoadedRun]) -> tuple[Group, ...]:
    by_settings: dict[str, list[LoadedRun]] = {}
    for run in runs:
        by_settings.setdefault(json.dumps(_settings(run.index.session), default=str), []).append(run)
    members = [sorted(mine, key=seeds_of) for mine in by_settings.values()]
    group_names = names([mine[0].index.session for mine in members])
    groups = [Group(name, tuple(mine)) for name, mine in zip(group_names, members, strict=True)]
    return tuple(sorted(groups, key=lambda group: group.name))


def _settings(session: Session) -> dict[str, Any]:
    """What makes a group: every setting that can change a result, but for the seeds."""
    out: dict[str, Any] = {}
    for name, value in session.model_dump().items():
        if name not in WITHOUT_EFFECT:
            out |= {f"{name}.{k}": v for k, v in value.items()} if isinstance(value, Mapping) else {name: value}
    return {field: value for field, value in out.items() if field not in SEEDS}


def _differing(flat: Sequence[Mapping[str, Any]]) -> list[str]:
    return [field for field in flat[0] if any(mine[field] != flat[0][field] for mine in flat)]


def _part(field: str, value: Any) -> str:
    return _words(value) if field in FIRST else f"{field} {_words(value)}"


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple | list):
        return " ".join(_words(v) for v in value) or "none"
    return str(value) if value not in ("", None) else "none"
