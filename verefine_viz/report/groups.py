"""The subject of a report: runs by data, in groups of runs that differ only in their seeds, named by what differs
between groups.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from verefine_viz.batch.answer_orders import sort_key
from verefine_viz.batch.index import BatchIndex, read_batch
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import first_of
from verefine_viz.run.record import Answer

Seeds = tuple[int, int]
"""hypotheses.seed and method.seed of a run."""
Key = tuple[str, int | None, int | None]
"""Frame, instance_id, obj_id: the same object in two runs."""
SEEDS = ("hypotheses.seed", "method.seed")
WITHOUT_EFFECT = ("title", "recording", "breakpoints")
"""Settings that change no result."""
FIRST = ("method.name", "preset")
"""Settings that are preferred for naming a group."""
MOST_FRAMES_NAMED = 3


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of the same session with different seeds."""

    name: str
    runs: tuple[BatchIndex, ...]
    """By seed."""

    @property
    def session(self) -> Session:
        """Session of the first run."""
        return self.runs[0].session

    @property
    def method(self) -> str:
        return self.session.method.name

    @cached_property
    def rows(self) -> tuple[Answer, ...]:
        return tuple(row for run in self.runs for row in run.rows)

    @cached_property
    def objects(self) -> tuple[Answer, ...]:
        """All objects, also those left out or in failed frames: they count as missed."""
        return tuple(row for row in self.rows if row.is_object)

    @cached_property
    def with_truth(self) -> tuple[Answer, ...]:
        """Objects that can be right or wrong."""
        return tuple(row for row in self.objects if row.can_be_right)

    @cached_property
    def failures(self) -> tuple[Answer, ...]:
        """Objects whose answer is wrong or missing, worst first; without any ground truth all objects, by score.

        Only objects that were asked for: one left out or in a failed frame is no failure of the method.
        """
        worst_first = [row for row in sorted(self.rows, key=sort_key("error")) if row.was_asked_for]
        if not self.with_truth:
            return tuple(worst_first)
        return tuple(row for row in worst_first if row.status == "no_answer" or row.is_correct is False)


@dataclass(frozen=True, eq=False)
class Section:
    """Groups of runs on the same data: they can be compared."""

    data: str
    """Name of the data."""
    groups: tuple[Group, ...]
    """By name; two runs that the user named are in the user's order."""

    @property
    def runs(self) -> tuple[BatchIndex, ...]:
        return tuple(run for group in self.groups for run in group.runs)

    @cached_property
    def frames(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(row.frame for group in self.groups for row in group.rows))

    @cached_property
    def has_same_objects(self) -> bool:
        """Whether all runs are about the same objects of the same frames."""
        return len({frozenset(keys_of(run)) for run in self.runs}) == 1

    @property
    def pair(self) -> tuple[Group, Group] | None:
        """Two runs that can be compared object by object; None for one run, or for more."""
        return (self.groups[0], self.groups[1]) if len(self.groups) == len(self.runs) == 2 else None


def key(row: Answer) -> Key:
    """Key that two rows about the same object share."""
    return row.frame, row.instance_id, row.obj_id


def keys_of(run: BatchIndex) -> set[Key]:
    """The data and objects of a run."""
    return {key(row) for row in run.rows}


def read_runs(folders: Sequence[Path], only_finished: bool) -> tuple[list[BatchIndex], list[tuple[str, str]]]:
    """The batches in these folders, and which of them cannot be used, with the reason.

    Args:
        folders: of batches.
        only_finished: leave out batches that are not finished.

    Raises:
        InputError: none can be used.
    """
    runs, left_out = list[BatchIndex](), list[tuple[str, str]]()
    for folder in folders:
        try:
            run = read_batch(folder)
            if only_finished and run.run.status not in ("finished", "unknown"):
                left_out.append((folder.name, f"not finished ({run.run.status})"))
            else:
                runs.append(run)
        except VerefineError as error:
            if not only_finished:
                raise
            left_out.append((folder.name, str(error)))
    if not runs:
        name, why = left_out[0]
        raise InputError(f"none of the {len(folders)} runs in {folders[0].parent} can be used; {name}: {why}")
    return runs, left_out


def sections_of(runs: Sequence[BatchIndex], as_named: bool = False) -> tuple[Section, ...]:
    """Runs by data: runs belong together if they are on the same data set and share an object of a frame.

    Args:
        runs: at least one.
        as_named: two runs that the user named, A and B, even if only their seeds differ.
    """
    by_data: list[tuple[str, set[Key], list[BatchIndex]]] = []
    for run in runs:
        keys, data = keys_of(run), _data_set(run)
        mine = next((one for one in by_data if one[0] == data and one[1] & keys), None)
        if mine is None:
            by_data.append((data, keys, [run]))
        else:
            mine[1].update(keys)
            mine[2].append(run)
    named = dict(zip(map(id, runs), _pair_names(runs), strict=True)) if as_named else {}
    sections = list[Section]()
    for data, _, members in by_data:
        is_alone = sum(other == data for other, _, _ in by_data) == 1
        frames = first_of(tuple(dict.fromkeys(row.frame for run in members for row in run.rows)), MOST_FRAMES_NAMED)
        groups = tuple(Group(named[id(run)], (run,)) for run in members) if named else _grouped(members)
        sections.append(Section(data if is_alone else f"{data}, frames {frames}", groups))
    return tuple(sections)


def _data_set(run: BatchIndex) -> str:
    """Name of the data of a run."""
    scene = run.session.scene
    if scene.source == "demo":
        return f"the built-in scene {scene.demo}"
    of_bop = (scene.split, scene.sensor) if scene.source == "bop" else ()
    return "/".join(filter(None, (Path(scene.dataset).name, *of_bop)))


def seeds_of(run: BatchIndex) -> Seeds:
    """Names of a group's runs, by what differs among them."""
    return run.session.hypotheses.seed, run.session.method.seed


def names(sessions: Sequence[Session]) -> list[str]:
    """Short names by what differs among sessions, the method first; unique but for seeds.

    A setting is named only where the names so far are equal.
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


def differing(sessions: Sequence[Session]) -> dict[str, list[str]]:
    """Settings in which sessions differ, with the value of each."""
    flat = [_settings(session) for session in sessions]
    return {field: [_words(mine[field]) for mine in flat] for field in _differing(flat)}


def _pair_names(runs: Sequence[BatchIndex]) -> list[str]:
    """``A: rir`` and ``B: pir``; by seeds, or by folders, where nothing else differs."""
    named = names([run.session for run in runs])
    seeds = [f"seed {a}" if a == b else f"seeds {a}, {b}" for a, b in map(seeds_of, runs)]
    folders = [run.folder.name for run in runs]
    shown = next((one for one in (named, seeds, folders) if len(set(one)) > 1), [str(run.folder) for run in runs])
    return [f"{label}: {name}" for label, name in zip("AB", shown, strict=True)]


def _grouped(runs: Sequence[BatchIndex]) -> tuple[Group, ...]:
    by_settings: dict[str, list[BatchIndex]] = {}
    for run in runs:
        by_settings.setdefault(json.dumps(_settings(run.session), default=str), []).append(run)
    members = [sorted(mine, key=seeds_of) for mine in by_settings.values()]
    group_names = names([mine[0].session for mine in members])
    groups = [Group(name, tuple(mine)) for name, mine in zip(group_names, members, strict=True)]
    return tuple(sorted(groups, key=lambda group: group.name))


def _settings(session: Session) -> dict[str, Any]:
    """Key of a group: every setting that can change a result, except the seeds."""
    out: dict[str, Any] = {}
    for name, value in msgspec.to_builtins(session).items():
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
