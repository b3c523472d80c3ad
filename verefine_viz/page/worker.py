"""The one thread that computes: it carries out verbs in order, answers wants in between, and goes on with runs."""

from __future__ import annotations

import logging
import threading
import traceback
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from time import monotonic
from typing import NamedTuple, Protocol

from msgspec.structs import replace

from verefine_viz.core.errors import Cancelled, InputError, VerefineError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.page.answers_to_wants import AnswerMessage, GoneAnswer
from verefine_viz.page.messages import AnyMessage, BusyMessage, ErrorMessage, NoteMessage, OfferedVerb
from verefine_viz.page.protocol import AnyVerb, Cancel, Look, Open, Step, UnconfirmedError, Want
from verefine_viz.physics.decomposition import PARTS_OF
from verefine_viz.run.kernel_compilation import COMPILING, compiling_reported

_LOG = logging.getLogger(__name__)
BETWEEN_S = 0.1
"""Time between two progress messages [s]."""


USE_HULLS = Open(hulls=True)
"""The verb to open the frame being opened, or begin the waiting run, with hulls instead of decomposed models."""


class Job(NamedTuple):
    """What a window asks for, or what the program has to do itself; without a verb the window has just connected."""

    window: int
    verb: AnyVerb | Callable[[], None] | None


class Jobs:
    """Queue of jobs for the worker. Callable from any thread."""

    def __init__(self) -> None:
        self._wake = threading.Condition()
        self._verbs: deque[Job] = deque()
        self._wants: OrderedDict[tuple[int, str], Want] = OrderedDict()
        self._look: Job | None = None
        self._is_cancelled = self._is_stopping = self._is_idle = False
        self.can_cancel = False
        """Whether the current job may be cancelled."""
        self.gives_way = False
        """Whether the current job is given up once another waits."""
        self.offers_hulls = self.wants_hulls = False
        """Whether what is being opened may be opened with hulls in place of convex parts, and whether it is to be."""

    def put(self, job: Job) -> None:
        """Add a job; a want takes the place of the one in its slot, and ``Cancel`` does not wait."""
        verb = job.verb
        with self._wake:
            if isinstance(verb, Cancel):
                self._is_cancelled = self.can_cancel
                if self._is_cancelled:
                    self._verbs = deque(waiting for waiting in self._verbs if callable(waiting.verb))
            elif verb == USE_HULLS:
                self.wants_hulls = self.offers_hulls
            elif isinstance(verb, Want):
                slot = (job.window, verb.slot or verb.id)
                self._wants.pop(slot, None)
                self._wants[slot] = verb
            elif isinstance(verb, Look):
                self._look = self._with_camera(job, verb)
            else:
                self._verbs.append(job)
            self._is_idle = self._is_idle and not self._waits
            self._wake.notify_all()

    def _with_camera(self, job: Job, look: Look) -> Job:
        """Return a look that replaces the waiting one, and takes over its camera movement."""
        before = self._look
        if before is None or before.window != job.window or look.camera is not None:
            return job
        assert isinstance(before.verb, Look)
        return Job(job.window, replace(look, camera=before.verb.camera))

    def take(self, wait: bool) -> Job | None:
        """Return the next job: verbs, then wants, then the last look; None where there is none, or at the end.

        Args:
            wait: whether to wait for one.
        """
        with self._wake:
            if wait:
                self._is_idle = not self._waits
                self._wake.notify_all()
                self._wake.wait_for(lambda: self._waits or self._is_stopping)
                self._is_idle = False
            if self._is_stopping:
                return None
            if self._verbs:
                return self._verbs.popleft()
            if self._wants:
                (window, _), want = self._wants.popitem(last=False)
                return Job(window, want)
            look, self._look = self._look, None
            return look

    @property
    def _waits(self) -> bool:
        return bool(self._verbs or self._wants or self._look)

    def is_wanted(self) -> bool:
        """Whether the current job is still wanted."""
        gives_way = (self.offers_hulls and self.wants_hulls) or (self.gives_way and self._waits)
        return not (self._is_cancelled or self._is_stopping or gives_way)

    @contextmanager
    def cancellable(self) -> Iterator[None]:
        """While this lasts, ``Cancel`` ends the job."""
        with self._wake:
            self.can_cancel, self._is_cancelled = True, False
        try:
            yield
        finally:
            with self._wake:
                self.can_cancel = self._is_cancelled = False

    @contextmanager
    def offering_hulls(self) -> Iterator[None]:
        """While this lasts, ``USE_HULLS`` ends the opening; ``wants_hulls`` says afterwards whether it did."""
        self.offers_hulls, self.wants_hulls = True, False
        try:
            yield
        finally:
            self.offers_hulls = False

    def wait_until_idle(self, timeout_s: float) -> None:
        """Wait until all jobs so far are done.

        Raises:
            TimeoutError: it takes longer than that.
        """
        with self._wake:
            if not self._wake.wait_for(lambda: self._is_idle and not self._waits, timeout_s):
                raise TimeoutError(f"still busy after {timeout_s} s")

    @property
    def is_stopping(self) -> bool:
        return self._is_stopping

    def stop(self) -> None:
        """End the worker, and its current job where that is possible."""
        with self._wake:
            self._is_stopping = True
            self._wake.notify_all()


