"""Refiners by name. A new one is a class with ``refine`` (core.protocols.Refiner) and a line in ``REFINERS``."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import dropwhile
from pathlib import Path

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.settings import Session
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.trimmed_icp import TrimmedIcp

# Refiners of another program: what they raise is told apart from a bug of this one.

_OWN = __name__.partition(".")[0]
_PACKAGE = Path(__file__).parents[1]
_LIBRARIES = ("<frozen ", *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")))
_RAISED = "raised by the refiner "


class Foreign:
    """Refines as another program's refiner does, and notes on what that raises that it did.

    Args:
        name: what sessions call it.
        inner: the refiner itself.
    """

    def __init__(self, name: str, inner: Refiner) -> None:
        self._name, self._inner = name, inner

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The pose that the refiner itself finds."""
        with _noted(self._name):
            return self._inner.refine(target, T_cam_obj, fixed)


def is_foreign(make: Callable[[Session], Refiner]) -> bool:
    """Whether what builds a refiner is another program's."""
    return getattr(make, "__module__", "").partition(".")[0] != _OWN


def made(name: str, make: Callable[[Session], Refiner], session: Session) -> Refiner:
    """Another program's refiner, built; what that raises is noted too."""
    with _noted(name):
        return Foreign(name, make(session))


def raised_by_refiner(error: BaseException) -> str:
    """What to tell of an exception of another program's refiner: which one raised what, and where; "" for any other."""
    note = next((n for n in getattr(error, "__notes__", ()) if n.startswith(_RAISED)), None)
    if note is None:
        return ""
    called = dropwhile(_is_outside, traceback.extract_tb(error.__traceback__))
    outside = [frame for frame in called if _is_outside(frame)]
    # What went wrong in a library is mended where it was called.
    frames = [f for f in outside if not f.filename.startswith(_LIBRARIES)] or outside
    where = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
    return f"the refiner {note.removeprefix(_RAISED)} raised {type(error).__name__}: {error}{where}"


def _is_outside(frame: traceback.FrameSummary) -> bool:
    return not Path(frame.filename).is_relative_to(_PACKAGE)


@contextmanager
def _noted(name: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        error.add_note(f"{_RAISED}{name!r}")
        raise


# The refiner that changes nothing: what a method does by physics and choice alone.


class Identity:
    """Returns the pose it was given."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The same pose (4, 4)."""
        return T_cam_obj


REFINERS: dict[str, Callable[[Session], Refiner]] = {
    "icp": lambda session: Icp(session.icp),
    "trimmed_icp": lambda session: TrimmedIcp(session.tricp),
    "identity": lambda session: Identity(),
}


def make_refiner(name: str, session: Session) -> Refiner:
    """The refiner of that name with the session's settings.

    Raises:
        SettingsError: no refiner has that name; lists those that exist.
    """
    if name not in REFINERS:
        raise SettingsError(unknown("refiner", name, REFINERS))
    make = REFINERS[name]
    return made(name, make, session) if is_foreign(make) else make(session)
