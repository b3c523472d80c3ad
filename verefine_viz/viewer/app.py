"""The page: a queue of commands, one worker thread that carries them out, and the server that shows the result."""

from __future__ import annotations

import logging
import threading
import webbrowser
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, cast

from verefine_viz.core.errors import SettingsError, VerefineError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.methods.registry import ALL_METHOD_NAMES
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.session.compiling import COMPILING, told_of_compiling
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.gallery import Gallery
from verefine_viz.viewer.keeping import Keeping
from verefine_viz.viewer.layout import Layout, set_theme
from verefine_viz.viewer.lost import lost_style
from verefine_viz.viewer.markup import block, text
from verefine_viz.viewer.refusal import Unconfirmed, told
from verefine_viz.viewer.scene_view import SceneView
from verefine_viz.viewer.server import Server
from verefine_viz.viewer.side_commands import CompareRecording, OpenRecording
from verefine_viz.viewer.side_nodes import SideNodes
from verefine_viz.viewer.view import View
from verefine_viz.viewer.viewing import later, standing
from verefine_viz.viewer.workspace import Tools

_LOG = logging.getLogger(__name__)
FRAME_S = 1 / 25
"""Time between two pictures of an animation [s]."""
REFRESH_S = 0.12
"""Time between two pictures while a run is on [s]."""


