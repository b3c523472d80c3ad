"""Errors that a user can meet. Each message names what was wrong, what was expected, and how to fix it, in one line."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from verefine_viz.core.text_format import listed, plain

NEAR = 0.65
"""Least share of letters that agree in similar names, such as two of three or three of four in the same order."""


class VerefineError(Exception):
    """Root of all errors this package raises on purpose; the command line prints its text as one line and exits 2."""

    def __str__(self) -> str:
        # Whatever it quotes from files or their names, it can be printed and written.
        return one_line(super().__str__())


class InputError(VerefineError, ValueError):
    """A file, a folder or an argument is missing, damaged, or holds something impossible."""


class ArgumentTypeError(InputError, TypeError):
    """An argument is of another type than was asked for."""


class SettingsError(VerefineError, ValueError):
    """A session file or an option has an unknown name or a value outside its range."""


class ContentError(VerefineError, ValueError):
    """The content of a file is not as expected; :func:`core.files.reading` puts the file's name before the text."""


class ShapeError(ContentError):
    """An array does not have the shape, type or values (finite, rigid, …) that were asked for."""


class NoSupportError(VerefineError):
    """No support plane or gravity is known, and the request needs physics."""


class UnavailableError(VerefineError):
    """An optional package, a device or a port that the request needs is not there."""


class PartError(VerefineError):
    """A refiner, verifier, estimator or simulator of a user's program raised an error."""


class Cancelled(BaseException):
    """The result is no longer wanted; see :class:`core.progress_token.ProgressToken`.

    Not an ``Exception``: code that skips a broken object, or tries something else, must let this pass.
    """


def unknown(kind: str, name: object, available: Iterable[object]) -> str:
    """The text for a name that does not exist: ``unknown refiner 'ipc'; did you mean 'icp'? available: icp, tricp``."""
    names = list(available)
    return f"unknown {kind} {quoted(name)}; {meant(name, names)}available: {listed(names)}"


def meant(name: object, available: Iterable[object]) -> str:
    """A question such as "did you mean 'icp'? ", with a space at its end; empty where no name is similar."""
    if not isinstance(name, str):
        return ""
    by_letters = {str(other).casefold(): other for other in available}
    # Another number is another thing, however alike they look.
    least = 1.0 if any(map(str.isdigit, name)) else NEAR
    near = get_close_matches(name.strip().casefold(), by_letters, n=1, cutoff=least)
    return f"did you mean {by_letters[near[0]]!r}? " if near else ""


def quoted(value: object, most: int = 80) -> str:
    """A value as it was written, for a message; a long one is cut, with a mark."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # Of thousands of digits or levels.
        return f"<{type(value).__name__}, too long to write>"
    return text if len(text) <= most else f"{text[:most]}…"


def one_line(text: str) -> str:
    """An error's text for a terminal, whatever it quotes from files (line breaks, terminal codes)."""
    return plain(" ".join(text.split()))
