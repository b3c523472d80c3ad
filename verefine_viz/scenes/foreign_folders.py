"""Folders of other programs that are known by the names in them but are not read, and what to do with each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

CLIP = "holds HOT3D clips: their cameras are fisheyes without depth; poses are verified by depth, of a pinhole camera"
SYNTHETIC = (
    "holds frames of DOPE's scripts for NVISII or BlenderProc, whose depth and segmentation are EXR; export with NDDS, "
    "or write a trace (verefine_viz.trace)"
)
EXR = (
    "holds EXR images, which are not read; save the values of each by numpy.save, as 000001.npy in place of 000001.exr"
)


@dataclass(frozen=True)
class ForeignFolder:
    """A kind of folder."""

    patterns: tuple[str, ...]
    """All of them have files in it."""
    words: str
    """What it is and what to do."""


KNOWN = (
    ForeignFolder(("*.cameras.json", "*.objects.json"), CLIP),
    ForeignFolder(("clip-*.tar",), CLIP),
    ForeignFolder(("[0-9]*.json", "*.exr"), SYNTHETIC),
    ForeignFolder(("*.exr",), EXR),
    ForeignFolder(("*/*.exr",), EXR),
)


def what_is_not_read(folder: Path) -> str:
    """What a folder holds that is known and not read; empty where it is none of these."""
    return next((one.words for one in KNOWN if all(any(folder.glob(p)) for p in one.patterns)), "")
