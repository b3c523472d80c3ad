"""Errors a user can meet. Each message says what was wrong, what was expected, and how to fix it, in one line."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import accumulate

LONGEST = 220
"""A list of names in a message is cut when it is longer [characters]."""
LONGEST_NUMBERS = 100
"""The same of numbers, which say less."""


class VerefineError(Exception):
    """Root of all errors this package raises on purpose; the command line prints its text as one line and exits 2."""


class InputError(VerefineError):
    """A file or folder is missing, damaged, or says something impossible."""


class SettingsError(VerefineError):
    """A session file or an option has an unknown name or a value outside its range."""


class ShapeError(VerefineError):
    """An array does not have the shape, type or values (finite, rigid, …) that were asked for."""


class NoHypothesisError(VerefineError):
    """An object has no initial pose to start from."""


class NoSupportError(VerefineError):
    """No support plane or gravity is known, and the request needs physics."""


class UnavailableError(VerefineError):
    """An optional package, a device or a port that the request needs is not there."""


class Cancelled(BaseException):
    """Nobody waits any more for what is being done; see :class:`core.patience.Patience`.

    Not an ``Exception``: what leaves out an object that is broken, or tries something else, must let this pass.
    """


def unknown(kind: str, name: object, available: Iterable[object]) -> str:
    """The text for a name that does not exist: ``unknown refiner 'ipc'; available: icp, tricp``."""
    names = list(available)
    meant = [other for other in names if isinstance(name, str) and str(other).casefold() == name.strip().casefold()]
    hint = f"did you mean {meant[0]!r}? " if meant else ""
    return f"unknown {kind} {name!r}; {hint}available: {listed(names)}"


def listed(names: Iterable[object]) -> str:
    """Names in one line, numbers as "1-21, 30"; of more than a line takes the first ones, and how many there are."""
    names = list(names)
    numbers = [name for name in names if isinstance(name, int)]
    are_numbers = len(numbers) == len(names)
    texts, most = (_ranges(numbers), LONGEST_NUMBERS) if are_numbers else ([str(name) for name in names], LONGEST)
    whole = ", ".join(texts)
    if len(whole) <= most or len(texts) == 1:
        return whole or "none"
    n_shown = max(1, sum(end - 2 <= most for end in accumulate(len(text) + 2 for text in texts)))
    return f"{', '.join(texts[:n_shown])}, … ({len(names)} in all)"


def _ranges(numbers: Iterable[int]) -> list[str]:
    """["1-21", "30", "31"] of 1, 2, …, 21, 30, 31: from four numbers on, those that follow each other are one."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return [text for run in runs for text in ([f"{run[0]}-{run[-1]}"] if len(run) > 3 else map(str, run))]
