"""Parts of your own: registered under a name for settings, or handed over in place of a name.

An exception or invalid answer of such a part becomes one line that names the part. It may write into its arguments.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeAlias, TypeVar

from verefine_viz.core.arguments import checked_mapping, checked_text, described
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ArgumentTypeError, InputError, ShapeError, quoted
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.own_parts import Lender, OwnParts, own_part
from verefine_viz.core.problem import Hypothesis, Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Estimator, PoseScorer, PoseSimulator, Refiner
from verefine_viz.core.refiner_steps import LearnedRefiner, RefinerStep, TrainedRefiner
from verefine_viz.core.settings import BULLET, EQ_1, POSES_GIVEN
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.physics.registry import SIMULATORS
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.rendering.registry import VERIFIERS

R = TypeVar("R", bound=Callable[[], Refiner])
E = TypeVar("E", bound=Callable[[], Estimator])
V = TypeVar("V", bound=Callable[[], PoseScorer])
S = TypeVar("S", bound=Callable[[], PoseSimulator])
AnyRefiner: TypeAlias = str | Refiner | Callable[[], Refiner]
"""A refiner's name, a refiner, or what makes one: its class, or a function."""
AnyEstimator: TypeAlias = str | Estimator | Callable[[], Estimator]
AnyVerifier: TypeAlias = str | PoseScorer | Callable[[], PoseScorer]
AnySimulator: TypeAlias = str | PoseSimulator | Callable[[], PoseSimulator]
_REGISTRIES = ("verefine_viz.refiners.registry", "verefine_viz.estimators.registry")


@dataclass(frozen=True)
class _Kind:
    """A kind of part."""

    word: str
    method: str
    """The method that its parts have."""
    section: str
    field: str
    """Where settings name it."""
    taken: tuple[str, ...] = ()
    """Names that no part may have."""
    by: str = ""
    """Whose they are."""


_REFINER = _Kind("refiner", "refine", "method", "refiner")
_ESTIMATOR = _Kind(
    "estimator", "hypotheses", "hypotheses", "source", (*POSES_GIVEN, "session"), "another source of initial poses"
)
_VERIFIER = _Kind("verifier", "scores", "score", "verifier", (EQ_1,), "Eq. 1")
_SIMULATOR = _Kind("simulator", "settle", "physics", "simulator", (BULLET,), "the simulator of this package")
_KINDS = (_REFINER, _ESTIMATOR, _VERIFIER, _SIMULATOR)


def refiner(name: str) -> Callable[[R], R]:
    """Register a class as a refiner: ``@vv.refiner("nudge")`` above it.

    The class takes no arguments and has ``refine(target, T_cam_obj, fixed=()) → (4, 4)``; see
    :class:`~verefine_viz.core.protocols.Refiner`. Poses are (4, 4) T_cam_obj [m]. Its answer must depend on the
    arguments alone. A refiner that takes arguments is handed over as an object: ``vv.solve(frame,
    refiner=MyRefiner(net))``.

    Args:
        name: the name in settings: ``vv.solve(frame, refiner="nudge")``.

    Raises:
        InputError: a part of this package has the name, or the class has no method ``refine``.
    """

    def register(kind: R) -> R:
        _check(name, _REFINER, kind)
        REFINERS[name] = lambda session: _CheckedRefiner(name, _made(f"refiner {name}", kind))
        return kind

    return register


def estimator(name: str) -> Callable[[E], E]:
    """Register a class as an estimator of initial poses: ``@vv.estimator("mine")`` above it.

    The class takes no arguments and has ``hypotheses(target, n, progress=…) → tuple[Hypothesis, …]``, the best first;
    see :class:`~verefine_viz.core.protocols.Estimator`.

    Args:
        name: the name in settings, ``hypotheses={"source": "mine"}``, and in ``vv.estimate(frame, "mug", "mine")``.

    Raises:
        InputError: it is the name of another source of initial poses, or of a part of this package, or the class has no
            method ``hypotheses``.
    """

    def register(kind: E) -> E:
        _check(name, _ESTIMATOR, kind)
        ESTIMATORS[name] = lambda session: _CheckedEstimator(name, _made(f"estimator {name}", kind))
        return kind

    return register


