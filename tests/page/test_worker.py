"""The worker's queue: what waits, what is overtaken, what is given up, and what goes wrong."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest

from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from tests.received import received
from verefine_viz.core.errors import InputError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.page import protocol as p
from verefine_viz.page.run_messages import RunMessage
from verefine_viz.page.worker import Job, Jobs, Worker

OPENING = "Preparing the convex parts of a mug for physics"


class SlowHandler:
    """A handler whose verbs take until they are let go."""

    is_running = False

    def __init__(self, progress: ProgressToken) -> None:
        self.progress, self.done = progress, []
        self.begun, self.go = threading.Event(), threading.Event()

    def welcome(self, window: int) -> None:
        self.done.append(("welcome", window))

    def apply(self, window: int, verb: p.AnyVerb) -> None:
        self.begun.set()
        if isinstance(verb, p.Open):
            while not verb.hulls and not self.go.wait(0.01):
                self.progress.checkpoint(OPENING)
        if isinstance(verb, p.Restart):
            raise InputError("no restart here")
        while isinstance(verb, p.Step) and verb.branch == 2:
            self.progress.checkpoint(OPENING)
            time.sleep(0.01)
        if isinstance(verb, p.Step):
            raise ZeroDivisionError("boom")
        self.done.append(verb)

    def tick(self) -> None: ...

    def use_hulls(self, branch: int | None = None) -> None:
        self.done.append(("hulls", branch))

    def pause(self) -> None: ...

    def later(self) -> bool:
        return False


@pytest.fixture
def work():
    jobs, messages, handlers = Jobs(), [], []

    def open_handler(progress: ProgressToken) -> SlowHandler:
        handlers.append(SlowHandler(progress))
        return handlers[0]

    worker = Worker(jobs, lambda message, window: messages.append((window, received(message))), open_handler)
    worker.thread.start()
    worker.ready.wait(10)
    yield jobs, messages, handlers[0]
    jobs.stop()
    worker.thread.join(10)
    assert not worker.thread.is_alive()


def test_an_opening_that_is_cancelled_ends_in_one_line() -> None:
    jobs, messages = Jobs(), list[dict]()

    def open_handler(progress: ProgressToken) -> SlowHandler:
        jobs.put(Job(1, p.Cancel()))
        progress.checkpoint(OPENING)
        return SlowHandler(progress)

    worker = Worker(jobs, lambda message, window: messages.append(received(message)), open_handler)
    worker.thread.start()
    worker.thread.join(10)
    assert worker.ready.is_set()
    assert isinstance(worker.failure, InputError)
    assert messages[-1]["text"] == f"This cannot be opened: {worker.failure}"
    assert "cancelled" in str(worker.failure)


def _until(done: Callable[[], bool]) -> None:
    for _ in range(1000):
        if done():
            return
        time.sleep(0.01)
    raise TimeoutError


def test_cancel_overtakes_and_takes_waiting_verbs_with_it(work):
    jobs, messages, handler = work
    jobs.put(Job(1, p.Open(frame="0/2")))
    _until(lambda: any(m.get("text") == OPENING for _, m in messages))
    jobs.put(Job(1, p.Fork(1)))
    jobs.put(Job(1, p.Cancel()))
    _until(lambda: any(m["t"] == "note" for _, m in messages))
    jobs.put(Job(1, p.Pause()))
    jobs.wait_until_idle(10)
    assert [type(verb) for verb in handler.done] == [p.Pause]
    assert (OPENING, True) in [(m["text"], m["cancel"]) for _, m in messages if m["t"] == "busy"]
    assert [m["text"] for _, m in messages if m["t"] == "busy"][-1] == ""


def test_opening_begins_again_with_hulls_once_they_are_asked_for(work):
    jobs, messages, handler = work
    jobs.put(Job(1, p.Open(frame="0/1")))
    handler.begun.wait(10)
    _until(lambda: any(message.get("hulls") for _, message in messages))
    jobs.put(Job(1, p.Open(hulls=True)))
    jobs.wait_until_idle(10)
    assert handler.done == [p.Open(frame="0/1", hulls=True)]
    assert not [message for _, message in messages if message["t"] in ("note", "error")]
    jobs.put(Job(1, p.Open(hulls=True)))
    jobs.wait_until_idle(10)
    assert len(handler.done) == 1, "nothing is being opened"


def test_a_step_that_waits_for_convex_parts_begins_again_with_hulls_once_they_are_asked_for(work):
    jobs, messages, handler = work
    jobs.put(Job(1, p.Step(branch=2)))
    _until(lambda: any(message.get("hulls") for _, message in messages))
    jobs.put(Job(1, p.Open(hulls=True)))
    jobs.wait_until_idle(10)
    assert handler.done == [("hulls", 2)]


def test_of_the_wants_of_a_slot_the_latest_wins_for_each_window(work):
    jobs, _, handler = work
    jobs.put(Job(1, p.Open(frame="0/2")))
    handler.begun.wait(10)
    for k in range(50):
        jobs.put(Job(1 + k % 2, p.Want(str(k), p.PhysicsWanted(0, k=k), "physics")))
    jobs.put(Job(1, p.Want("other", p.PhysicsWanted(0, k=99))))
    jobs.put(Job(1, p.Look(k=1, camera="sensor")))
    jobs.put(Job(1, p.Look(k=2)))
    handler.go.set()
    jobs.wait_until_idle(10)
    assert [verb.id for verb in handler.done if isinstance(verb, p.Want)] == ["48", "49", "other"]
    looks = [(verb.k, verb.camera) for verb in handler.done if isinstance(verb, p.Look)]
    assert looks == [(2, "sensor")]  # Where the camera is to go is not lost.


def test_faults_become_one_message_to_the_window_that_asked(work):
    jobs, messages, _ = work
    jobs.put(Job(3, p.Restart()))
    jobs.put(Job(4, p.Step()))
    jobs.put(Job(5, None))
    jobs.wait_until_idle(10)
    errors = [(window, m["text"]) for window, m in messages if m["t"] == "error"]
    assert errors[0] == (3, "no restart here")
    assert errors[1][0] == 4
    assert "the log has more" in errors[1][1]


def test_two_windows_see_one_run(open_page):
    app = open_page()
    rows: dict[int, list[int]] = {}

    def post(message, window=None):
        if isinstance(message, RunMessage):
            rows.setdefault(window or 0, []).extend(row.k for row in message.rows)

    app.worker.handler.post = post
    app._receive(1, None)
    app._receive(1, p.Step())
    app._receive(2, None)
    app._receive(2, p.RunVerb())
    app.wait_until_idle()
    n = app.debugger.space.work.first.run.length
    assert rows[0] == list(range(1, n + 1))
    assert rows[2] == [1]


def test_session_that_cannot_be_opened_is_reported_and_the_server_ends(processes):
    from verefine_viz.page.app import App

    class Broken(FakeTools):
        def problem(self, frame, **_):
            raise InputError("no such picture")

    app = App(SESSION, port=0, make_tools=Broken).start()
    with pytest.raises(InputError, match="no such picture"):
        app.wait_until_ready(20)
    app.stop()
