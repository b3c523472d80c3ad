"""Writes what another program recorded as a folder of kept frames: a data set in BOP layout with a session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import first_line
from verefine_viz.run.capture_folder import CaptureFolder, captured
from verefine_viz.run.data_folder import data_at, looked_for
from verefine_viz.scenes.source import open_scene


def imported(folder: Path, out: Path) -> Iterator[str]:
    """Writes the frames of traces, or of a sequence, one after the other; gives a line about each.

    Args:
        folder: what is read.
        out: a new folder, or one that was written so before, to which frames are added.

    Raises:
        InputError: ``folder`` holds nothing that was recorded, or ``out`` something else.
    """
    known = data_at(folder, {})
    if known is None:
        raise InputError(f"{folder} holds nothing that can be imported; looked for {looked_for()}")
    if known.session.scene.source != "folder":
        raise InputError(f"{folder} holds {known.what}; no import is needed: verefine-viz view {folder}")
    source = open_scene(known.session.scene, known.session.hypotheses)
    capture = CaptureFolder(out, source.is_sequence)
    yield f"{folder}: {known.what}"
    for frame in source.frames:
        try:
            problem = source.problem(frame)
            yield f"{frame} → {capture.add(captured(problem))}"
        except Exception as error:  # The others are imported all the same.
            yield f"{frame} failed: {first_line(error)}"
