"""A session over the poses of a results file, if the data set that they are of lies near it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.frame_names import frame_name
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import listed
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_files import splits_to_open
from verefine_viz.scenes.results_files import YAML, read_estimates

SUFFIXES = (".csv", ".npz", *YAML)
LEVELS_UP, MOST_FOLDERS = 3, 300
"""How far above the file a data set is looked for, and in how many folders there."""


def results_session(path: Path, overrides: Mapping[str, Any]) -> tuple[Session, int]:
    """The frames that a results file has poses of, which are the initial poses; and how many are not in the data set.

    Args:
        path: a file as :func:`read_estimates` reads.
        overrides: settings; ``scene.dataset`` names the data set where it does not lie near the file.

    Raises:
        InputError: the file cannot be read, or no data set near it has its frames.
    """
    rows = read_estimates(path).rows
    wanted = tuple(dict.fromkeys((row.scene_id, row.im_id) for row in rows))
    given = overrides.get("scene", {}).get("dataset")
    near = ""
    for folder in (Path(given),) if given else _folders_near(path):
        for split in _splits(folder, path):
            try:
                dataset = BopDataset(folder, split)
                there = [ids for ids in wanted if dataset.has(*ids)]
            except (VerefineError, OSError):
                if given:
                    raise
                continue  # Another one may have the frames.
            if there:
                frames = [frame_name(ids) for ids in there]
                return _session(path, folder, split, frames, overrides), len(wanted) - len(there)
            near = near or _other_images(dataset, wanted)
    scenes = listed(sorted({scene_id for scene_id, _ in wanted}))
    where = f"{given} has none of its frames" if given else "no data set with its frames lies near it"
    hint = "" if given else "; add --scene.dataset DIR"
    raise InputError(f"{path} has {len(rows)} poses of scenes {scenes}, but {where}{near}{hint}")


def _session(path: Path, folder: Path, split: str, frames: list[str], overrides: Mapping[str, Any]) -> Session:
    scene = {"source": "bop", "dataset": str(folder.resolve()), "split": split, "frames": frames}
    files = {"source": "results", "files": [str(path.resolve())]}
    sections = {"scene": scene, "hypotheses": files}
    merged = {name: {**fields, **overrides.get(name, {})} for name, fields in sections.items()}
    return load_session(None, {"title": path.stem, **overrides, **merged})


def _other_images(dataset: BopDataset, wanted: Sequence[tuple[int, int]]) -> str:
    """A hint where a data set has a scene of the poses with other images; empty where it has none of the scenes."""
    scene_id, im_id = next((ids for ids in wanted if ids[0] in dataset.scene_ids), (None, None))
    if scene_id is None:
        return ""
    images = listed(dataset.image_ids(scene_id))
    return f"; scene {scene_id} of {dataset.folder} has images {images}, the poses are of image {im_id}"


def _folders_near(path: Path) -> Iterator[Path]:
    """The folders above a file and what lies in them, those first that its name speaks of (method_ycbv-test.csv)."""
    above = path.resolve().parents[:LEVELS_UP]
    near = [*above, *islice((inside for folder in above for inside in _folders_in(folder)), MOST_FOLDERS)]
    named = re.search(r"_([^_]+)-[^_]+$", path.stem)
    yield from sorted(near, key=lambda folder: named is None or folder.name != named[1])


def _folders_in(folder: Path) -> list[Path]:
    """The folders in a folder; none where it may not be listed, such as one of another user above the file."""
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError:
        return []


def _splits(folder: Path, path: Path) -> Iterator[str]:
    """The splits of a data set, those first that the file's name speaks of; none where it is no data set."""
    named = re.search(r"_[^_]+-([^_]+)$", path.stem)
    yield from sorted(splits_to_open(folder), key=lambda split: named is None or not split.startswith(named[1]))
