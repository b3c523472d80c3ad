"""Which instances a score asks for: BOP's targets files, or every instance that is seen well enough."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from verefine_viz.core.errors import InputError
from verefine_viz.core.jsonfile import integer_of, key_of, read_json
from verefine_viz.scenes.bop import instances_of

Task = Literal["localization", "detection"]
"""localization: BOP'19 to '23, how many instances there are is known. detection: BOP'24, it is not."""


@dataclass(frozen=True)
class Targets:
    """What is asked for, images of a scene together, in the file's order."""

    name: str
    """Of the file, for people."""
    counts: Mapping[tuple[int, int], Mapping[int, int]]
    """(scene_id, im_id) → obj_id → instances; nothing is said about objects where the task is detection."""
    task: Task
    """The one that the file was made for."""
    is_official: bool = True
    """Whether the data set itself says what is asked for."""


def read_targets(path: Path) -> Targets:
    """A targets file; an image's object that is listed twice counts as it is listed last.

    Raises:
        InputError: it is missing or damaged, asks for nothing, or an entry lacks an id; the entry is named.
    """
    entries = read_json(path, list)
    if not entries:
        raise InputError(f"{path} lists no targets, expected [{{'scene_id': …, 'im_id': …, …}}, …]")
    key_of(entries[0], "scene_id", f"{path}, entry 0")
    task: Task = "localization" if "obj_id" in entries[0] else "detection"
    scenes: dict[int, dict[int, dict[int, int]]] = {}
    for k, entry in enumerate(entries):
        where = f"{path}, entry {k}"
        scene_id, im_id = integer_of(entry, "scene_id", where), integer_of(entry, "im_id", where)
        counts = scenes.setdefault(scene_id, {}).setdefault(im_id, {})
        if task == "localization":
            counts[integer_of(entry, "obj_id", where)] = instances_of(entry, where)
    if task == "localization" and not any(n for scene in scenes.values() for c in scene.values() for n in c.values()):
        raise InputError(f"{path} asks for no instance: every 'inst_count' is 0, expected 1 or more somewhere")
    images = {(scene_id, im_id): counts for scene_id, scene in scenes.items() for im_id, counts in scene.items()}
    return Targets(path.name, images, task)


def find_targets(dataset: Path, split: str, task: Task | None = None) -> Path:
    """The data set's targets file for a task, by default for localization where there is one.

    Raises:
        InputError: there is none.
    """
    found = targets_path(dataset, split, task)
    if found is None:
        there = ", ".join(sorted(p.name for p in dataset.glob("*targets*.json"))) or "none at all"
        names = " or ".join(_names(split, task))
        raise InputError(f"{dataset} has no {names} (targets files there: {there}); name one by --targets")
    return found


def targets_path(dataset: Path, split: str, task: Task | None = None) -> Path | None:
    """The same, None where there is none."""
    return next((dataset / name for name in _names(split, task) if os.path.lexists(dataset / name)), None)


def _names(split: str, task: Task | None) -> list[str]:
    years = {"localization": ("19",), "detection": ("24", "19"), None: ("19", "24")}[task]
    return [f"{split.split('_')[0]}_targets_bop{year}.json" for year in years]
