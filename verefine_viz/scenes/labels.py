"""Labels: poses of the objects in frames without ground truth, each with its verification; and their file.

A label made by a person is refined, rests on its support and states what is undetermined (docs/methods.md 9). The file
``labels.json`` is the record of the work: it is read to continue the work, and says who made which pose, and how.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct, to_builtins

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, ShapeError
from verefine_viz.core.files import read_json
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.writing import write_json

LABELS = "labels.json"
VERSION = 1

Light = Literal["green", "amber", "red"]
State = Literal["proposed", "accepted", "uncertain"]
Pose16 = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]


class Label(Struct, frozen=True, forbid_unknown_fields=True):
    """The pose of one object of a frame, and its verification."""

    instance: Annotated[int, Meta(ge=0, le=100_000)]
    """Number of the object in its frame; numbers are not reused within a frame."""
    obj_id: Annotated[int, Meta(ge=0)]
    name: str
    T_cam_obj: Pose16
    """By rows [m]."""
    light: Light
    """green: verified; amber: verified except for the reasons; red: something speaks against it."""
    reasons: tuple[str, ...] = ()
    """Short facts about the data: "turn about z ±14°: not seen"."""
    state: State = "proposed"
    """The person's decision."""
    note: str = ""
    """The person's note about an uncertain label."""
    score: float = 0.0
    """In [0, 1] (Eq. 1)."""
    fit_mm: float = 0.0
    """Mean distance of measured depth to the model where both see the object [mm]."""
    seen: float = 0.0
    """Share of the drawn object that is confirmed by measured depth, in [0, 1]."""
    sinks_mm: float = 0.0
    """How deep it sinks into its support or a neighbour [mm]."""
    undetermined_mm: float = 0.0
    """The largest shift that the image cannot distinguish [mm]."""
    undetermined_deg: float = 0.0
    """The largest such turn [deg]; 180 about an axis of symmetry."""
    begun: str = "placed"
    """Origin of its pose: placed, estimated, given (by a person, or a call), or carried from a frame."""
    refiner: str = ""
    by: str = ""
    """Who accepted it."""
    at: str = ""
    """Time of the acceptance, as 2026-01-31T12:00:00."""
    seconds: float = 0.0
    """The program's own time for it [s]."""

    @property
    def pose(self) -> Float:
        """(4, 4) T_cam_obj [m]."""
        return np.reshape(self.T_cam_obj, (4, 4))


class LabelsFile(Struct, frozen=True, forbid_unknown_fields=True):
    """Content of ``labels.json``."""

    version: Literal[1]
    frames: dict[str, tuple[Label, ...]]
    """By "scene/image"; a frame with an empty list was looked at and holds nothing."""


def read_labels(path: Path) -> dict[str, tuple[Label, ...]]:
    """The labels of a file by frame; none where there is no file.

    Raises:
        InputError: it is damaged, an entry names no frame, an instance occurs twice, or a pose is invalid.
    """
    if not path.exists():
        return {}
    frames: dict[str, tuple[Label, ...]] = {}
    for frame, labels in read_json(path, LabelsFile).frames.items():
        try:
            name = frame_name(parse_frame(frame))
            for label in labels:
                as_rigid(label.pose, f"frame {name}, instance {label.instance}")
        except (SettingsError, ShapeError) as error:
            raise InputError(f"{path}: {error}") from None
        numbers = [label.instance for label in labels]
        if len({*numbers}) < len(numbers):
            raise InputError(f"{path}: frame {name} has two labels of one instance; remove one of them")
        frames[name] = labels
    return frames


def write_labels(path: Path, frames: dict[str, tuple[Label, ...]]) -> None:
    """Write all labels, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    ordered = dict(sorted(frames.items(), key=lambda item: parse_frame(item[0])))
    write_json(path, to_builtins(LabelsFile(VERSION, ordered)))
