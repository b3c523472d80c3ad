"""Errors a user can meet. Each message says what was wrong, what was expected, and how to fix it, in one line."""

from __future__ import annotations

from collections.abc import Iterable

from verefine_viz.core.listing import listed


class VerefineError(Exception):
    """Root of all errors this package raises on purpose; the command line prints its text as one line and exits 2."""


class InputError(VerefineError):
    """A file or folder is missing, damaged, or says something impossible."""


class SettingsError(VerefineError):
    """A session file or an option has an unknown name or a value outside its range."""


class ShapeError(VerefineError):
    """An array does not have the shape, type or values (finite, rigid, …) that were asked for."""


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
