"""Parts of a data set's split, and what can be run with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.scenes.bop_files import datasets_below, has_models, scenes_in, splits_in


@dataclass
class CheckRow:
    """One row: what was checked, with which result, and what to do about it."""

    name: str
    result: str
    advice: str = ""
    """What to do; empty where nothing needs to be done."""
    is_checked: bool = True
    """Whether it was checked; if not, ``result`` says what has to be mended first."""

    @property
    def cells(self) -> tuple[str, str, str]:
        """The row as it is printed."""
        mark = "look" if self.advice else "ok" if self.is_checked else "–"
        return self.name, mark, self.result + (f"\n→ {self.advice}" if self.advice else "")


@dataclass
class Parts:
    """Parts that a split has, which decide what can be run on it."""

    before_all: str = ""
    """A missing part without which nothing else could be checked, and why; empty = none."""
    models: bool = False
    depth: bool = False
    masks: tuple[str, ...] = ()
    """The kinds of masks that exist: mask_visib, mask and detections files."""
    detections: bool = False
    """Whether some of the masks are detections, which name their object."""
    ground_truth: bool = False
    damaged_ground_truth: str = ""
    """What is wrong with the ground truth where none of it can be used; empty where there is none, or some is good."""
    scoring: str = ""
    """What BOP scores lack besides ground truth and depth; empty = nothing."""
    with_camera_pose: int = 0
    """Opened frames whose camera pose is known, and with it which way is up."""
    findings: list[CheckRow] = field(default_factory=list)

    def add(self, name: str, result: str, advice: str = "") -> None:
        self.findings.append(CheckRow(name, result, advice))

    def skip(self, name: str, why: str) -> None:
        """Add a row for a part that was not checked."""
        self.findings.append(CheckRow(name, why, is_checked=False))

    @property
    def names_objects(self) -> bool:
        """Whether anything says which object each mask is of."""
        return self.ground_truth or self.detections


def runnable_parts(parts: Parts) -> list[tuple[str, str]]:
    """Tasks, and what is missing for each ("" = nothing)."""
    damaged = f"ground truth that can be read ({parts.damaged_ground_truth})" if parts.damaged_ground_truth else ""
    unnamed = damaged or "what says which object is where: scene_gt.json, or a detections JSON"
    scored = [what for what, there in (("models", parts.models), ("depth", parts.depth)) if not there]
    basics = [*scored, *["masks"] * (not parts.masks)]
    truth = [damaged or "scene_gt.json"] * (not parts.ground_truth)
    named = [unnamed] * (bool(parts.masks) and not parts.names_objects)
    needed = {
        "view and batch from ground truth, disturbed (hypotheses.source perturb)": [*basics, *truth],
        "view and batch from a results file or an estimator (results, ppf, pcs)": [*basics, *named],
        "study: errors against ground truth": [*basics, *truth],
        "evaluate: BOP scores of a results file": [*scored, *truth, *[parts.scoring] * (parts.scoring != "")],
        "gravity from the camera's pose, if the data set's z is up (scene.gravity world)": (
            ["cam_R_w2c"] * (not parts.with_camera_pose)
        ),
    }
    return [(what, parts.before_all or ", ".join(missing)) for what, missing in needed.items()]


# Which splits a data set's folder holds, and what was probably meant where another folder is named.


def splits_of(folder: Path) -> tuple[str, ...]:
    """The folders in a data set that hold scenes.

    Raises:
        InputError: the folder does not exist, holds none, or holds data sets instead.
    """
    if not folder.is_dir():
        why = "is a file" if folder.exists() else "does not exist"
        raise InputError(f"{folder} {why}; give the folder that holds models/ and the splits (test/, …)")
    splits = splits_in(folder)
    if scenes_in(folder):
        raise InputError(f"{folder} is a split itself: name the data set's folder, {folder.resolve().parent}")
    if splits and has_models(folder):
        return splits
    # A folder of data sets may hold numbered folders of something else, which look like scenes.
    below = datasets_below(folder)
    with_models = [path for path in below if has_models(path)]
    if splits and not with_models:
        return splits
    expected = f"expected for example {folder / 'test' / '000001' / 'scene_camera.json'}"
    meant = f"did you mean {first_of(with_models or below, MOST_NAMED, ' or ')}?" if below else expected
    raise InputError(f"{folder} holds no split with scenes; {meant}")