class App:
    """The page of one session.

    Args:
        session: what to open.
        session_path: its file, if it has one.
        host: address to listen on.
        port: port to listen on; 0 = any free one.
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
        make_tools: Callable[[Session], Tools] | None = None,
        folder: Path | None = None,
        batch: Gallery | None = None,
        first: Sequence[c.Command] = (),
    ) -> None:
        self._session, self._path = session, session_path
        self._host, self._port = host, port
        self._make_tools = make_tools
        self._folder = folder if folder is not None else Path("sessions")
        self._batch = batch
        self._first = first
        self._queue: deque[c.Command] = deque()
        self._wake = threading.Condition()
        self._stopping = False
        self._idle = False
        self._is_shallow = False
        self._doing = ""
        """What is being done, as long as nothing of it can be shown."""
        self._compiled = False
        """Whether kernels were not there yet."""
        self._layout: Layout | None = None
        self._animation: Iterator[None] | None = None
        self._later: Iterator[None] | None = None
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._worker: threading.Thread | None = None

    def start(self) -> App:
        """Listens, and opens the session on the worker thread; the page says so meanwhile.

        Raises:
            UnavailableError: the port is taken or the host cannot be bound.
        """
        self.server = Server(self._host, self._port)
        set_theme(self.server.gui)
        self.server.gui.add_html(lost_style(self.server.get_port()))
        self._loading = self.server.gui.add_html(block(opening(LOADING)))
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
        with self._wake:
            if not self._wake.wait_for(lambda: self._idle and not self._queue, timeout_s):
                raise TimeoutError(f"still busy after {timeout_s} s")

    def send(self, command: c.Command) -> None:
        """Puts a command into the queue; returns at once. Callable from any thread."""
        with self._wake:
            if command.latest_wins and self._queue and type(self._queue[-1]) is type(command):
                self._queue[-1] = command
            else:
                self._queue.append(command)
            self._idle = False
            self._wake.notify_all()

    def stop(self) -> None:
        """Ends the worker after the command at hand and frees the port."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()
        if self._worker is not None:
            self._worker.join(timeout=20)
        if self._layout is not None and self._layout.batch is not None:
            self._layout.batch.stop()
        self.server.stop()

    # The worker thread

    def _work(self) -> None:
        with told_of_compiling(self._tell_of_compiling):
            self._open_and_serve()

    def _open_and_serve(self) -> None:
        try:
            self._open()
        except Exception as error:
            self._failure = error
            self._loading.content = block(f'<p class="bad">{text(error)}</p>')
            if not isinstance(error, VerefineError):
                _LOG.exception("the session could not be opened")
            return
        finally:
            self._ready.set()
        while (command := self._next()) is not STOP:
            try:
                self._carry_out(command)
            except Exception as error:  # The page must live on: what went wrong is shown.
                self._animation = self._later = None
                self.debugger.running.pause()
                self.debugger.comparing.pause()
                self.debugger.message, self.debugger.refused = str(error), True
                self.debugger.offer = (error.label, error.command) if isinstance(error, Unconfirmed) else None
                if not isinstance(error, VerefineError):
                    _LOG.exception("command %s failed", command)
                    self.debugger.message = told(error)
                self._show()

    def _open(self) -> None:
        keeping = Keeping(self.server, self._folder)
        make_tools, plausibility, overlap, demos = self._make_tools, None, None, ()
        if make_tools is None:
            self._tell("Loading the simulator, the renderer and the refiner.")
            make_tools, plausibility, overlap, demos = real_parts(self._tell)
        self.debugger = Debugger(
            self._session,
            self._path,
            make_tools,
            plausibility=plausibility,
            demos=demos,
            keep=keeping,
            sessions=lambda: tuple(str(p) for p in sorted(self._folder.glob("*.toml"))),
            batch=self._batch,
            tell=self._tell,
            overlap=overlap,
        ).carry_out(self._first)
        self._tell("Drawing the first picture.")
        self.debugger.view(deep=False)  # Where kernels are compiled for it, the page can still say so.
        if self._compiled:
            self._try_step()
        self._loading.remove()
        self.scene = SceneView(self.server, self.send)
        self.sides = SideNodes(self.server)
        self.layout = self._layout = Layout(self.server, self.send, self._batch)
        self.layout.on_link(self.send)
        self._shown_at = 0.0
        self._show()
        if self._batch is not None and self._batch.worst.can_be_opened:
            self.send(self._batch.opens(self._batch.worst))

    def _try_step(self) -> None:
        """Makes the first step and forgets it: else a person who makes it waits for the kernels that it needs."""
        self._tell("Trying a step.")
        run = self.debugger.workspace.run
        with suppress(Exception):  # What is wrong is told when it is made, or shown, in earnest.
            if not run.is_done:
                run.method.step(run.state)
            self.debugger.view()

    def _tell(self, doing: str) -> None:
        """Says on the page what is being done, before something that may take seconds."""
        self._doing = doing
        self._say(doing)

    def _tell_of_compiling(self) -> None:
        """Says why it takes longer than usual."""
        self._compiled = True
        self._say(f"{self._doing} {COMPILING}".lstrip())

    def _say(self, doing: str) -> None:
        if self._layout is None:
            self._loading.content = block(opening(doing))
        else:
            self._layout.run.tell(doing)
        self.server.flush()

    def _next(self) -> c.Command | object | None:
        """The next command; None = nothing waits, go on with what is under way; STOP = end."""
        with self._wake:
            running = self.debugger.is_busy
            if not self._queue and not running and not self._is_shallow and (self._animation or not self._later):
                if self._animation is None:
                    self._idle = True
                    self._wake.notify_all()
                self._wake.wait_for(lambda: self._queue or self._stopping, FRAME_S if self._animation else None)
            if self._stopping:
                return STOP
            return self._queue.popleft() if self._queue else None

    def _carry_out(self, command: c.Command | object | None) -> None:
        if isinstance(command, c.Command):
            self._animation = self._later = None
            before = self.debugger.workspace.run.cursor
            self.debugger.apply(command)
            with self._wake:
                waiting = bool(self._queue)
            if not (waiting and command.latest_wins):  # A newer one is there already: its picture will do.
                self._show()
                self._animate(command, before)
        elif self.debugger.is_busy:
            self.debugger.tick()
            if not self.debugger.is_busy or monotonic() - self._shown_at > REFRESH_S:
                self._show()
        elif self._is_shallow:
            self._show_deep()
        elif self._animation is not None:
            if next(self._animation, STOP) is STOP:
                self._animation = None
        elif self._later is not None and next(self._later, STOP) is STOP:
            self._later = None
            self._show_physics()

    def _animate(self, command: c.Command, before: int) -> None:
        view = self._view
        stepped = isinstance(command, c.Step) and view.cursor == before + 1
        if stepped and view.look.animate and view.is_current:
            self._animation = self.scene.animation(view)
        elif isinstance(command, c.PlayPath):
            self._animation = self.scene.path_animation(view)

    def _show(self) -> None:
        """Poses, numbers and words at once; what takes longer follows when nothing else waits."""
        self._view = self.debugger.view(deep=False)
        with self._wake:
            hand_is_ahead = any(isinstance(q, c.Seek) for q in self._queue)
        with self.server.atomic():
            self.scene.show(self._view)
            self.sides.show(self._view)
            self.layout.show(self._view, hand_is_ahead)
        self.server.flush()
        self._shown_at = monotonic()
        self._is_shallow, self._doing = True, ""

    def _show_deep(self) -> None:
        self._is_shallow = False
        view = self.debugger.view()
        with self.server.atomic():
            self.scene.show_deep(view)
            self.layout.show_deep(view)
        self.server.flush()
        if not view.physics.complete or self._judged_alone(view):
            self._later = later(view, self.debugger.workspace.branch.judge)

    def _judged_alone(self, view: View) -> bool:
        """Whether the plausibility of the poses in focus is still to be worked out."""
        missing = any(name not in view.plausible for name in standing(view.poses))
        return missing and view.target.observation.support is not None

    def _show_physics(self) -> None:
        """What was worked out about the whole scene."""
        view = self.debugger.view()
        with self.server.atomic():
            self.scene.show_physics(view)
            self.layout.show_physics(view)
        self.server.flush()


