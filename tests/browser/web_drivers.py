"""Firefox and WebKit as they come with Debian, without a screen: open an address, evaluate a script there."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.nothing_skipped import NO_OTHER_BROWSER

START_S, ANSWER_S = 30.0, 60.0
MINI_BROWSERS = "webkit2gtk-4.*/MiniBrowser"


class Driver:
    """A browser window.

    Args:
        go: opens an address.
        run: runs the body of a function, whose last argument is called with what comes out.
    """

    def __init__(self, go: Callable[[str], Any], run: Callable[[str], Any]) -> None:
        self._go, self._run = go, run

    def open(self, address: str) -> None:
        """Open an address, and wait until it is loaded."""
        self._go(address)

    def evaluate(self, body: str) -> Any:
        """Return what the body of an async function returns in the page."""
        return self._run(
            f"const done = arguments[arguments.length - 1];"
            f"(async () => {{ {body} }})().then((is) => done({{ is }}), (error) => done({{ error: String(error) }}));"
        )

    def until(self, body: str) -> None:
        """Wait until it returns what is true."""
        end, answer = time.monotonic() + ANSWER_S, None
        while time.monotonic() < end:
            answer = self.evaluate(body)
            if answer.get("is"):
                return
            time.sleep(0.2)
        page = self.evaluate("return document.body.innerText.slice(0, 400)")
        raise AssertionError(f"it never held: {body}: {answer}; the page: {page}")


@contextmanager
def firefox(home: Path) -> Iterator[Driver]:
    """Firefox by its own protocol, Marionette."""
    program = _program("firefox-esr", "firefox-esr")
    (home / "user.js").write_text('user_pref("marionette.port", 0);\n')
    words = [program, "--headless", "--marionette", "--no-remote", "--profile", str(home)]
    with _running(words, {"HOME": str(home)}):
        port = home / "MarionetteActivePort"
        _wait(lambda: port.is_file() and port.read_text())
        with socket.create_connection(("127.0.0.1", int(port.read_text())), timeout=ANSWER_S) as connection:
            file, numbers = connection.makefile("rb"), itertools.count(1)

            def received() -> Any:
                length = b"".join(iter(lambda: file.read(1), b":"))
                return json.loads(file.read(int(length)))

            def command(name: str, **words: Any) -> Any:
                sent = json.dumps([0, next(numbers), f"WebDriver:{name}", words]).encode()
                connection.sendall(b"%d:%b" % (len(sent), sent))
                _, _, error, value = received()
                assert error is None, error["message"]
                return value

            received()  # its greeting
            command("NewSession", capabilities={})
            command("SetWindowRect", width=1440, height=960)
            yield Driver(
                lambda address: command("Navigate", url=address),
                lambda script: command("ExecuteAsyncScript", script=script, args=[])["value"],
            )


@contextmanager
def webkit(home: Path) -> Iterator[Driver]:
    """WebKit by its driver, in a language that has no name: a system locale of C."""
    program, screen = _program("WebKitWebDriver", "webkit2gtk-driver"), _program("Xvfb", "xvfb")
    browser = next(Path("/usr/lib").glob(f"*/{MINI_BROWSERS}"), None)
    if browser is None:
        pytest.skip(_without("webkit2gtk-driver"))
    with _running([screen, "-displayfd", "1", "-screen", "0", "1440x960x24"], {}) as display:
        assert display.stdout is not None
        number, port = display.stdout.readline().decode().strip(), _free_port()
        settings = {"HOME": str(home), "DISPLAY": f":{number}", "LC_ALL": "C.UTF-8"}
        with _running([program, f"--port={port}"], settings):
            root = f"http://127.0.0.1:{port}"
            _wait(lambda: _answers(root))
            options = {"binary": str(browser), "args": ["--automation"]}
            wanted = {"capabilities": {"alwaysMatch": {"webkitgtk:browserOptions": options}}}
            session = f"{root}/session/{_posted(f'{root}/session', wanted)['sessionId']}"
            try:
                yield Driver(
                    lambda address: _posted(f"{session}/url", {"url": address}),
                    lambda script: _posted(f"{session}/execute/async", {"script": script, "args": []}),
                )
            finally:
                urllib.request.urlopen(urllib.request.Request(session, method="DELETE"), timeout=ANSWER_S).close()


def _without(package: str) -> str:
    return f"apt-get install {package}: {NO_OTHER_BROWSER}"


def _program(name: str, package: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(_without(package))
    return path


@contextmanager
def _running(words: list[str], settings: Mapping[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(
        words, env={**os.environ, **settings}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        try:
            yield process
        finally:
            process.terminate()


def _wait(holds: Callable[[], Any]) -> None:
    end = time.monotonic() + START_S
    while not holds():
        assert time.monotonic() < end, "the browser does not start"
        time.sleep(0.05)


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _answers(root: str) -> bool:
    try:
        urllib.request.urlopen(f"{root}/status", timeout=ANSWER_S).close()
    except OSError:
        return False
    return True


def _posted(address: str, content: Any) -> Any:
    """Return the value of an answer."""
    request = urllib.request.Request(
        address, json.dumps(content).encode(), {"Content-Type": "application/json"}, method="POST"
    )
    try:
        with urllib.request.urlopen(request, timeout=ANSWER_S) as reply:
            return json.load(reply)["value"]
    except urllib.error.HTTPError as error:
        raise AssertionError(error.read().decode()) from error
