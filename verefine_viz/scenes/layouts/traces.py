"""Traces that ``verefine_viz/trace.py`` wrote, each a frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.recorded_frame import RecordedFrame
from verefine_viz.scenes.trace_files import begun_at, left_out_of, object_names, read_trace, recorded_answers, traces_in


class Reader:
    """The traces of a folder; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "traces"
    LOOKS_LIKE = "calls.jsonl, depth.npy"
    NEEDS = ()
    has_poses = True
    has_truth = False

    def __init__(self, folder: Path) -> None:
        self._folders = {path.resolve().name: path for path in traces_in(folder)}
        if not self._folders:
            raise InputError(f"{folder} holds no trace; expected a folder that verefine_viz.trace.Trace was given")
        self.names = tuple(self._folders)
        self.is_sequence = len(self.names) > 1 and all(name.isdecimal() for name in self.names)
        left_out = left_out_of(folder)
        note = f"traces left out: {listed(left_out)}"
        self.notes = (note,) * bool(left_out)
        by_age = sorted(self._folders.values(), key=begun_at)
        names = dict.fromkeys(name for path in by_age for name in object_names(path))
        self.objects: Mapping[str, int] = {name: k for k, name in enumerate(names, 1)}
        """Numbers in the order of first occurrence, over traces in the order of their beginnings."""

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return bool(traces_in(folder))

    def frame(self, name: str) -> RecordedFrame:
        """One of the traces; InputError where it cannot be read."""
        return read_trace(self._folders[name])

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """The final poses of a trace, and their scores; none where it cannot be read."""
        try:
            return recorded_answers(self._folders[name])
        except InputError:
            return {}
