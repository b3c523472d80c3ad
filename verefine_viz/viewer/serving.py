"""The page as a program: checks what was asked for, opens the page, and serves it until Ctrl-C, SIGTERM or SIGHUP."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.methods.registry import ALL_METHOD_NAMES
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.session.edits import edits_elsewhere
from verefine_viz.viewer.app import App
from verefine_viz.viewer.commands import Command, CompareRecording, OpenRecording
from verefine_viz.viewer.state.batch_gallery import Gallery


def serve(
    session: Session,
    *,
    session_path: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    allowed_origins: Sequence[str] = (),
    open_browser: bool = True,
    recordings: tuple[Path | None, Path | None] = (None, None),
    batch: Gallery | None = None,
) -> None:
    """Serves the page until Ctrl-C, SIGTERM or SIGHUP; prints its address, one line. Call it in the main thread.

    ``recordings`` are A, the open run, and B beside it; ``batch`` is what is listed in the Batch tab.

    Raises:
        VerefineError: the port is taken, the host cannot be bound, or the session cannot be opened.
    """
    notes = check_names(session)
    first = _of_recordings(*recordings)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has it ignored.
            signal.signal(number, signal.default_int_handler)
    app = App(session, session_path, host, port, allowed_origins, batch=batch, first=first).start()
    try:
        print(f"verefine-viz: {app.url}  (Ctrl-C ends it)", flush=True)
        for note in notes:
            print(f"note: {note}", flush=True)
        app.wait_until_ready()
        if open_browser:
            webbrowser.open(app.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        app.stop()


def check_names(session: Session) -> tuple[str, ...]:
    """That scene, method and refiner exist, before anyone is sent to a page that cannot open; what a person should know
    about the choice of frames.

    Raises:
        VerefineError: one of them does not.
    """
    from verefine_viz.scenes.source import open_scene

    if session.method.name not in ALL_METHOD_NAMES:
        raise SettingsError(unknown("method", session.method.name, ALL_METHOD_NAMES))
    if session.method.refiner not in REFINERS:
        raise SettingsError(unknown("refiner", session.method.refiner, REFINERS))
    scene = open_scene(session.scene, session.hypotheses)
    return (*scene.notes, *edits_elsewhere(session.edits, scene.frames))


def _of_recordings(a: Path | None, b: Path | None) -> tuple[Command, ...]:
    """What opens them."""
    return (*([OpenRecording(str(a))] if a else []), *([CompareRecording(str(b))] if b else []))
