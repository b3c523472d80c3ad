"""The page as a program: a server, a worker that computes, and what they show, until it is stopped."""

from __future__ import annotations

import signal
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.errors import Cancelled, one_line
from verefine_viz.core.files import first_line
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.page import proxy
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.export import Exporter
from verefine_viz.page.frame_pictures import FrameOfSession, FramePainter
from verefine_viz.page.gallery import Gallery, open_gallery
from verefine_viz.page.live_gallery import LiveGallery
from verefine_viz.page.messages import EditedMessage, PickedMessage
from verefine_viz.page.model_pictures import ModelOfFolder, ModelPainter
from verefine_viz.page.protocol import AnyVerb, pose_matrix
from verefine_viz.page.scene3d import viser_page
from verefine_viz.page.scene3d.scene import Scene3D
from verefine_viz.page.scene3d.viser_server import Viser3DServer
from verefine_viz.page.server import PageServer
from verefine_viz.page.thumbnails import AnswerPicture, Painter, Thumbnails
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.frame import png
from verefine_viz.page.web_files import demo_picture
from verefine_viz.page.worker import Job, Jobs, Worker
from verefine_viz.page.workspace import HULLS, Checks, Workspace, no_records
from verefine_viz.run.edits import edits_elsewhere
from verefine_viz.run.session_file import changed
from verefine_viz.run.session_parts import check_names

if TYPE_CHECKING:
    from verefine_viz.batch.watch import Watch
    from verefine_viz.run.solids_ahead import SolidsAhead
    from verefine_viz.run.toolbox import Toolbox

POLL_S = 1.0
"""Time between two looks into a watched folder that has no frame yet [s]."""
MOST_TRIED = 3
"""Most frames of a watched folder that are tried until one can be opened."""


