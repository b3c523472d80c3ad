"""An order that the user gives, which wins over any rule. docs/methods.md 2.4."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.files import read_json
from verefine_viz.core.problem import Problem
from verefine_viz.observation.dependency_order import Groups
from verefine_viz.observation.visible_parts import label

InstanceName = Annotated[str, Meta(pattern=r"^#\d{1,9}$")]
"""An instance in an order: ``#4``."""
Entries = Sequence[Sequence[int | str]]
_ENTRIES = tuple[tuple[int | InstanceName, ...], ...]
EXPECTED = 'a list of clusters of object ids, or "#4" for instance 4, as [[8, 2], [3]]'


def given_entries(settings: DependencySettings, problem: Problem) -> Entries | None:
    """The order of the frame from the settings, else from their file, else from the frame's own data; None where none
    gives one.

    Raises:
        InputError: the file cannot be read.
        SettingsError: the file or an entry is malformed.
    """
    if settings.order:
        return checked(settings.order, "dependency.order")
    if not settings.order_file:
        return [[f"#{i}" for i in cluster] for cluster in problem.order] or None
    return read_orders(Path(settings.order_file)).get(problem.frame)


def read_orders(path: Path) -> dict[str, Entries]:
    """All orders in a file, by frame.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    return {**read_json(path, dict[str, _ENTRIES], "order file")}


def checked(value: object, where: str) -> Entries:
    """``value`` as entries.

    Raises:
        SettingsError: ``value`` is not a list of entries; the message begins with ``where``.
    """
    try:
        return msgspec.convert(value, _ENTRIES)
    except msgspec.ValidationError as error:
        raise SettingsError(f"{where}: {error}; expected {EXPECTED}") from None


def given_clusters(problem: Problem, entries: Entries, rest: Sequence[int]) -> tuple[Groups, tuple[str, ...]]:
    """The clusters that entries mean in this frame, and notes for the user.

    Args:
        problem: the frame.
        entries: clusters of object ids or "#" and an instance id.
        rest: all instance ids; those that no entry names follow at the end in this order, each a cluster of its own.
    """
    notes: list[str] = []
    seen: set[int] = set()
    clusters: list[tuple[int, ...]] = []
    for named in entries:
        cluster: list[int] = []
        for entry in named:
            for instance_id in _instances(problem, entry, notes):
                if instance_id in seen:
                    notes.append(f"the given order names {label(problem, instance_id)} twice; its first place counts")
                    continue
                seen.add(instance_id)
                cluster.append(instance_id)
        if cluster:
            clusters.append(tuple(cluster))
    unnamed = [i for i in rest if i not in seen]
    if unnamed:
        names = ", ".join(label(problem, i) for i in unnamed)
        notes.append(f"the given order does not name {names}; solved behind, each alone")
    return (*clusters, *((i,) for i in unnamed)), tuple(dict.fromkeys(notes))


def _instances(problem: Problem, entry: int | str, notes: list[str]) -> list[int]:
    """The instances that an entry names, with a note where there is not exactly one."""
    if isinstance(entry, str):
        ids = [i.instance_id for i in problem.instances]
        wanted = int(entry[1:])
        if wanted not in ids:
            notes.append(f"given order: {unknown('instance', entry, [f'#{i}' for i in ids])}; it is ignored")
        return [wanted] if wanted in ids else []
    ids = [i.instance_id for i in problem.instances if i.obj_id == entry]
    if not ids:
        there = sorted({i.obj_id for i in problem.instances})
        notes.append(f"given order: {unknown('object', entry, there)}; it is ignored")
    if len(ids) > 1:
        names = " and ".join(label(problem, i) for i in ids)
        notes.append(
            f"given order: object {entry} is in the frame {len(ids)} times, as {names}; all take its place, "
            f'write "#{ids[0]}" or "#{ids[1]}" to distinguish them'
        )
    return ids
