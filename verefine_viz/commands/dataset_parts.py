"""What a split of a data set has, and what can be run on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import MOST_NAMED, first_of

MOST_FAULTS = 3
"""Faults of one kind that are named."""


@dataclass
class Finding:
    """One row: what was checked, with which result, and what to do about it."""

    name: str
    result: str
    advice: str = ""
    """Empty where nothing needs to be done."""
    is_checked: bool = True
    """False where something else has to be mended first; ``result`` says what."""


@dataclass
class Parts:
    """What a split has; decides what can be run on it."""

    before_all: str = ""
    """What is missing without which nothing else could be checked, and why; empty = nothing."""
    models: bool = False
    depth: bool = False
    masks: tuple[str, ...] = ()
    """Of mask_visib, mask, and detections files."""
    detections: bool = False
    """Whether some of the masks are detections, which name their object."""
    ground_truth: bool = False
    damaged_ground_truth: str = ""
    """What is wrong with the ground truth where none of it can be used; empty where there is none, or some is good."""
    scoring: str = ""
    """What BOP scores lack besides ground truth and depth; empty = nothing."""
    frames: int = 0
    with_camera_pose: int = 0
    """Frames whose camera pose is known, and with it which way is up."""
    findings: list[Finding] = field(default_factory=list)

    def add(self, name: str, result: str, advice: str = "") -> None:
        self.findings.append(Finding(name, result, advice))

    def skip(self, name: str, why: str) -> None:
        """Adds a row of what was not checked."""
        self.findings.append(Finding(name, why, is_checked=False))

    @property
    def names_objects(self) -> bool:
        """Whether anything says which object each mask is of."""
        return self.ground_truth or self.detections


def what_can_be_run(parts: Parts) -> list[tuple[str, str]]:
    """Pairs of something that can be done and what is missing for it ("" = nothing)."""
    return [(what, parts.before_all or missing) for what, missing in _by_part(parts)]


def _by_part(parts: Parts) -> list[tuple[str, str]]:
    scored = [word for word, there in (("models", parts.models), ("depth", parts.depth)) if not there]
    basics = [*scored, *([] if parts.masks else ["masks"])]
    damaged = f"ground truth that can be read ({parts.damaged_ground_truth})" if parts.damaged_ground_truth else ""
    ground_truth = [] if parts.ground_truth else [damaged or "scene_gt.json"]
    unnamed = damaged or "what says which object is where: scene_gt.json, or a detections JSON"
    named = [unnamed] if parts.masks and not parts.names_objects else []
    some = 0 < parts.with_camera_pose < parts.frames
    how_many = f", for {parts.with_camera_pose} of {parts.frames} frames" if some else ""
    return [
        (
            "view and batch from ground truth, disturbed (hypotheses.source perturb)",
            ", ".join([*basics, *ground_truth]),
        ),
        ("view and batch from a results file or an estimator (results, ppf, pcs)", ", ".join([*basics, *named])),
        ("study: errors against ground truth", ", ".join([*basics, *ground_truth])),
        (
            "evaluate: BOP scores of a results file",
            ", ".join([*scored, *ground_truth, *([parts.scoring] * (parts.scoring != ""))]),
        ),
        (
            f"gravity from the camera's pose, if the data set's z is up (scene.gravity world){how_many}",
            "" if parts.with_camera_pose else "cam_R_w2c",
        ),
    ]


# Which splits a data set's folder holds, and what was probably meant where another folder is named.


def splits_of(folder: Path) -> tuple[str, ...]:
    """The folders in a data set that hold scenes.

    Raises:
        InputError: the folder does not exist, or holds none.
    """
    if not folder.is_dir():
        why = "is a file" if folder.exists() else "does not exist"
        raise InputError(f"{folder} {why}; give the folder that holds models/ and the splits (test/, …)")
    splits = _splits(folder)
    if not splits:
        raise InputError(f"{folder} holds no split with scenes; {_meant(folder)}")
    return tuple(splits)


def _splits(folder: Path) -> list[str]:
    return [d.name for d in sorted(folder.iterdir()) if d.is_dir() and any(_scene_folders(d))]


def _meant(folder: Path) -> str:
    if any(_scene_folders(folder)):
        return f"it is a split itself: name the data set's folder, {folder.resolve().parent}"
    inside = [d for d in sorted(folder.iterdir()) if d.is_dir() and _splits(d)]
    if inside:
        return f"did you mean {first_of(inside, MOST_NAMED, ' or ')}?"
    return f"expected for example {folder / 'test' / '000001'}"


def _scene_folders(split: Path) -> Iterator[Path]:
    return (d for d in split.iterdir() if d.is_dir() and d.name.isdecimal())