class App:
    """The page of one session.

    Args:
        session: what to open.
        session_path: its file, if it has one.
        host: address to listen on.
        port: port to listen on; 0 = any free one.
        allowed_origins: other addresses of the page, see :class:`verefine_viz.page.admission.Admission`.
        make_tools: builds the algorithm's parts from a session; None = the real ones.
        gallery: the answers of a batch, with which the page opens; None = no batch.
        folder: where sessions and exports are written; None = ``sessions`` in the working directory.
        first: verbs that are carried out before the page is shown.
        watch: a folder whose frames are listed and solved instead, once one is there; then ``session`` is not used.
        recording: a recorded run that is opened in place of ``session``.
    """

    def __init__(
        self,
        session: Session,
        session_path: Path | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
        allowed_origins: Sequence[str] = (),
        make_tools: Callable[[Session], Toolbox] | None = None,
        gallery: Gallery | None = None,
        folder: Path | None = None,
        first: Sequence[AnyVerb] = (),
        watch: Watch | None = None,
        recording: Path | None = None,
    ) -> None:
        self._session, self._path, self._watch, self._recording = session, session_path, watch, recording
        self._make_tools, self._gallery, self._first = make_tools, gallery, first
        self._folder = folder if folder is not None else Path("sessions")
        self.blobs, self.jobs = Blobs(), Jobs()
        self._thumbnails: Thumbnails[AnswerPicture] | None = None
        self._frame_pictures = Thumbnails(FramePainter())
        self._model_pictures = Thumbnails(ModelPainter())
        self._watching: threading.Thread | None = None
        self._ahead: SolidsAhead | None = None
        self.server = PageServer(
            host,
            port,
            allowed_origins,
            self._receive,
            self.blobs,
            self._thumbnail,
            self._frame_picture,
            self._model_picture,
            partial(self._thumbnail, is_film=True),
            lambda name: self._write.file(name),
            self._closed,
        )
        self.worker = Worker(self.jobs, self.server.post, self._open)

    def start(self) -> App:
        """Listen, and open the session on the worker thread, which the page shows meanwhile."""
        self.viser = Viser3DServer()
        self.scene = Scene3D(self.viser, self._from_scene)
        self._write = Exporter(self._folder, self.worker.progress, self.scene.page)
        self.server.start(proxy.routes(*viser_page.served(), self.viser.address))
        self.worker.thread.start()
        return self

    @property
    def url(self) -> str:
        """The address to type into a browser."""
        return self.server.url

    @property
    def debugger(self) -> Debugger:
        """The page's state, once it exists; it belongs to the worker's thread."""
        assert isinstance(self.worker.handler, Debugger)
        return self.worker.handler

    def wait_until_ready(self, timeout_s: float | None = None) -> None:
        """Wait until the session is open.

        Raises:
            VerefineError: it cannot be opened.
            TimeoutError: it takes longer.
        """
        if not self.worker.ready.wait(timeout_s):
            raise TimeoutError(f"the session was not open after {timeout_s} s")
        if self.worker.failure is not None:
            raise self.worker.failure

    def wait_until_idle(self, timeout_s: float = 30.0) -> None:
        """Wait until all verbs so far are carried out."""
        self.wait_until_ready(timeout_s)
        self.jobs.wait_until_idle(timeout_s)

    def send(self, verb: AnyVerb) -> None:
        """Ask for something as a window does. Callable from any thread."""
        self.jobs.put(Job(0, verb))

    def stop(self) -> None:
        """End the worker, cancelling its job if possible, and free the port."""
        self.jobs.stop()
        if self._ahead is not None:
            self._ahead.stop()
        if self._watch is not None:
            self._watch.stop()
        for thread in (self.worker.thread, self._watching):
            if thread is not None and thread.is_alive():
                thread.join(timeout=20)
        if self._watch is not None:
            self._watch.close()
        if self.worker.ready.is_set() and self.worker.failure is None:
            self.debugger.end_fix()
            self.debugger.space.close()
        self._frame_pictures.stop()
        self._model_pictures.stop()
        if self._thumbnails is not None:
            self._thumbnails.stop()
        self.server.stop()
        self.viser.stop()
        self._write.close()

    def _from_scene(self, what: str, *given: Any) -> None:
        """Tell the window that the 3D view follows what was done in it. Called on viser's threads."""
        if not self.worker.ready.is_set() or self.worker.failure is not None:
            return
        window = self.debugger.look_window
        if what == "edited":
            obj, T = given
            self.server.post(EditedMessage(obj, T), window)
        else:
            u, v = given
            self.server.post(PickedMessage(u, v), window)

    def _solid_is_other(self, model: ObjectModel) -> None:
        """Have the frames begin again that show a model whose solid is not as asked for. Called on any thread."""
        self.jobs.put(Job(0, lambda: self.debugger.begin_again(model)))

    def _draw(self, debugger: Debugger) -> None:
        """Draw the view of the window used last."""
        look, space = debugger.look, debugger.space
        if look is None or look.branch not in space.branches:
            return
        grasp = None
        if look.grasp is not None and look.obj is not None:
            branch = space.branch(look.branch)
            problem, settings = branch.run.problem, branch.settings.grasp
            grasp = space.grasps.known(problem, settings, look.obj, pose_matrix(look.grasp.T))
        self.scene.show(space, look, grasp)

    def _receive(self, window: int, verb: AnyVerb | None) -> None:
        self.jobs.put(Job(window, verb))

    def _closed(self, window: int) -> None:
        self.jobs.put(Job(window, lambda: self.debugger.window_closed(window)))

    def _thumbnail(self, number: int, is_film: bool = False) -> Future[bytes] | None:
        """Begin to make the picture of an answer, or its film; None = there is no such answer."""
        gallery = self.debugger.gallery
        if self._thumbnails is None or gallery is None or number >= len(gallery.entries):
            return None
        return self._thumbnails.ask(AnswerPicture(gallery.entries[number], is_film))

    def _frame_picture(self, number: int) -> Future[bytes] | None:
        """Begin to make the picture of a frame of the session; None = there is no such frame."""
        if not isinstance(self.worker.handler, Debugger):
            return None
        space = self.debugger.space
        session, frames = space.tools.session, space.frames
        one = FrameOfSession(session.scene, frames[number], session) if number < len(frames) else None
        return one and self._frame_pictures.ask(one)

    def _model_picture(self, number: int) -> Future[bytes] | None:
        """Begin to make the picture of a model; None = there is no such model."""
        if not isinstance(self.worker.handler, Debugger) or not self.worker.handler.space.is_labelling:
            return None
        space = self.debugger.space
        known = number in space.desk.models.ids
        return self._model_pictures.ask(ModelOfFolder(space.tools.session.scene, number)) if known else None

    def _open(self, progress: ProgressToken) -> Debugger:
        """Open the session with the real simulator, renderer and refiners, imported late as they are heavy."""
        make_tools, checks, demos = self._make_tools, Checks(), ()
        progress = replace(progress, seen=self._show_photo)
        if make_tools is None:
            progress.checkpoint("Loading the simulator, the renderer and the refiner.")
            from verefine_viz.physics.plausibility import plausibility
            from verefine_viz.physics.proximity import Surfaces, overlap
            from verefine_viz.run.solids_ahead import SolidsAhead
            from verefine_viz.run.toolbox import Toolbox
            from verefine_viz.scenes.demo import demo_names

            self._ahead = SolidsAhead(self._solid_is_other)

            surfaces = Surfaces()
            make_tools = partial(Toolbox, progress=progress)
            checks = Checks(
                partial(plausibility, surface_of=surfaces, progress=progress), partial(overlap, surface_of=surfaces)
            )
            demos = tuple(demo_names())
        if self._watch is not None:
            space = self._open_watched(self._watch, make_tools, checks, progress)
        else:
            gallery, recording, records = self._gallery, self._recording, no_records
            if gallery is None and recording is None:
                self._show_demo(self._session)
            if gallery is not None:
                recording, records = gallery.loose_record(gallery.worst), gallery.records(gallery.worst.run)
            given = {"records": records, "recording": recording}
            space = self._open_space(self._session, self._path, make_tools, checks, progress, **given)
        debugger = Debugger(
            space,
            self.server.post,
            self.blobs,
            self._gallery,
            demos,
            lambda: tuple(sorted(self._folder.glob("*.toml"))),
            self._write,
            progress,
        )
        debugger.on_look = partial(self._draw, debugger)
        self._thumbnails = Thumbnails(Painter(lambda: open_gallery(debugger.gallery)).draw)
        if self._watch is not None:
            changed = partial(self.jobs.put, Job(0, debugger.refresh_gallery))
            self._watching = threading.Thread(
                target=self._watch.work, args=(changed,), name="verefine-watch", daemon=True
            )
            self._watching.start()
        return debugger.carry_out(self._first)

    def _show_demo(self, session: Session) -> None:
        """Show the stored picture of a built-in scene at once: before its photo can be rendered its objects must fall
        into place.
        """
        file = demo_picture(session.scene.demo)
        if session.scene.source == "demo" and file.is_file():
            self.worker.picture = self.blobs.put(file.read_bytes(), "image/webp")

    def _show_photo(self, rgb: NDArray[np.uint8] | None) -> None:
        """Show the photo of the first frame while its models are prepared, and kernels compiled."""
        if rgb is not None and not self.worker.ready.is_set():
            self.worker.picture = self.blobs.put(png(rgb), "image/png")

    def _open_space(
        self, session: Session, path: Path | None, make_tools: Callable[[Session], Toolbox], *given: Any, **named: Any
    ) -> Workspace:
        """Open a workspace; begin again with hulls once these are asked for."""
        opened = partial(Workspace, session, path, ahead=self._ahead, **named)
        try:
            with self.jobs.offering_hulls():
                return opened(make_tools, *given)
        except Cancelled:
            if not self.jobs.wants_hulls:
                raise
        space = opened(lambda one: make_tools(changed(one, HULLS)), *given)
        space.make_tools = make_tools
        return space

    def _open_watched(
        self, watch: Watch, make_tools: Callable[[Session], Toolbox], checks: Checks, progress: ProgressToken
    ) -> Workspace:
        """Open one of the frames that are there, or the first that comes; one that cannot be read is passed over."""
        fault = ""
        while True:
            watch.look()
            gallery = LiveGallery(watch) if any(index.rows for index in watch.latest[0]) else None
            entries = gallery.sorted_by("error") if gallery is not None else ()
            for entry in [one for one in entries if one.can_be_opened][:MOST_TRIED]:
                assert gallery is not None
                session, records = gallery.session(entry.run), gallery.records(entry.run)
                try:
                    space = self._open_space(session, None, make_tools, checks, progress, entry.row.frame, records)
                except Exception as error:
                    fault = first_line(error)
                else:
                    self._gallery = gallery
                    return space
            progress.checkpoint(f"Waiting for a frame in {watch.folder}. {watch.latest[1] or fault}".rstrip())
            time.sleep(POLL_S)


