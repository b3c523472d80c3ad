"""A recording in the rerun viewer, and a recording against a new run of its session."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from rerun.chunk import Chunk

from verefine_viz.core.compare import first_difference
from verefine_viz.recording.blueprint import blueprint_messages
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.entities import MAPS, SCENE_MAPS
from verefine_viz.recording.entry import as_recorded
from verefine_viz.recording.frame import property_chunks
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.reader import (
    PROPERTIES,
    Recorded,
    chunks_of,
    existing,
    final_path,
    has_content,
    read_recording,
    readable,
)
from verefine_viz.recording.recorder import versions
from verefine_viz.recording.rrd_file import RrdFile
from verefine_viz.recording.viewer_process import LOOPBACK, free_port, has_display, start_viewer
from verefine_viz.session.engine import Run

MakeRun = Callable[[Recorded], Run]


@dataclass(frozen=True)
class OpenViewer:
    """A rerun viewer that shows a recording."""

    process: subprocess.Popen[bytes]
    address: str
    """What to type into a browser; empty = it is a window of its own."""


def open_viewer(path: Path, web: bool | None = None) -> OpenViewer:
    """Opens a recording in the rerun viewer, which is reachable from this machine only.

    Args:
        path: the recording; one of a killed run is completed into a temporary copy first.
        web: in the browser; None = where no window can be opened.

    Raises:
        InputError: it is not a recording of this program.
        UnavailableError: the viewer is not installed.
    """
    path = existing(path)
    recorded = read_recording(path)
    if not recorded.is_complete:
        path = completed(recorded, Path(tempfile.mkdtemp(prefix="verefine-")))
    # Its own lines of progress would bury ours.
    env = {"RUST_LOG": "warn", **os.environ}
    in_browser = not has_display() if web is None else web
    if not in_browser:
        return OpenViewer(start_viewer([str(path)], env), "")
    page, data = free_port(), free_port()
    arguments = [str(path), "--web-viewer", "--web-viewer-port", str(page), "--port", str(data)]
    # The page alone would be empty: it has to be told where the recording comes from.
    source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
    return OpenViewer(start_viewer(arguments, env), f"http://{LOOPBACK}:{page}?url={source}")


def completed(recorded: Recorded, folder: Path) -> Path:
    """A copy of an unfinished recording in ``folder``, with all its iterations drawn."""
    target = folder / final_path(recorded.path).name
    chunks: list[Chunk] = []
    if has_content(recorded.path):
        with readable(recorded.path) as file:
            chunks = chunks_of(file)
    has_maps = any(_is_map(chunk) for chunk in chunks)
    drawing = Drawing(recorded.layout)
    file = RrdFile(target)
    if not any(chunk.entity_path == PROPERTIES for chunk in chunks):
        file.send(property_chunks(recorded.properties))
    file.send(drawing.start())
    # What was drawn may end anywhere in a block of iterations, so all of them are drawn again.
    file.send(Piece.of(chunk) for chunk in chunks if chunk.is_static or _is_map(chunk))
    if recorded.entries:
        file.send(drawing.draw(recorded.entries))
    file.close(blueprint_messages(recorded.layout, has_maps))
    return target


def _is_map(chunk: Chunk) -> bool:
    return chunk.entity_path.startswith((f"{MAPS}/", f"{SCENE_MAPS}/"))


@dataclass(frozen=True)
class Verdict:
    """A recording against a new run of its session."""

    n_compared: int
    """Iterations of both that were looked at and found the same, from the first."""
    difference: str | None
    """Where the new run first differs, and how; None = nowhere."""
    n_planned: int
    """Iterations that the new run has in all."""
    is_complete: bool
    """Whether the recording goes to its end."""

    @property
    def ends_early(self) -> bool:
        """Nothing differs, but the end of the recording is missing: it was stopped, or cut off."""
        return self.difference is None and not self.is_complete

    @property
    def in_words(self) -> str:
        if self.difference is not None:
            return f"differs: {self.difference}"
        if not self.ends_early:
            short = "" if self.n_compared == self.n_planned else f"; the whole run has {self.n_planned}"
            return f"no difference in {self.n_compared} iterations{short}"
        early = f"ended early, after {self.n_compared} of {self.n_planned} iterations (it was stopped or cut off)"
        return f"{early}; the same up to iteration {self.n_compared}" if self.n_compared else early


def verify(path: Path, make_run: MakeRun | None = None) -> str | None:
    """Where a new run of the recorded session first differs, and how; None = nowhere. See :func:`verdict`."""
    return verdict(path, make_run).difference


def verdict(path: Path, make_run: MakeRun | None = None) -> Verdict:
    """Runs the recorded session again and compares bit by bit, as far as the recording goes.

    Args:
        path: the recording.
        make_run: builds the run of a recording; None = from its session, with the real simulator, refiner and verifier.

    Raises:
        InputError: it is not a recording of this program, or its data are gone.
    """
    recorded = read_recording(path)
    run = (make_run or run_again)(recorded)
    difference = None
    n_compared = 0
    for iteration in recorded.iterations:
        if run.is_done:
            difference = f"iteration {iteration.index}: recorded, but the new run ended after {run.length}"
            break
        found = first_difference(iteration, as_recorded(run.step()))
        if found:
            difference = f"iteration {iteration.index}: {found}"
            break
        n_compared += 1
    if difference is not None:
        difference += _other(recorded)
    return Verdict(n_compared, difference, run.n_iterations, recorded.is_complete)


def run_again(recorded: Recorded) -> Run:
    """The run of a recording's session and frame, not yet stepped."""
    # The engine's parts are heavy, and opening a recording does not need them.
    from verefine_viz.session.toolbox import Toolbox

    toolbox = Toolbox(recorded.session)
    problem = toolbox.problem(recorded.frame).only([b.instance_id for b in recorded.layout.branches])
    return toolbox.run(problem)


def _other(recorded: Recorded) -> str:
    """What is installed in another version here, which may be the reason."""
    here = versions()
    changed = [f"{n} {v} (here {here.get(n)})" for n, v in recorded.versions.items() if here.get(n) != v]
    return f"; recorded with {', '.join(changed)}" if changed else ""