def verifier(name: str) -> Callable[[V], V]:
    """Register a class as a verifier, which scores poses in place of Eq. 1: ``@vv.verifier("crops")`` above it.

    The class takes no arguments and has ``scores(target, Ts_cam_obj, placed) → (N,)`` in [0, 1]; see
    :class:`~verefine_viz.core.protocols.PoseScorer`. Settings name it: ``score={"verifier": "crops"}``.

    Args:
        name: the name in settings.

    Raises:
        InputError: it is the name of Eq. 1 or of another part, or the class has no method ``scores``.
    """

    def register(kind: V) -> V:
        _check(name, _VERIFIER, kind)
        VERIFIERS[name] = lambda settings: _made(f"verifier {name}", kind)
        return kind

    return register


def simulator(name: str) -> Callable[[S], S]:
    """Register a class as a simulator, which moves objects in place of Bullet: ``@vv.simulator("drop")`` above it.

    The class takes no arguments and has ``settle(moving, fixed, support, n_steps)``, which returns the poses T_cam_obj
    (n_steps + 1, 4, 4) [m], the first before any step; see :class:`~verefine_viz.core.protocols.PoseSimulator`.
    Settings name it: ``physics={"simulator": "drop"}``.

    Args:
        name: the name in settings.

    Raises:
        InputError: it is Bullet's name or that of another part, or the class has no method ``settle``.
    """

    def register(kind: S) -> S:
        _check(name, _SIMULATOR, kind)
        SIMULATORS[name] = lambda settings: _made(f"simulator {name}", kind)
        return kind

    return register


# Parts that are handed over


def with_parts(sections: Mapping[str, Any], **given: Any) -> dict[str, Any]:
    """The sections with given parts, or their names, in the fields that take them; "" changes nothing.

    Args:
        sections: settings by section.
        given: ``refiner``, ``estimator``, ``verifier`` or ``simulator``.
    """
    out = dict(sections)
    for kind in _KINDS:
        part = given.get(kind.word, "")
        if isinstance(part, str):
            checked_text(part, kind.word, "its name, or an object or a class with " + kind.method)
        if not isinstance(part, str) or part:
            section = checked_mapping(out.get(kind.section, {}), kind.section, f"{kind.section}={{…}} by name")
            out[kind.section] = {**section, kind.field: part}
    return out


def named_parts(sections: Mapping[str, Any]) -> tuple[dict[str, Any], OwnParts]:
    """The sections with names in place of parts, and the checked parts by these names.

    A part is named after its class. Pages of this process find the last part of each name, too.

    Raises:
        InputError: an object given as a part is not one, or its class has the name of a part of this package.
        PartError: it cannot be made.
    """
    out, own = dict(sections), dict[str, dict[str, Any]]()
    for kind in _KINDS:
        section = sections.get(kind.section)
        part = section.get(kind.field, "") if isinstance(section, Mapping) else ""
        if section is None or isinstance(part, str):
            continue
        made = _handed_over(kind, part)
        name = type(made).__name__
        _check_name(name, kind)
        own[kind.word] = {name: _registered(kind, name, made)}
        out[kind.section] = {**section, kind.field: name}
    return out, OwnParts(*(own.get(kind.word, {}) for kind in (_REFINER, _ESTIMATOR, _VERIFIER, _SIMULATOR)))


def named_estimator(part: AnyEstimator) -> tuple[str, OwnParts]:
    """The name of an estimator, and the estimator where one was handed over; errors as :func:`named_parts`."""
    if isinstance(part, str):
        return checked_text(part, "estimator", "its name"), OwnParts()
    settings, own = named_parts({"hypotheses": {"source": part}})
    return settings["hypotheses"]["source"], own


