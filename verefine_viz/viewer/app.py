"""The page of a session: opens it on a worker thread, which then carries out what is asked for, and serves it until
Ctrl-C, SIGTERM or SIGHUP.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from verefine_viz.batch.watch import POLL_S, Watch
from verefine_viz.core.errors import Cancelled, SettingsError, VerefineError, unknown
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.methods.registry import METHODS
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.run.edits import edits_elsewhere
from verefine_viz.run.kernel_compilation import compiling_reported
from verefine_viz.run.session_file import changed
from verefine_viz.viewer.busy_status import BusyStatus
from verefine_viz.viewer.commands import Command, CompareRecording, OpenRecording, RefreshGallery
from verefine_viz.viewer.debugger import Debugger, RequestQueue
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.panels.page_layout import set_theme
from verefine_viz.viewer.session_page import Page, Worker
from verefine_viz.viewer.state.batch_gallery import Gallery
from verefine_viz.viewer.state.live_gallery import LiveGallery
from verefine_viz.viewer.state.workspace import HULLS
from verefine_viz.viewer.web.server import Server
from verefine_viz.viewer.web.viser_internals import lost_style

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

_LOG = logging.getLogger(__name__)
MOST_TRIED = 3
"""Frames of a watched folder that are tried one after another until one can be opened."""


class App:
    """The page of one session.

    Args:
        session: what to open.
        session_path: its file, if it has one.
        host: address to listen on.
        port: port to listen on; 0 = any free one.
        allowed_origins: other pages that may use it, see :class:`verefine_viz.viewer.web.admission.Admission`.
        make_tools: builds the algorithm's parts from a session; None = the real ones.
        batch: whose answers the gallery shows, with which the page then opens; None = no batch.
        watch: a folder whose frames are listed and solved instead, once one is there; then ``session`` is not used.
        folder: where sessions and exports are written; None = ``sessions`` in the working directory.
        first: what is done before the page is shown; what cannot be done keeps the session from opening.
    """

    def __init__(
        self,
        session: Session,
        session_path: Path | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        allowed_origins: Sequence[str] = (),
        make_tools: Callable[[Session], Toolbox] | None = None,
        folder: Path | None = None,
        batch: Gallery | None = None,
        first: Sequence[Command] = (),
        watch: Watch | None = None,
    ) -> None:
        self._watch = watch
        self._watching: threading.Thread | None = None
        self._session, self._path = session, session_path
        self._host, self._port, self._allowed_origins = host, port, allowed_origins
        self._make_tools = make_tools
        self._folder = folder if folder is not None else Path("sessions")
        self._batch = batch
        self._first = first
        self._requests = RequestQueue(lambda: self._busy.cancelling())
        self._progress = ProgressToken(lambda *doing: self._busy.tell(*doing), self._requests.is_wanted)
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._worker: threading.Thread | None = None

    def start(self) -> App:
        """Listens, and opens the session on the worker thread; the page says so meanwhile.

        Raises:
            SettingsError: an allowed origin is none.
            UnavailableError: the port is taken, the host cannot be bound, or other sites' pages would be answered.
        """
        self.server = Server(self._host, self._port, self._allowed_origins)
        set_theme(self.server.gui)
        self.server.gui.add_html(lost_style(self.server.get_port()))
        self._busy = BusyStatus(self.server, self._requests)
        self._worker = threading.Thread(target=self._work, name="verefine-worker", daemon=True)
        self._worker.start()
        return self

    @property
    def url(self) -> str:
        """What to type into a browser."""
        return self.server.url

    def wait_until_ready(self, timeout_s: float | None = None) -> None:
        """Waits until the session is open.

        Raises:
            VerefineError: it cannot be opened.
        """
        if not self._ready.wait(timeout_s):
            raise TimeoutError(f"the session was not open after {timeout_s} s")
        if self._failure is not None:
            raise self._failure

    def wait_until_idle(self, timeout_s: float = 30.0) -> None:
        """Waits until every command so far is carried out and shown, animations included."""
        self.wait_until_ready(timeout_s)
        self._requests.wait_until_idle(timeout_s)

    def send(self, command: Command) -> None:
        """Puts a command into the queue; returns at once. Callable from any thread."""
        self._requests.send(command)

    def stop(self) -> None:
        """Ends the worker, the command at hand too where it can be cancelled, and frees the port."""
        self._requests.stop()
        if self._watch is not None:
            self._watch.stop()
        if self._worker is not None:
            self._worker.join(timeout=20)
        if self._watching is not None:
            self._watching.join(timeout=20)
        if self._watch is not None:
            self._watch.close()
        if hasattr(self, "page") and self.page.layout.gallery is not None:
            self.page.layout.gallery.stop()
        self.server.stop()

    # The worker thread

    def _work(self) -> None:
        with compiling_reported(self._busy.compiling):
            try:
                worker = self._open()
            except (Exception, Cancelled) as error:
                self._failure = error
                self._busy.fail(str(error))
                if not isinstance(error, VerefineError | Cancelled):
                    _LOG.exception("the session could not be opened")
                return
            finally:
                self._ready.set()
            worker.work()

    def _open(self) -> Worker:
        debugger = self._opened() if self._watch is None else self._opened_of(self._watch)
        self.debugger = debugger.carry_out(self._first)
        self._busy.tell("Drawing the first picture.")
        self.debugger.view(deep=False)  # Where kernels are compiled for it, the page can still say so.
        if self._busy.has_compiled:
            self._try_step()
        self._busy.clear()
        self.page = Page(self.server, self.debugger, self._requests, self._batch)
        self._busy.move_to(self.page.layout.run)
        worker = Worker(self.page, self.debugger, self._requests, self._busy)
        worker.show()
        if self._watch is not None:
            work = partial(self._watch.work, lambda: self.send(RefreshGallery()))
            self._watching = threading.Thread(target=work, name="verefine-watch", daemon=True)
            self._watching.start()
        return worker

    def _opened(self, frame: str | None = None) -> Debugger:
        try:
            with self._requests.opening():
                return self._new_debugger(frame)
        except Cancelled:
            if not self._requests.wants_hulls:
                raise
            self._session = changed(self._session, HULLS)
            return self._new_debugger(frame)

    def _opened_of(self, watch: Watch) -> Debugger:
        """One of the frames that are there, or the first that comes; one that cannot be read is passed over."""
        fault = ""
        while True:
            watch.look()
            self._batch = LiveGallery(watch) if any(index.rows for index in watch.latest[0]) else None
            entries = self._batch.sorted_by("error") if self._batch is not None else ()
            for entry in [entry for entry in entries if entry.can_be_opened][:MOST_TRIED]:
                assert self._batch is not None
                self._session = self._batch.session(entry.run)
                try:
                    return self._opened(entry.row.frame)
                except VerefineError as error:
                    fault = str(error)
            self._busy.tell(f"Waiting for a frame in {watch.folder}. {watch.latest[1] or fault}".rstrip())
            if not self._requests.is_wanted():
                raise Cancelled
            time.sleep(POLL_S)

    def _new_debugger(self, frame: str | None = None) -> Debugger:
        """With the real simulator, renderer and refiners, imported late since they are heavy, or those given."""
        make_tools, checks = self._make_tools, {}
        if make_tools is None:
            self._busy.tell("Loading the simulator, the renderer and the refiner.")
            from verefine_viz.physics.plausibility import plausibility
            from verefine_viz.physics.proximity import Surfaces, overlap
            from verefine_viz.run.toolbox import Toolbox
            from verefine_viz.scenes.demo import demo_names

            surfaces = Surfaces()
            make_tools = partial(Toolbox, progress=self._progress)
            checks: dict[str, Any] = {
                "plausibility": partial(plausibility, surface_of=surfaces, progress=self._progress),
                "overlap": partial(overlap, surface_of=surfaces),
                "demos": tuple(demo_names()),
            }
        return Debugger(
            self._session,
            self._path,
            make_tools,
            write=Exporter(self.server, self._folder, self._progress),
            sessions=lambda: tuple(str(p) for p in sorted(self._folder.glob("*.toml"))),
            batch=self._batch,
            progress=self._progress,
            frame=frame,
            **checks,
        )

    def _try_step(self) -> None:
        """Makes the first step and forgets it: else the user who makes it waits for the kernels that it needs."""
        self._busy.tell("Trying a step.")
        run = self.debugger.workspace.run
        with suppress(Exception):  # What is wrong is said when it is made, or shown, in earnest.
            if not run.is_done:
                run.method.step(run.state)
            self.debugger.view()


# The page as a program


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
    watch: Watch | None = None,
) -> None:
    """Serves the page until Ctrl-C, SIGTERM or SIGHUP; prints its address, one line. Call it in the main thread.

    ``recordings`` are A, the open run, and B beside it; ``batch`` is what the gallery shows, or the frames of
    ``watch``, whose sessions are then opened.

    Raises:
        VerefineError: the port is taken, the host cannot be bound, or the session cannot be opened.
    """
    notes = check_names(session) if watch is None else ()
    open_a, compare_b = recordings
    first = [
        *([OpenRecording(str(open_a))] if open_a else []),
        *([CompareRecording(str(compare_b))] if compare_b else []),
    ]
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has it ignored.
            signal.signal(number, signal.default_int_handler)
    app = App(session, session_path, host, port, allowed_origins, batch=batch, first=first, watch=watch).start()
    try:
        print(f"verefine-viz: {app.url}  (Ctrl-C ends it)", flush=True)
        for note in notes:
            print(f"note: {note}", flush=True)
        if watch is not None:
            print(f"watching {watch.folder}; results in {watch.out}", flush=True)
        app.wait_until_ready()
        if open_browser:
            webbrowser.open(app.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        app.stop()


def check_method(session: Session) -> None:
    """That method and refiner exist.

    Raises:
        SettingsError: one of them does not.
    """
    if session.method.name not in METHODS:
        raise SettingsError(unknown("method", session.method.name, tuple(METHODS)))
    if session.method.refiner not in REFINERS:
        raise SettingsError(unknown("refiner", session.method.refiner, REFINERS))


def check_names(session: Session) -> tuple[str, ...]:
    """That scene, method and refiner exist, before a browser is sent to a page that cannot open; notes on the choice of
    frames.

    Raises:
        VerefineError: one of them does not.
    """
    from verefine_viz.scenes.source import open_scene

    check_method(session)
    scene = open_scene(session.scene, session.hypotheses)
    return (*scene.notes, *edits_elsewhere(session.edits, scene.frames))
