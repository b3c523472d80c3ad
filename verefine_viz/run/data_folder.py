"""What kind of data a folder holds, and a session over all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, in_one_line
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import CAPTURE_HEAD, load_session
from verefine_viz.scenes.layouts import readers, recording_in
from verefine_viz.scenes.layouts.foundation_pose import lacking
from verefine_viz.scenes.recorded_frame import Recording

SCENES, CAMERAS, SESSION = "*/[0-9]*", "scene_camera.json", "session.toml"
"""Scenes of a BOP data set, the file that lists the images of one, and the session of a folder of ``keep_frame``."""
LOOKED_FOR = (
    "run files (.vfrun)",
    "session.toml (frames of keep_frame)",
    "SPLIT/000001/scene_camera.json (a data set in BOP layout)",
)


@dataclass(frozen=True)
class DataFolder:
    """A folder of data that was recognized."""

    what: str
    """As shown to the user: "2 traces"."""
    session: Session


def data_folder(folder: Path, overrides: Mapping[str, Any]) -> DataFolder | None:
    """What a folder holds, and a session over it with ``overrides``; None where it is nothing that is known.

    Raises:
        VerefineError: it holds something that is damaged, or the overrides do not fit it.
    """
    own = folder / SESSION
    if own.is_file() and own.read_text("utf-8", errors="replace").startswith(CAPTURE_HEAD):
        return DataFolder("frames of keep_frame", load_session(own, overrides))
    source = {"dataset": str(folder.resolve())}
    if recording := recording_in(folder):
        return _recorded(folder, recording, overrides)
    splits = sorted({path.parent.parent.name for path in folder.glob(f"{SCENES}/{CAMERAS}")})
    if not splits:
        return None
    has_gt = any(folder.glob(f"{splits[0]}/[0-9]*/scene_gt.json"))
    sections = {
        "scene": {**source, "source": "bop", "split": splits[0]},
        "hypotheses": {"source": "perturb" if has_gt else "ppf"},
    }
    return DataFolder(f"a data set in BOP layout, split {splits[0]}", _session(folder, sections, overrides))


def _recorded(folder: Path, recording: Recording, overrides: Mapping[str, Any]) -> DataFolder:
    n = len(recording.names)
    source = "recorded" if recording.has_poses else "perturb" if recording.has_truth else "ppf"
    scene = {"dataset": str(folder.resolve()), "source": "folder"}
    sections: dict[str, Any] = {"scene": scene, "hypotheses": {"source": source}}
    if {"source": source, **overrides.get("hypotheses", {})}["source"] == "recorded":
        sections["method"] = {"name": "trace"}
    return DataFolder(f"{recording.LAYOUT}, {n} frame{'s' * (n > 1)}", _session(folder, sections, overrides))


def _session(folder: Path, sections: Mapping[str, Mapping[str, Any]], overrides: Mapping[str, Any]) -> Session:
    given = {name: {**fields, **overrides.get(name, {})} for name, fields in sections.items()}
    return load_session(None, {"title": in_one_line(folder.resolve().name), **overrides, **given})


def holds_frames(folder: Path) -> bool:
    """Whether a folder holds frames itself, not in folders of it that do."""
    return any(reader.recognizes(folder) for reader in readers()) or any(folder.glob(f"{SCENES}/{CAMERAS}"))


def open_session(path: Path, overrides: Mapping[str, Any]) -> Session:
    """The session of a file, or over the data of a folder, with ``overrides`` on top.

    Raises:
        VerefineError: it is neither, or is damaged.
    """
    known = data_folder(path, overrides) if path.is_dir() else None
    if known is None and lacking(path):
        raise InputError(f"{path} {why_unknown(path)}")
    return load_session(path, overrides) if known is None else known.session


def why_unknown(folder: Path) -> str:
    """What a folder that is none of data lacks, or what was looked for."""
    return lacking(folder) or f"holds no data that are known; looked for {looked_for()}"


def looked_for() -> str:
    """What folders of data are recognized by."""
    layouts = [f"{reader.LOOKS_LIKE} ({reader.LAYOUT})" for reader in readers()]
    return "; ".join((*LOOKED_FOR, *layouts))