STOP = object()
LOADING = "Loading the program."


def opening(doing: str) -> str:
    """What the page says until the session is open."""
    return f'<div style="padding:0 12px"><h3>Opening the session</h3><p>{text(doing)}</p></div>'


def real_parts(
    tell: Callable[[str], None],
) -> tuple[Callable[[Session], Tools], Callable[..., Any], Callable[..., Any], tuple[str, ...]]:
    """The toolbox, the checks of plausibility and overlap, and the built-in scenes; imported late: they are heavy."""
    from verefine_viz.physics.overlap import overlap
    from verefine_viz.physics.plausibility import plausibility
    from verefine_viz.physics.proximity import Surfaces
    from verefine_viz.scenes.demo import demo_names
    from verefine_viz.session.toolbox import Toolbox

    surfaces = Surfaces()
    make_tools = cast(Callable[[Session], Tools], partial(Toolbox, tell=tell))
    checks = partial(plausibility, surface_of=surfaces), partial(overlap, surface_of=surfaces)
    return make_tools, *checks, tuple(demo_names())


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
    return open_scene(session.scene, session.hypotheses).notes


def _of_recordings(a: Path | None, b: Path | None) -> tuple[c.Command, ...]:
    """What opens them."""
    return (*([OpenRecording(str(a))] if a else []), *([CompareRecording(str(b))] if b else []))


def serve(
    session: Session,
    *,
    session_path: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    open_browser: bool = True,
    recordings: tuple[Path | None, Path | None] = (None, None),
    batch: Gallery | None = None,
) -> None:
    """Serves the page until Ctrl-C; prints its address, one line.

    ``recordings`` are A, the open run, and B beside it; ``batch`` is what is listed in the Batch tab.

    Raises:
        VerefineError: the port is taken, the host cannot be bound, or the session cannot be opened.
    """
    notes = check_names(session)
    app = App(session, session_path, host, port, batch=batch, first=_of_recordings(*recordings)).start()
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
