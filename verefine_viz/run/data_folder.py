"""What kind of data a folder holds, and a session over all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, in_one_line
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import CAPTURE_HEAD, load_session
from verefine_viz.scenes.pose_sequence import CAMERA, DEPTH, PoseSequence, is_sequence
from verefine_viz.scenes.trace_files import traces_in

SCENES, CAMERAS, SESSION = "*/[0-9]*", "scene_camera.json", "session.toml"
"""Scenes of a BOP data set, the file that lists the images of one, and the session of a folder of ``keep_frame``."""
LOOKED_FOR = (
    "run files (.vfrun), traces (calls.jsonl), frames of keep_frame (session.toml), a data set in BOP layout "
    "(SPLIT/000001/scene_camera.json), and a sequence as FoundationPose's demo has it (cam_K.txt, depth/, rgb/, mesh/)"
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
    if traces := traces_in(folder):
        n = len(traces)
        what = "1 trace" if n == 1 else f"{n} traces"
        return DataFolder(what, _recorded(folder, {**source, "source": "trace"}, overrides))
    if is_sequence(folder):
        n = len(PoseSequence(folder).names)
        what = f"a sequence of {n} frames in the layout of FoundationPose"
        return DataFolder(what, _recorded(folder, {**source, "source": "sequence"}, overrides))
    splits = sorted({path.parent.parent.name for path in folder.glob(f"{SCENES}/{CAMERAS}")})
    if not splits:
        return None
    has_gt = any(folder.glob(f"{splits[0]}/[0-9]*/scene_gt.json"))
    sections = {
        "scene": {**source, "source": "bop", "split": splits[0]},
        "hypotheses": {"source": "perturb" if has_gt else "ppf"},
    }
    return DataFolder(f"a data set in BOP layout, split {splits[0]}", _session(folder, sections, overrides))


def _recorded(folder: Path, scene: dict[str, Any], overrides: Mapping[str, Any]) -> Session:
    sections: dict[str, Any] = {"scene": scene, "hypotheses": {"source": "recorded"}}
    if overrides.get("hypotheses", {}).get("source", "recorded") == "recorded":
        sections["method"] = {"name": "trace"}
    return _session(folder, sections, overrides)


def _session(folder: Path, sections: Mapping[str, Mapping[str, Any]], overrides: Mapping[str, Any]) -> Session:
    given = {name: {**fields, **overrides.get(name, {})} for name, fields in sections.items()}
    return load_session(None, {"title": in_one_line(folder.resolve().name), **overrides, **given})


def holds_frames(folder: Path) -> bool:
    """Whether a folder holds frames itself, not in folders of it that do."""
    return bool(traces_in(folder)) or is_sequence(folder) or any(folder.glob(f"{SCENES}/{CAMERAS}"))


def open_session(path: Path, overrides: Mapping[str, Any]) -> Session:
    """The session of a file, or over the data of a folder, with ``overrides`` on top.

    Raises:
        VerefineError: it is neither, or is damaged.
    """
    known = data_folder(path, overrides) if path.is_dir() else None
    if known is None and is_begun(path):
        raise InputError(f"{path} {why_unknown(path)}")
    return load_session(path, overrides) if known is None else known.session


def is_begun(folder: Path) -> bool:
    """Whether a folder that is none of data has parts of a sequence."""
    return (folder / DEPTH).is_dir() or (folder / CAMERA).is_file()


def why_unknown(folder: Path) -> str:
    """What a folder that is none of data lacks, or what was looked for."""
    if (folder / DEPTH).is_dir() and not (folder / CAMERA).is_file():
        return f"has {DEPTH}/ but no {CAMERA}: write the 3×3 camera matrix [px] into it"
    if (folder / CAMERA).is_file():
        return f"has {CAMERA} but no {DEPTH}/: save a depth image [mm] per frame there"
    return f"holds no data that are known; looked for {LOOKED_FOR}"
