"""The command line: ``verefine-viz view | label | batch | estimate | evaluate | study | report | share | film | …``.

Exit codes: 0 done, 1 some frames failed or a check did not pass, 2 bad usage or input, 3 a recording that ended early,
130 stopped by Ctrl-C, 143 by SIGTERM, 129 as the terminal was closed (SIGHUP).
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import logging
import os
import signal
import stat
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import Annotated, Any, Protocol, Union

import tyro

import verefine_viz
from verefine_viz.commands.batch import BatchCommand
from verefine_viz.commands.datasets import Datasets
from verefine_viz.commands.doctor import DoctorCommand
from verefine_viz.commands.estimate import EstimateCommand
from verefine_viz.commands.evaluate import EvaluateCommand
from verefine_viz.commands.film_strip import FilmCommand
from verefine_viz.commands.fix import FixCommand
from verefine_viz.commands.flags import HELP_SETTINGS, show_help
from verefine_viz.commands.import_data import ImportCommand
from verefine_viz.commands.label import LabelCommand
from verefine_viz.commands.replay import ReplayCommand
from verefine_viz.commands.report import ReportCommand
from verefine_viz.commands.share_file import ShareCommand
from verefine_viz.commands.study import StudyCommand
from verefine_viz.commands.train import TrainCommand
from verefine_viz.commands.view import ViewCommand
from verefine_viz.core.errors import SettingsError, VerefineError, one_line, unknown
from verefine_viz.core.text_format import plain, say
from verefine_viz.core.writing import DISK_FULL, expand_home

PROGRAM = "verefine-viz"
DEBUG = "--debug"
USAGE = 2
"""Exit code for bad usage or input."""
TIDYING_S = 5.0
"""Time after a signal to stop in which further ones are ignored [s]."""
COMMANDS: dict[str, type[Command]] = {
    "view": ViewCommand,
    "label": LabelCommand,
    "batch": BatchCommand,
    "estimate": EstimateCommand,
    "evaluate": EvaluateCommand,
    "study": StudyCommand,
    "train": TrainCommand,
    "fix": FixCommand,
    "report": ReportCommand,
    "share": ShareCommand,
    "film": FilmCommand,
    "datasets": Datasets,
    "import": ImportCommand,
    "replay": ReplayCommand,
    "doctor": DoctorCommand,
}


class Command(Protocol):
    """A command: a dataclass whose fields are its options."""

    def run(self, arguments: Sequence[str]) -> int:
        """Carry out the command and return its exit code; ``arguments`` are the words it was parsed from."""
        ...


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse and run a command; an error that the user can mend becomes one line on stderr and exit code 2."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # A file's name need not be valid text.
            stream.reconfigure(errors="backslashreplace")
    if logging.lastResort is not None:  # The handler of warnings where none was set up.
        logging.lastResort.setFormatter(_PlainLines())
    if words == ["--version"]:
        say(f"{PROGRAM} {verefine_viz.__version__}")
        return 0
    with stopped_by_signals():
        return _run([_with_home(word) for word in words if word != DEBUG], DEBUG in words)


class _PlainLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return plain(super().format(record))


def _run(words: list[str], with_causes: bool) -> int:
    """Run a command and return its exit code; an error becomes one line, after its traceback if ``with_causes``."""
    try:
        code = parse(words).run(words[1:])
        sys.stdout.flush()
        return code
    except VerefineError as error:
        if with_causes:
            say(_with_its_causes(error), sys.stderr)
        return fail(str(error))
    except RuntimeError as error:
        if str(error).startswith("Symlink loop"):  # Raised before Python 3.13.
            return fail(f"{error}: links that lead to each other lead nowhere")
        # Numba raises it where the package belongs to another user and there is no home folder to write to.
        if "no locator available" not in str(error):
            raise
        return fail("compiled code cannot be cached anywhere; set NUMBA_CACHE_DIR to a folder that can be written to")
    except BrokenPipeError:
        # The reader of our output (head, less) has gone.
        _drop_output()
        return 0
    except OSError as error:
        if error.filename is not None:
            return fail(f"{error.filename}: {error.strerror}")
        if error.errno not in DISK_FULL:
            raise
        _drop_output()
        return fail(f"cannot write the output: {error.strerror}")
    except KeyboardInterrupt as stop:
        say("stopped", sys.stderr)
        return 128 + (stop.signal if isinstance(stop, Stopped) else signal.SIGINT)


def _with_its_causes(error: BaseException) -> str:
    """The traceback of an error with all that led to it, errors of libraries included."""
    one: BaseException | None = error
    while one is not None:
        one.__suppress_context__ = False
        one = one.__cause__ or one.__context__
    return "".join(traceback.format_exception(error))


class Stopped(KeyboardInterrupt):
    """A signal to end, from the system or another program; handled like Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.signal = number


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """End the block on Ctrl-C, SIGTERM or SIGHUP; signals that are ignored, as under nohup, stay ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    mine = {number: signal.getsignal(number) for number in signals}
    mine = {number: before for number, before in mine.items() if before in (signal.SIG_DFL, signal.default_int_handler)}
    tidying_until = 0.0

    def stop(number: int, _: FrameType | None) -> None:
        # Ctrl-C twice, or a closed terminal: a second signal must not interrupt the tidying up after the first.
        nonlocal tidying_until
        if time.monotonic() < tidying_until:
            return
        tidying_until = time.monotonic() + TIDYING_S
        if number == signal.SIGHUP:
            _silence_closed_terminal()
        raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)

    for number in mine:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, before in mine.items():
            signal.signal(number, before)


def _silence_closed_terminal() -> None:
    """Discard output to a terminal that is closed: writing there would raise an error while tidying up."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for output in (1, 2):
        # A closed terminal is still a device, but no longer a terminal.
        if stat.S_ISCHR(os.fstat(output).st_mode) and not os.isatty(output):
            os.dup2(nowhere, output)
    os.close(nowhere)


