"""A recording in the rerun viewer, and a recording against a new run of its session."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import rerun as rr

from verefine_viz.core.compare import first_difference
from verefine_viz.core.records import Iteration
from verefine_viz.recording.blueprint import make_blueprint
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.entities import APPLICATION, MAPS
from verefine_viz.recording.reader import Recorded, chunks_of, existing, final_path, read_recording, readable
from verefine_viz.recording.recorder import versions
from verefine_viz.recording.row import Row, row_of
from verefine_viz.recording.viewer_process import free_port, has_display, start_viewer
from verefine_viz.session.engine import Run

MakeRun = Callable[[Recorded], Run]


def open_viewer(path: Path, web: bool | None = None) -> subprocess.Popen[bytes]:
    """Opens a recording in the rerun viewer and returns its process; reachable from this machine only.

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
    arguments = [str(path)]
    if web if web is not None else not has_display():
        arguments += ["--web-viewer", "--web-viewer-port", str(free_port())]
    return start_viewer(arguments)


def completed(recorded: Recorded, folder: Path) -> Path:
    """A copy of an unfinished recording in ``folder``, with the iterations drawn that only the journal had."""
    target = folder / final_path(recorded.path).name
    with readable(recorded.path) as file:
        chunks = chunks_of(file)
    has_maps = any(chunk.entity_path.startswith(MAPS) for chunk in chunks)
    rec = rr.RecordingStream(APPLICATION, send_properties=False)
    rec.set_log_time_enabled(False)
    rec.save(target, default_blueprint=make_blueprint(recorded.layout, has_maps))
    rec.send_chunks(chunks)
    drawing = Drawing(recorded.layout)
    drawing.skip(recorded.rows[: recorded.n_drawn])
    missing = recorded.rows[recorded.n_drawn :]
    if missing:
        drawing.draw(rec, missing)
    rec.flush()
    rec.disconnect()
    return target


def verify(path: Path, make_run: MakeRun | None = None) -> str | None:
    """Runs the recorded session again and says where the new run first differs, bit by bit; None = nowhere.

    A recording whose end is missing is compared as far as it goes; that it ends early is said as well.

    Args:
        path: the recording.
        make_run: builds the run of a recording; None = from its session, with the real simulator, refiner and verifier.

    Raises:
        InputError: it is not a recording of this program, or its data are gone.
    """
    recorded = read_recording(path)
    run = (make_run or run_again)(recorded)
    for row in recorded.rows:
        if run.is_done:
            return f"iteration {row.index}: recorded, but the new run ended after {run.length}{_other(recorded)}"
        difference = compare(row, run.step())
        if difference:
            return f"iteration {row.index}: {difference}{_other(recorded)}"
    if not recorded.is_complete:
        return _ends_early(len(recorded.rows), run.n_iterations)
    return None


def _ends_early(n: int, n_planned: int) -> str:
    same = "nothing in it can be compared" if n == 0 else f"iterations 1 to {n} are the same"
    return f"the recording ends early, after {n} of {n_planned} iterations (it was stopped or cut off); {same}"


def run_again(recorded: Recorded) -> Run:
    """The run of a recording's session and frame, not yet stepped."""
    # The engine's parts are heavy, and opening a recording does not need them.
    from verefine_viz.session.toolbox import Toolbox

    toolbox = Toolbox(recorded.session)
    problem = toolbox.problem(recorded.frame).only([b.instance_id for b in recorded.layout.branches])
    return toolbox.run(problem)


def compare(row: Row, iteration: Iteration) -> str | None:
    """The first difference between a recorded and a new iteration, or None; errors and timings are left out."""
    return first_difference(row, row_of(iteration, row.errors))


def _other(recorded: Recorded) -> str:
    """What is installed in another version here, which may be the reason."""
    here = versions()
    changed = [f"{n} {v} (here {here.get(n)})" for n, v in recorded.versions.items() if here.get(n) != v]
    return f"; recorded with {', '.join(changed)}" if changed else ""