def _handed_over(kind: _Kind, part: Any) -> Any:
    """The part that was given, or that the given class or function makes."""
    is_part = not isinstance(part, type) and callable(getattr(part, kind.method, None))
    made = part if is_part else _made(f"{kind.word} {_name(part)}", part) if callable(part) else None
    if not callable(getattr(made, kind.method, None)):
        what = described(part) if made is part or made is None else f"{_name(part)}, which makes {described(made)}"
        raise ArgumentTypeError(
            f"{kind.word} is {what}, expected a name, or an object with {kind.method}(…), its class or a function that "
            "makes one"
        )
    return made


def _name(part: Any) -> str:
    return quoted(getattr(part, "__name__", type(part).__name__), 40).strip("'")


def _registered(kind: _Kind, name: str, part: Any) -> Any:
    """The part in the form that toolboxes take, registered under its name in this process."""
    if kind is _REFINER:
        checked = _CheckedRefiner(name, part)
        REFINERS[name] = lambda session: checked
        return checked
    if kind is _ESTIMATOR:
        estimating = _CheckedEstimator(name, part)
        ESTIMATORS[name] = lambda session: estimating
        return estimating
    # These two are checked where settings make them.
    if kind is _VERIFIER:
        VERIFIERS[name] = lambda settings: part
    else:
        SIMULATORS[name] = lambda settings: part
    return part


def _made(who: str, kind: Callable[[], Any]) -> Any:
    with own_part(who):
        return kind()


class _CheckedRefiner:
    """A refiner of another program, whose poses are checked; its other attributes are passed on."""

    def __init__(self, name: str, refiner: Refiner) -> None:
        self._who, self._refiner, self._lender = f"refiner {name}", refiner, Lender(f"refiner {name}")
        if isinstance(refiner, LearnedRefiner):
            self.explain = self._explain
        if isinstance(refiner, TrainedRefiner):
            self.trained_range = refiner.trained_range

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        with self._lender.call(target, T_cam_obj, fixed) as lent:
            T_refined = self._refiner.refine(*lent)
        return as_rigid(T_refined, f"pose of {self._who}")

    def _explain(self, target: Target, T_cam_obj: Float) -> Sequence[RefinerStep]:
        assert isinstance(self._refiner, LearnedRefiner)
        with self._lender.call(target, T_cam_obj) as lent:
            return self._refiner.explain(*lent)

    def __getattr__(self, name: str) -> Any:
        if name == "_refiner":  # It is just being made or copied.
            raise AttributeError(name)
        return getattr(self._refiner, name)


class _CheckedEstimator:
    """An estimator of another program, whose answers are checked."""

    def __init__(self, name: str, estimator: Estimator) -> None:
        self._who, self._estimator, self._lender = f"estimator {name}", estimator, Lender(f"estimator {name}")

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        with self._lender.call(target) as (lent,):
            pool = tuple(islice(self._estimator.hypotheses(lent, n, progress), n))
        other = next((one for one in pool if not isinstance(one, Hypothesis)), None)
        if other is not None:
            kind = type(other).__name__
            raise ShapeError(f"{self._who} gave {kind}, expected Hypothesis(T_cam_obj, confidence, source)")
        return pool


def _check(name: str, kind: _Kind, cls: Any) -> None:
    _check_name(name, kind)
    if not isinstance(cls, type):
        raise ArgumentTypeError(
            f"{described(cls)} cannot be registered, expected a class with the method {kind.method}"
        )
    if not callable(getattr(cls, kind.method, None)):
        raise InputError(f"{quoted(cls.__name__)} has no method {kind.method}")


def _check_name(name: str, kind: _Kind) -> None:
    if not re.fullmatch(r"\w[\w.+-]{0,80}", checked_text(name, "name", "the name of the part in settings")):
        raise InputError(f"name is {quoted(name, 40)}, expected letters, digits, _ . + -")
    if name in kind.taken:
        raise InputError(f"{name!r} is the name of {kind.by}; choose another")
    built_in = (REFINERS.get(name), ESTIMATORS.get(name))
    if any(make.__module__ in _REGISTRIES for make in built_in if make is not None):
        raise InputError(f"{name!r} is the name of a part of this package; choose another")
