"""Refiners, verifiers, estimators and simulators of a user's program: arrays lent to them, their errors, and parts
that a caller hands over as objects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from traceback import extract_tb
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from verefine_viz.core.errors import PartError, VerefineError
from verefine_viz.core.protocols import Estimator, PoseScorer, PoseSimulator, Refiner

_PACKAGE = str(Path(__file__).resolve().parents[1])
_LENDER = "_lender"


@dataclass(frozen=True, eq=False)
class OwnParts:
    """Parts that a caller handed over, by their names in the settings; other parts are looked up by name."""

    refiners: Mapping[str, Refiner] = field(default_factory=dict)
    estimators: Mapping[str, Estimator] = field(default_factory=dict)
    verifiers: Mapping[str, PoseScorer] = field(default_factory=dict)
    simulators: Mapping[str, PoseSimulator] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any((self.refiners, self.estimators, self.verifiers, self.simulators))

    def __or__(self, others: OwnParts) -> OwnParts:
        return OwnParts(
            {**self.refiners, **others.refiners},
            {**self.estimators, **others.estimators},
            {**self.verifiers, **others.verifiers},
            {**self.simulators, **others.simulators},
        )


NO_PARTS = OwnParts()


@contextmanager
def own_part(part: str) -> Iterator[None]:
    """Name the part, and the line of the user's file, in an error that the part raises.

    Args:
        part: kind and name, as "simulator drop".

    Raises:
        PartError: it raised something; the cause is kept, with its traceback.
    """
    try:
        yield
    except VerefineError:
        raise  # Cancelled, or an error that says in one line what is wrong.
    except Exception as error:
        frames = [frame for frame in extract_tb(error.__traceback__) if not frame.filename.startswith(_PACKAGE)]
        own = [frame for frame in frames if frame.filename == frames[0].filename]
        where = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
        raise PartError(f"{part} raised {type(error).__name__}: {error}{where}") from error


class Lender:
    """Lends frames, models and poses to one part: their values, in arrays of its own that it may write into.

    An array is copied when the part first looks at it in a call, and the copy is dropped after the call: whatever the
    part writes, its next call sees the original values. A record is lent as the same object in every call, so that a
    part can cache by it.

    Args:
        part: kind and name, as "simulator drop".
    """

    def __init__(self, part: str) -> None:
        self._part = part
        self._twins: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        self._copies: dict[tuple[int, str], Any] = {}

    @contextmanager
    def call(self, *given: Any) -> Iterator[tuple[Any, ...]]:
        """The twins of some arguments that the part gets, during one call.

        Raises:
            PartError: it raised something.
        """
        try:
            with own_part(self._part):
                yield tuple(map(self.lent, given))
        finally:
            self._copies.clear()

    def lent(self, value: Any) -> Any:
        """A copy of an array, a twin of a record of this package, else the value itself."""
        if isinstance(value, np.ndarray):
            return value.copy()
        if isinstance(value, tuple | list):
            return type(value)(map(self.lent, value)) if type(value) in (tuple, list) else value
        if isinstance(value, type) or not is_dataclass(value) or not type(value).__module__.startswith("verefine_viz."):
            return value
        if value not in self._twins:
            self._twins[value] = self._twin(value)
        return self._twins[value]

    def _twin(self, record: Any) -> Any:
        twin = object.__new__(_twin_class(type(record)))
        twin.__dict__.update({**record.__dict__, _LENDER: self})
        return twin

    def copy_of(self, owner: int, name: str, value: Any) -> Any:
        """Value of a twin's field during this call."""
        if (owner, name) not in self._copies:
            self._copies[owner, name] = self.lent(value)
        return self._copies[owner, name]


class _Twin:
    """A record whose arrays are copies; mixed into the record's class."""

    def __getattribute__(self, name: str) -> Any:
        own = object.__getattribute__(self, "__dict__")
        if name not in own or _LENDER not in own or name == _LENDER:
            return super().__getattribute__(name)
        return own[_LENDER].copy_of(id(self), name, own[name])

    def __reduce__(self) -> tuple[Any, ...]:
        base: Any = type(self).__mro__[2]
        return base, tuple(getattr(self, one.name) for one in fields(base))


@cache
def _twin_class(kind: type) -> type:
    return type(kind.__name__, (_Twin, kind), {"__module__": kind.__module__, "__doc__": kind.__doc__})
