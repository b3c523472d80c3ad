"""Refiners by name. A new one is a class with ``refine`` (core.protocols.Refiner) and a line in ``REFINERS``.

An exception of another program's refiner is marked as such, so that it is not taken for a bug of this one.
"""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import dropwhile
from pathlib import Path
from typing import TYPE_CHECKING

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.refiner_steps import LearnedRefiner, RefinerStep, TrainedRange
from verefine_viz.core.settings import Session
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.trimmed_icp import TrimmedIcp

if TYPE_CHECKING:
    from verefine_viz.refiners.depth_net import DepthNet

_OWN = __name__.partition(".")[0]
_PACKAGE = Path(__file__).parents[1]
_LIBRARIES = ("<frozen ", *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")))
_RAISED = "raised by the refiner "


class Foreign:
    """Refines as another program's refiner does, and marks the exceptions of that.

    Args:
        name: what sessions call it.
        inner: the refiner itself.

    Raises:
        SettingsError: its ``trained_range`` is none.
    """

    def __init__(self, name: str, inner: Refiner) -> None:
        self._name, self._inner = name, inner
        trained = getattr(inner, "trained_range", None)
        if not isinstance(trained, TrainedRange | None):
            raise SettingsError(
                f"trained_range of the refiner {name!r} is {trained!r}, expected a TrainedRange(rotation_deg=…, "
                "shift_radii=…) of verefine_viz.core.refiner_steps"
            )
        self.trained_range = trained

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refiner's own result."""
        with _marked(self._name):
            return self._inner.refine(target, T_cam_obj, fixed)


class ForeignLearned(Foreign):
    """The same for one that can say what it saw.

    Args:
        name: what sessions call it.
        inner: the refiner itself.
    """

    def __init__(self, name: str, inner: LearnedRefiner) -> None:
        super().__init__(name, inner)
        self._learned = inner

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        """The refiner's own steps.

        Raises:
            InputError: it returned something else.
        """
        with _marked(self._name):
            steps = self._learned.explain(target, T_cam_obj)
        if not isinstance(steps, Sequence) or not all(isinstance(step, RefinerStep) for step in steps):
            raise InputError(
                f"explain of the refiner {self._name!r} returned {type(steps).__name__}, expected a list of "
                "RefinerStep of verefine_viz.core.refiner_steps"
            )
        return list(steps)


def raised_by_refiner(error: BaseException) -> str:
    """The message for an exception of another program's refiner: which one raised what, and where; "" for any other."""
    note = next((n for n in getattr(error, "__notes__", ()) if n.startswith(_RAISED)), None)
    if note is None:
        return ""
    called = dropwhile(_is_outside, traceback.extract_tb(error.__traceback__))
    outside = [frame for frame in called if _is_outside(frame)]
    # An exception of a library is shown where the refiner called it.
    frames = [f for f in outside if not f.filename.startswith(_LIBRARIES)] or outside
    where = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
    return f"the refiner {note.removeprefix(_RAISED)} raised {type(error).__name__}: {error}{where}"


def _is_outside(frame: traceback.FrameSummary) -> bool:
    return not Path(frame.filename).is_relative_to(_PACKAGE)


@contextmanager
def _marked(name: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        error.add_note(f"{_RAISED}{name!r}")
        raise


class Identity:
    """Returns the pose it was given: what a method does by physics and choice alone."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The same pose (4, 4)."""
        return T_cam_obj


def _depth_net(session: Session) -> DepthNet:
    # onnxruntime is heavy, and most runs do without.
    from verefine_viz.refiners.depth_net import DepthNet

    return DepthNet(session.depth_net, session.score.simplify_mm)


def _depth_net_icp(session: Session) -> Refiner:
    from verefine_viz.refiners.depth_net import DepthNetIcp

    return DepthNetIcp(_depth_net(session), session.icp)


def _depth_net_hash(session: Session) -> str:
    from verefine_viz.learned.onnx_network import hash_of, read_weights
    from verefine_viz.refiners.depth_net import weights_path

    return hash_of(read_weights(weights_path(session.depth_net)))


def _densefusion(session: Session) -> Refiner:
    from verefine_viz.refiners.densefusion_refiner import DenseFusionRefiner

    return DenseFusionRefiner(session.densefusion)


def _densefusion_hash(session: Session) -> str:
    from verefine_viz.networks.densefusion_weights import weights_hash

    return weights_hash(session.densefusion, with_refiner=True)


REFINERS: dict[str, Callable[[Session], Refiner]] = {
    "icp": lambda session: Icp(session.icp),
    "trimmed_icp": lambda session: TrimmedIcp(session.tricp),
    "depth_net": _depth_net,
    "depth_net_icp": _depth_net_icp,
    "densefusion": _densefusion,
    "identity": lambda session: Identity(),
}
WEIGHTS: dict[str, Callable[[Session], str]] = {
    "depth_net": _depth_net_hash,
    "depth_net_icp": _depth_net_hash,
    "densefusion": _densefusion_hash,
}
"""The hash of the weights of each learned refiner, by which recordings and run.json name them."""


def make_refiner(name: str, session: Session) -> Refiner:
    """The refiner of that name with the session's settings.

    Raises:
        SettingsError: no refiner has that name; lists those that exist.
    """
    if name not in REFINERS:
        raise SettingsError(unknown("refiner", name, REFINERS))
    make = REFINERS[name]
    if getattr(make, "__module__", "").partition(".")[0] == _OWN:
        return make(session)
    with _marked(name):
        refiner = make(session)
    return ForeignLearned(name, refiner) if isinstance(refiner, LearnedRefiner) else Foreign(name, refiner)
