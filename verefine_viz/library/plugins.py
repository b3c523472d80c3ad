"""Parts of your own, registered by a name that settings then take.

What such a part raises, and an answer that is none, is one line that names the part.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any, TypeVar

from verefine_viz.core.arguments import checked_text, described
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ArgumentTypeError, InputError, ShapeError, quoted
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.own_parts import own_part
from verefine_viz.core.problem import Hypothesis, Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import Estimator, PoseScorer, PoseSimulator, Refiner
from verefine_viz.core.settings import BULLET, EQ_1, POSES_GIVEN
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.physics.registry import SIMULATORS
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.rendering.registry import VERIFIERS

R = TypeVar("R", bound=Callable[[], Refiner])
E = TypeVar("E", bound=Callable[[], Estimator])
V = TypeVar("V", bound=Callable[[], PoseScorer])
S = TypeVar("S", bound=Callable[[], PoseSimulator])
_REGISTRIES = ("verefine_viz.refiners.registry", "verefine_viz.estimators.registry")


def refiner(name: str) -> Callable[[R], R]:
    """Register a class as a refiner: ``@vv.refiner("nudge")`` above it.

    The class takes no arguments and has ``refine(target, T_cam_obj, fixed=()) → (4, 4)``; see
    :class:`~verefine_viz.core.protocols.Refiner`. Poses are (4, 4) T_cam_obj [m]. Its answer must depend on the
    arguments alone.

    Args:
        name: the name in settings: ``vv.solve(frame, refiner="nudge")``.

    Raises:
        InputError: a part of this package has the name, or the class has no method ``refine``.
    """

    def register(kind: R) -> R:
        _check(name, "refine", kind)
        checked = _checked_refiner(name, kind)
        REFINERS[name] = lambda session: _made(f"refiner {name}", checked)
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
        _check(name, "hypotheses", kind, (*POSES_GIVEN, "session"), "another source of initial poses")
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
        _check(name, "scores", kind, (EQ_1,), "Eq. 1")
        VERIFIERS[name] = lambda settings: _made(f"verifier {name}", kind)
        return kind

    return register


def simulator(name: str) -> Callable[[S], S]:
    """Register a class as a simulator, which moves objects in place of Bullet: ``@vv.simulator("drop")`` above it.

    The class takes no arguments and has ``settle(moving, fixed, support, n_steps)``, which gives the poses T_cam_obj
    (n_steps + 1, 4, 4) [m] before and after each step; see :class:`~verefine_viz.core.protocols.PoseSimulator`.
    Settings name it: ``physics={"simulator": "drop"}``.

    Args:
        name: the name in settings.

    Raises:
        InputError: it is Bullet's name or that of another part, or the class has no method ``settle``.
    """

    def register(kind: S) -> S:
        _check(name, "settle", kind, (BULLET,), "the simulator of this package")
        SIMULATORS[name] = lambda settings: _made(f"simulator {name}", kind)
        return kind

    return register


def _made(who: str, kind: Callable[[], Any]) -> Any:
    with own_part(who):
        return kind()


def _checked_refiner(name: str, kind: Any) -> Callable[[], Refiner]:
    """Return the class of a refiner, with its poses checked; what else it has stays."""

    class Checked(kind):
        def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
            with own_part(f"refiner {name}"):
                T_refined = super().refine(target, T_cam_obj, fixed)
            return as_rigid(T_refined, f"pose of refiner {name}")

    return Checked


class _CheckedEstimator:
    """An estimator of another program, whose answers are checked."""

    def __init__(self, name: str, estimator: Estimator) -> None:
        self._who, self._estimator = f"estimator {name}", estimator

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        with own_part(self._who):
            pool = tuple(islice(self._estimator.hypotheses(target, n, progress), n))
        other = next((one for one in pool if not isinstance(one, Hypothesis)), None)
        if other is not None:
            kind = type(other).__name__
            raise ShapeError(f"{self._who} gave {kind}, expected Hypothesis(T_cam_obj, confidence, source)")
        return pool


def _check(name: str, method: str, kind: Any, taken: tuple[str, ...] = (), by: str = "") -> None:
    if not re.fullmatch(r"\w[\w.+-]{0,80}", checked_text(name, "name", "the name of the part in settings")):
        raise InputError(f"name is {quoted(name, 40)}, expected letters, digits, _ . + -")
    if not isinstance(kind, type):
        raise ArgumentTypeError(f"{described(kind)} cannot be registered, expected a class with the method {method}")
    if name in taken:
        raise InputError(f"{name!r} is the name of {by}; choose another")
    built_in = (REFINERS.get(name), ESTIMATORS.get(name))
    if any(make.__module__ in _REGISTRIES for make in built_in if make is not None):
        raise InputError(f"{name!r} is the name of a part of this package; choose another")
    if not callable(getattr(kind, method, None)):
        raise InputError(f"{quoted(kind.__name__)} has no method {method}")
