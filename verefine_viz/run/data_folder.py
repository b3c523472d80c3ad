"""What data lie in a folder or a results file, and a session over all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, VerefineError, one_line
from verefine_viz.core.files import read_file
from verefine_viz.core.frame_names import frame_name
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.run.built_in_sessions import named_session
from verefine_viz.run.results_session import SUFFIXES, results_session
from verefine_viz.run.session_file import CAPTURE_HEAD, LARGEST_BYTES, load_session
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.bop_files import (
    Inside,
    datasets_below,
    has_truth,
    inside_dataset,
    nearby_hint,
    scenes_in,
    sensors_of,
    splits_in,
    splits_to_open,
)
from verefine_viz.scenes.foreign_folders import what_is_not_read
from verefine_viz.scenes.frames import frames_of_scene
from verefine_viz.scenes.layouts import lacking, readers, recording_in, recordings_near
from verefine_viz.scenes.recorded_frame import LayoutReader
from verefine_viz.scenes.results_files import YAML, read_estimates

SCENES, CAMERAS, SESSION = "*/[0-9]*", "scene_camera*.json", "session.toml"
"""Scenes of a BOP data set, the files that list the images of one, and the session of a folder of kept frames."""
LOOKED_FOR = ("run files (.vfrun)", "kept frames (session.toml)", "a data set in BOP layout")


@dataclass(frozen=True)
class KnownData:
    """Data that were recognized."""

    what: str
    """As shown to the user: "2 traces"."""
    session: Session
    notes: tuple[str, ...] = ()
    """What of them cannot be used."""


def data_at(folder: Path, overrides: Mapping[str, Any]) -> KnownData | None:
    """What lies in a folder or a results file, with a session over it and ``overrides``; None where it is none of data.

    Raises:
        VerefineError: it is damaged, or the overrides do not fit it.
    """
    if folder.suffix in SUFFIXES and folder.is_file():
        if (meant := _meant_folder(folder)) and not _holds_poses(folder):
            raise InputError(f"{folder} holds no poses; {meant}")
        session, missing = results_session(folder, overrides)
        n = len(session.scene.frames)
        more = f" ({missing} more frame{'s' * (missing > 1)} of the file are not there)" if missing else ""
        of = f"{session.scene.dataset}, split {session.scene.split}"
        return KnownData(f"poses for {n} frame{'s' * (n > 1)} of {of}{more}", session)
    if not folder.is_dir():
        return None
    own = folder / SESSION
    if own.is_file() and read_file(own, "session file", LARGEST_BYTES).startswith(CAPTURE_HEAD.encode()):
        return KnownData("kept frames", load_session(own, overrides))
    if recording := recording_in(folder):
        return _recorded(folder, recording, overrides)
    if splits := splits_to_open(folder):
        return _bop(folder, splits, overrides)
    inside = inside_dataset(folder)
    return None if inside is None else _part_of_bop(inside, overrides)


def _bop(folder: Path, splits: Sequence[str], overrides: Mapping[str, Any]) -> KnownData:
    """A data set in BOP layout, its splits in the order in which they are opened."""
    split = overrides.get("scene", {}).get("split", splits[0])
    sections = {
        "scene": {"dataset": str(folder.resolve()), "source": "bop", "split": split},
        "hypotheses": {"source": "perturb" if has_truth(folder / split) else "ppf"},
    }
    others = ", ".join(name for name in splits if name != split)
    what = f"a data set in BOP layout, split {split}{f' (also: {others})' if others else ''}"
    return KnownData(one_line(what), _session(folder, sections, overrides))


def _part_of_bop(inside: Inside, overrides: Mapping[str, Any]) -> KnownData | None:
    """The split or the scene that a folder is, opened from its data set."""
    scene = {"split": inside.split, **overrides.get("scene", {})}
    if inside.scene_id is not None and "frames" not in scene:
        dataset = BopDataset(inside.dataset, inside.split, sensor=scene.get("sensor", ""))
        scene["frames"] = tuple(map(frame_name, frames_of_scene(dataset, inside.scene_id)))
    known = data_at(inside.dataset, {**overrides, "scene": scene})
    part = f"split {inside.split}" if inside.scene_id is None else f"scene {inside.scene_id} of split {inside.split}"
    return known and KnownData(one_line(f"{part} of the data set {inside.dataset}"), known.session)


def _recorded(folder: Path, recording: LayoutReader, overrides: Mapping[str, Any]) -> KnownData:
    n = len(recording.names)
    source = "recorded" if recording.has_poses else "perturb" if recording.has_truth else "ppf"
    scene = {"dataset": str(folder.resolve()), "source": "folder"}
    sections: dict[str, Any] = {"scene": scene, "hypotheses": {"source": source}}
    if {"source": source, **overrides.get("hypotheses", {})}["source"] == "recorded":
        sections["method"] = {"name": "trace"}
    what = f"{recording.LAYOUT}, {n} frame{'s' * (n > 1)}"
    return KnownData(what, _session(folder, sections, overrides), tuple(recording.notes))


def _session(folder: Path, sections: Mapping[str, Mapping[str, Any]], overrides: Mapping[str, Any]) -> Session:
    given = {name: {**fields, **overrides.get(name, {})} for name, fields in sections.items()}
    return load_session(None, {"title": one_line(folder.resolve().name), **overrides, **given})


def holds_frames(folder: Path) -> bool:
    """Whether a folder holds frames itself, not in folders of it that do."""
    return _is_recording(folder) or any(folder.glob(f"{SCENES}/{CAMERAS}"))


def open_session(
    path: Path, overrides: Mapping[str, Any], report: Callable[[str], None] = lambda line: None
) -> Session:
    """The session of a file or of a built-in name, or over the data that lie at a path.

    Args:
        path: where it is.
        overrides: settings on top.
        report: gets a line about data that were recognized.

    Raises:
        VerefineError: it is neither, or is damaged.
    """
    path = named_session(path)
    known = data_at(path, overrides)
    if known is not None:
        report(f"{one_line(str(path))}: {known.what}")
        return known.session
    if path.is_dir() and not (path / SESSION).exists():
        raise InputError(f"{path} {layout_fault(path)}")
    if path.is_file() and path.suffix != ".toml" and (meant := _meant_folder(path)):
        raise InputError(f"{path} is no session; {meant}")
    return load_session(path, overrides)


def layout_fault(folder: Path) -> str:
    """What a folder that is none of data lacks, or what was looked for."""
    results = sorted(path for path in folder.iterdir() if path.suffix in SUFFIXES and _holds_poses(path))
    hint = f"; it holds poses, {results[0]}: open that file" if results else ""
    unknown = f"holds no data that are known; looked for {looked_for()}{hint}"
    return _meant(folder) or lacking(folder) or what_is_not_read(folder) or unknown


def _is_recording(folder: Path) -> bool:
    return any(reader.recognizes(folder) for reader in readers())


def _meant_folder(path: Path) -> str:
    """A hint at the folder of a file where that is a recording; else empty."""
    folder = path.absolute().parent
    return f"did you mean its folder, {folder}?" if _is_recording(folder) else ""


def _holds_poses(path: Path) -> bool:
    """Whether a file with the ending of results may hold poses; YAML is looked into, as many programs write it."""
    if path.suffix not in YAML:
        return True
    try:
        return bool(read_estimates(path).rows)
    except VerefineError:
        return False


def looked_for() -> str:
    """What folders of data are recognized as."""
    return ", ".join((*LOOKED_FOR, *(reader.LAYOUT for reader in readers())))


def _meant(folder: Path) -> str:
    """What a folder lacks to be of a data set in BOP layout, or which ones lie in it; empty where it is like none."""
    if sensors_of(folder):
        return "is a scene in BOP layout, but not named by its number: expected DATASET/test/000001"
    if near := nearby_hint(folder / "scene_camera.json"):
        return f"has no scene_camera.json{near}"
    for split in splits_in(folder):
        scene = next(iter(scenes_in(folder / split).values()))[0]
        if near := nearby_hint(scene / "scene_camera.json"):
            return f"has no {split}/{scene.name}/scene_camera.json{near}"
    below = [path for path in datasets_below(folder) if splits_to_open(path)]
    meant = first_of(below, MOST_NAMED, " or ") if below else recordings_near(folder)
    return f"is no data set itself; did you mean {meant}?" if meant else ""
