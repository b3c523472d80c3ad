"""The page of a session: the server that shows it, and the worker thread that carries out what is asked for."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, cast

from verefine_viz.core.errors import Cancelled, VerefineError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.refiners.registry import raised_by_refiner
from verefine_viz.session.kernel_compilation import compiling_reported
from verefine_viz.viewer.busy_status import BusyStatus
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.export import Exporter
from verefine_viz.viewer.page import Page
from verefine_viz.viewer.panels.layout import set_theme
from verefine_viz.viewer.state.branch import Tools
from verefine_viz.viewer.state.gallery import Gallery
from verefine_viz.viewer.state.state import Unconfirmed
from verefine_viz.viewer.web.server import Server
from verefine_viz.viewer.web.viser_internals import lost_style
from verefine_viz.viewer.worker import STOP, Cancellation, RequestQueue

# What the page needs of simulator, renderer and refiners; imported late, since it is heavy.


def real_parts(
    progress: ProgressToken,
) -> tuple[Callable[[Session], Tools], Callable[..., Any], Callable[..., Any], tuple[str, ...]]:
    """The toolbox, the checks of plausibility and overlap, and the built-in scenes."""
    from verefine_viz.physics.plausibility import plausibility
    from verefine_viz.physics.proximity import Surfaces, overlap
    from verefine_viz.scenes.demo import demo_names
    from verefine_viz.session.toolbox import Toolbox

    surfaces = Surfaces()
    make_tools = cast(Callable[[Session], Tools], partial(Toolbox, progress=progress))
    checks = partial(plausibility, surface_of=surfaces, progress=progress), partial(overlap, surface_of=surfaces)
    return make_tools, *checks, tuple(demo_names())


_LOG = logging.getLogger(__name__)
REFRESH_S = 0.12
"""Time between two pictures while a run is on [s]."""
CANCELLED = "Cancelled: everything is as it was before."


class App:
    """The page of one session.

    Args:
        session: what to open.
        session_path: its file, if it has one.
        host: address to listen on.
        port: port to listen on; 0 = any free one.
        allowed_origins: other pages that may use it, see :class:`verefine_viz.viewer.web.admission.Admission`.
        make_tools: builds the algorithm's parts from a session; None = the real ones.
        batch: whose answers are listed, and the worst one opened where it went wrong; None = no batch.
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
        make_tools: Callable[[Session], Tools] | None = None,
        folder: Path | None = None,
        batch: Gallery | None = None,
        first: Sequence[Command] = (),
    ) -> None:
        self._session, self._path = session, session_path
        self._host, self._port, self._allowed_origins = host, port, allowed_origins
        self._make_tools = make_tools
        self._folder = folder if folder is not None else Path("sessions")
        self._batch = batch
        self._first = first
        self._requests = RequestQueue(lambda: self._telling.cancelling())
        self._meanwhile = Cancellation(self._requests, self._look_around)
        self._progress = ProgressToken(lambda *told: self._telling.tell(*told), self._meanwhile.is_wanted)
        self._page: Page | None = None
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
        self._telling = BusyStatus(self.server, self._requests)
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
        if self._worker is not None:
            self._worker.join(timeout=20)
        if self._page is not None and self._page.layout.batch is not None:
            self._page.layout.batch.stop()
        self.server.stop()

    # The worker thread

    def _work(self) -> None:
        with compiling_reported(self._telling.compiling):
            self._open_and_serve()

    def _open_and_serve(self) -> None:
        try:
            self._open()
        except (Exception, Cancelled) as error:
            self._failure = error
            self._telling.fail(str(error))
            if not isinstance(error, VerefineError | Cancelled):
                _LOG.exception("the session could not be opened")
            return
        finally:
            self._ready.set()
        with suppress(Cancelled):  # The program is being stopped.
            while (command := self._next()) is not STOP:
                self._try_to_carry_out(command)

    def _try_to_carry_out(self, command: Command | object | None) -> None:
        only_shows = not isinstance(command, Command) and not self.debugger.is_busy
        try:
            self._carry_out(command)
        except Cancelled:
            self._give_up(CANCELLED)
        except Exception as error:  # The page must live on: what went wrong is shown.
            offer = (error.label, error.command) if isinstance(error, Unconfirmed) else None
            said = str(error)
            if not isinstance(error, VerefineError):
                _LOG.exception("command %s failed", command)
                said = unforeseen(error)
            self._give_up(said, refused=True, offer=offer, with_maps=not only_shows)

    def _give_up(
        self,
        message: str,
        refused: bool = False,
        offer: tuple[str, Command] | None = None,
        with_maps: bool = True,
    ) -> None:
        """Shows what was open before a command that was not carried out, and says why it was not.

        Without score maps where they, or what comes with them, are what could not be shown: or it would go on for ever.
        """
        self.page.leave_off()
        self.debugger.pause()
        self.debugger.pause_b()
        self.debugger.message, self.debugger.refused, self.debugger.offer = message, refused, offer
        self.page.show(with_picture=True, with_maps=with_maps)
        self._telling.shown()

    def _open(self) -> None:
        keeping = Exporter(self.server, self._folder, self._progress)
        make_tools, plausibility, overlap, demos = self._make_tools, None, None, ()
        if make_tools is None:
            self._telling.tell("Loading the simulator, the renderer and the refiner.")
            make_tools, plausibility, overlap, demos = real_parts(self._progress)
        self.debugger = Debugger(
            self._session,
            self._path,
            make_tools,
            plausibility=plausibility,
            demos=demos,
            keep=keeping,
            sessions=lambda: tuple(str(p) for p in sorted(self._folder.glob("*.toml"))),
            batch=self._batch,
            progress=self._progress,
            overlap=overlap,
        ).carry_out(self._first)
        self._telling.tell("Drawing the first picture.")
        self.debugger.view(deep=False)  # Where kernels are compiled for it, the page can still say so.
        if self._telling.has_compiled:
            self._try_step()
        self._telling.clear()
        self.page = self._page = Page(self.server, self.debugger, self._requests, self._batch)
        self._telling.move_to(self.page.layout.run)
        self._show()
        if self._batch is not None and self._batch.worst.can_be_opened:
            self.send(self._batch.opens(self._batch.worst))

    def _try_step(self) -> None:
        """Makes the first step and forgets it: else a person who makes it waits for the kernels that it needs."""
        self._telling.tell("Trying a step.")
        run = self.debugger.workspace.run
        with suppress(Exception):  # What is wrong is said when it is made, or shown, in earnest.
            if not run.is_done:
                run.method.step(run.state)
            self.debugger.view()

    def _next(self) -> Command | object | None:
        """The next command; None = nothing waits, go on with what is under way; STOP = end."""
        return self._requests.take(0 if self.debugger.is_busy else self.page.wait_s)

    def _carry_out(self, command: Command | object | None) -> None:
        if isinstance(command, Command):
            self.page.leave_off()
            before = self.debugger.workspace.run.cursor
            with self._meanwhile.cancellable(command):
                self.debugger.apply(command)
            if not (command.latest_wins and self._requests.holds()):  # A newer one is there: its picture will do.
                self._show()
                self.page.animate(command, before)
        elif self.debugger.is_busy:
            with self._meanwhile.cancellable(command):
                self.debugger.tick()
            if not self.debugger.is_busy or self.page.age_s > REFRESH_S:
                self._show()
        else:
            with suppress(Cancelled), self._requests.aside():  # Whatever comes next shows all of it again.
                self.page.go_on()

    def _look_around(self, command: Command) -> None:
        """Carries out what does not disturb what is being done, and goes on saying what that is."""
        try:
            self.debugger.apply(command)
        except VerefineError as error:
            self.debugger.message, self.debugger.refused = str(error), True
        self.page.show(with_picture=True)
        self.page.go_on()
        self.page.leave_off()
        self._telling.repeat()

    def _show(self) -> None:
        self.page.show(with_picture=self.debugger.is_busy)
        self._telling.shown()


def unforeseen(error: Exception) -> str:
    """What the page says of an error that was not foreseen: a bug, unless a refiner of another program raised it."""
    said = raised_by_refiner(error)
    if not said:
        return f"{type(error).__name__}: {error} (a bug: please report it with the log)"
    return f"{said[0].upper()}{said[1:]}. The run stands before it: mend the refiner, then start the program again."
