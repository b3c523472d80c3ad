"""A worker that does what its frame's number says; stands in for the real one, which takes seconds to start."""

from __future__ import annotations

import os
import signal
import sys
from multiprocessing import connection
from pathlib import Path

from tests.made_runs import finished

DIES, EXITS = "0/13", "0/17"
DIES_ONCE = "0/19"
TAKES_LONG = "0/23", "0/29"
WHY = "Compiling."


def work(channel: connection.Connection) -> None:
    """Answers each frame; is killed by one and leaves at another; says twice why one takes long."""
    out = Path()
    while True:
        try:
            given, frame = channel.recv()
        except EOFError:
            return
        out = out if given is None else given.out
        if frame is None:
            continue
        if frame == DIES:
            os.kill(os.getpid(), signal.SIGKILL)
        if frame == DIES_ONCE and not (out / "died").exists():
            (out / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if frame == EXITS:
            sys.exit(3)
        if frame in TAKES_LONG:
            channel.send(WHY)
            channel.send(WHY)
        channel.send(finished(frame, (), seconds=float(os.getpid())))