def _with_home(word: str) -> str:
    """A word with "~" replaced by the home folder: shells do not replace it in quotes and after ``--out=``."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return f"{option}{equals}{expand_home(value)}" if value == "~" or value.startswith("~/") else word


def _drop_output() -> None:
    """Discard what is still buffered: its reader has gone."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parse(words: list[str]) -> Command:
    """The command that the words ask for. Only its own options are built, which keeps --help fast.

    Raises:
        SettingsError: there is no command, or no section of settings, of that name.
        SystemExit: help was shown, or an error in the words (exit code 2).
    """
    if words and words[0] in COMMANDS:
        kind, program = COMMANDS[words[0]], f"{PROGRAM} {words[0]}"
        show_help(kind, program, words[1:])
        command: Any = tyro.cli(kind, prog=program, args=words[1:])
        return command
    if words and not words[0].startswith("-"):
        raise SettingsError(f"{unknown('command', words[0], COMMANDS)}; see {PROGRAM} --help")
    if HELP_SETTINGS in words:
        # Settings are the same for all commands that run a session.
        show_help(ViewCommand, f"{PROGRAM} view", words)
    names = [Annotated[_named(kind), tyro.conf.subcommand(name)] for name, kind in COMMANDS.items()]
    one_of: Any = Union[tuple(names)]  # noqa: UP007
    about = f"{verefine_viz.__doc__}\n\nEvery command takes {DEBUG}: an error comes with all that led to it."
    return tyro.cli(one_of, prog=PROGRAM, args=words, description=about)


def _named(kind: type[Command]) -> Any:
    """A command without its options, for the overview: its sentence alone."""
    stand_in = dataclasses.make_dataclass(kind.__name__, [])
    stand_in.__doc__ = kind.__doc__
    return stand_in


def fail(text: str) -> int:
    """Print one line on stderr and return exit code 2."""
    say(f"{PROGRAM}: {one_line(text)}", sys.stderr)
    return USAGE


if __name__ == "__main__":
    sys.exit(main())