class Handler(Protocol):
    """What carries out verbs; ``verbs.Debugger`` is the page's."""

    @property
    def is_running(self) -> bool:
        """Whether :meth:`tick` has something to compute."""
        ...

    def welcome(self, window: int) -> None:
        """Send a window that has just connected all that is known."""
        ...

    def apply(self, window: int, verb: AnyVerb) -> None:
        """Carry out a verb."""
        ...

    def tick(self) -> None:
        """Compute one iteration."""
        ...

    def use_hulls(self, branch: int | None = None) -> None:
        """Begin a run again with hulls in place of the convex parts that it waits for; None = the one computed."""
        ...

    def pause(self) -> None:
        """Stop computing."""
        ...

    def later(self) -> bool:
        """Work out a piece of background work; return whether there is more."""
        ...


Post = Callable[[AnyMessage, int | None], None]
"""Sends a message to a window; None = to all."""


class Worker:
    """Opens the handler, then works until it is stopped.

    Args:
        jobs: what windows ask for.
        post: sends messages.
        open_handler: opens the session; it gets the token with which long work reports and is cancelled.
    """

    def __init__(self, jobs: Jobs, post: Post, open_handler: Callable[[ProgressToken], Handler]) -> None:
        self._jobs, self._post, self._open_handler = jobs, post, open_handler
        self.progress = ProgressToken(self._report, jobs.is_wanted)
        self._text, self._reported_at = "", 0.0
        self.picture: str | None = None
        """Blob of the photo of what is being opened first, as soon as it is read."""
        self.ready = threading.Event()
        self.failure: Exception | None = None
        self.thread = threading.Thread(target=self._work, name="verefine-worker", daemon=True)

    # Progress of the current job

    def _report(self, text: str, share: float | None = None) -> None:
        now = monotonic()
        if (self._jobs.gives_way and text != COMPILING) or (not text and now - self._reported_at < BETWEEN_S):
            return
        self._text, self._reported_at = text or self._text, now
        jobs, hulls = self._jobs, self._jobs.offers_hulls and PARTS_OF in self._text
        self._post(BusyMessage(self._text, share, jobs.can_cancel, hulls, self.picture), None)

    def _idle(self) -> None:
        if self._text:
            self._text = ""
            self._post(BusyMessage(""), None)

    # The thread

    def _work(self) -> None:
        with compiling_reported(lambda: self._report(COMPILING)):
            try:
                with self._jobs.cancellable():
                    self._report("Opening.")
                    self.handler = self._open_handler(self.progress)
            except (Exception, Cancelled) as error:
                is_cancelled = isinstance(error, Cancelled)
                self.failure = InputError("opening was cancelled on the page") if is_cancelled else error
                if not isinstance(self.failure, VerefineError):
                    _LOG.exception("the session could not be opened")
                text = f"This cannot be opened: {self.failure}"
                self._post(BusyMessage(text), None)
                return
            finally:
                self.ready.set()
            self._idle()
            has_more = True
            while not self._jobs.is_stopping:
                job = self._jobs.take(wait=not (self.handler.is_running or has_more))
                if job is not None:
                    self._do(job)
                    has_more = True
                if self.handler.is_running:
                    self._guarded(None, partial(self._or_with_hulls, self.handler.tick, self.handler.use_hulls))
                elif job is None and has_more:
                    has_more = self._later()

    def _do(self, job: Job) -> None:
        window, verb = job
        if verb is None:
            self._guarded(window, lambda: self.handler.welcome(window))
        elif callable(verb):
            self._guarded(None, verb)
        else:
            self._guarded(window, lambda: self._apply(window, verb), verb)

    def _apply(self, window: int, verb: AnyVerb) -> None:
        """Carry out a verb; one that opens something, or takes a step, begins again with hulls once these are asked
        for.
        """
        if isinstance(verb, Open) and not verb.hulls:
            with_hulls = partial(self.handler.apply, window, replace(verb, hulls=True))
        elif isinstance(verb, Step):
            with_hulls = partial(self.handler.use_hulls, verb.branch)
        else:
            self.handler.apply(window, verb)
            return
        self._or_with_hulls(partial(self.handler.apply, window, verb), with_hulls)

    def _or_with_hulls(self, do: Callable[[], None], with_hulls: Callable[[], None]) -> None:
        """Do something; where hulls are asked for while it waits for convex parts, do the alternative."""
        try:
            with self._jobs.offering_hulls():
                do()
        except Cancelled:
            if not self._jobs.wants_hulls:
                raise
            with_hulls()

    def _guarded(self, window: int | None, do: Callable[[], None], verb: AnyVerb | None = None) -> None:
        """Do something; an error becomes one message and changes nothing."""
        try:
            with self._jobs.cancellable():
                do()
        except Cancelled:
            self.handler.pause()
            self._post(NoteMessage("Cancelled: everything is as it was before."), window)
        except Exception as error:
            text = str(error)
            if not isinstance(error, VerefineError):
                _LOG.exception("%s failed", type(verb).__name__ if verb is not None else "computing")
                text = unforeseen(error)
            if isinstance(verb, Want):
                self._post(AnswerMessage(verb.id, GoneAnswer(text)), window)
            else:
                self.handler.pause()
                offer = OfferedVerb(error.words, error.verb) if isinstance(error, UnconfirmedError) else None
                self._post(ErrorMessage(text, offer), window)
        self._idle()

    def _later(self) -> bool:
        """Do a piece of background work; give it up once a window waits."""
        self._jobs.gives_way = True
        try:
            return self.handler.later()
        except Cancelled:
            return True
        except Exception:
            _LOG.exception("work aside failed")
            return False
        finally:
            self._jobs.gives_way = False


def unforeseen(error: Exception) -> str:
    """Report an unexpected exception and its place: a bug here, or in a refiner of another program."""
    at = traceback.extract_tb(error.__traceback__)[-1:]
    where = f" ({at[0].filename}:{at[0].lineno})" if at else ""
    return f"{type(error).__name__}: {error}{where}; the log has more. The run stands before it."