def serve(
    session: Session,
    *,
    session_path: Path | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    allowed_origins: Sequence[str] = (),
    open_browser: bool = True,
    gallery: Gallery | None = None,
    first: Sequence[AnyVerb] = (),
    watch: Watch | None = None,
    recording: Path | None = None,
) -> None:
    """Serve the page until Ctrl-C, SIGTERM or SIGHUP; print its address, one line. Call it in the main thread.

    See :class:`App` for what can be opened.

    Raises:
        VerefineError: the address cannot be bound, or the session cannot be opened.
    """
    notes = check(session) if watch is None else ()
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:  # Ignored under nohup.
            signal.signal(number, signal.default_int_handler)
    shown = {"gallery": gallery, "first": first, "watch": watch, "recording": recording}
    app = App(session, session_path, host, port, allowed_origins, **shown).start()
    try:
        say(f"verefine-viz: {app.url}  (Ctrl-C ends it)")
        for note in notes:
            say(f"note: {one_line(note)}")
        if watch is not None:
            say(one_line(f"watching {watch.folder}; results in {watch.out}"))
        app.wait_until_ready()
        if open_browser:
            webbrowser.open(app.url)
        threading.Event().wait()
    except KeyboardInterrupt as stop:
        if type(stop) is not KeyboardInterrupt:  # SIGTERM and SIGHUP have exit codes of their own.
            raise
    finally:
        app.stop()


def check(session: Session) -> tuple[str, ...]:
    """Check that scene, method, refiner and verifier exist; return notes on the choice of frames.

    Raises:
        VerefineError: one of them does not.
    """
    from verefine_viz.scenes.source import open_scene

    check_names(session)
    scene = open_scene(session.scene, session.hypotheses)
    return (*scene.notes, *edits_elsewhere(session.edits, scene.frames))


if __name__ == "__main__":
    from verefine_viz.run.session_file import load_session

    path = Path(sys.argv[1])
    serve(load_session(path), session_path=path, port=int(sys.argv[2]), open_browser=False)
