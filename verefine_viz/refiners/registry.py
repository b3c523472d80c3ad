"""Refiners by name. A new one is a class with ``refine`` (core.protocols.Refiner) and a line in ``REFINERS``.

Each is imported when first asked for, as names and hashes are also needed where nothing is refined.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.own_parts import NO_PARTS, OwnParts
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.core.settings import Session

if TYPE_CHECKING:
    from verefine_viz.refiners.depth_net import DepthNet


class Identity:
    """Returns the given pose, to show a method's effect by physics and choice alone."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The given pose (4, 4)."""
        return T_cam_obj


def _icp(session: Session) -> Refiner:
    from verefine_viz.refiners.icp import Icp

    return Icp(session.icp)


def _trimmed_icp(session: Session) -> Refiner:
    from verefine_viz.refiners.trimmed_icp import TrimmedIcp

    return TrimmedIcp(session.tricp)


def _depth_net(session: Session) -> DepthNet:
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
    "icp": _icp,
    "trimmed_icp": _trimmed_icp,
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


def make_refiner(name: str, session: Session, own: OwnParts = NO_PARTS) -> Refiner:
    """The refiner of that name with the session's settings; ``own``, parts of the caller, come before others.

    Raises:
        SettingsError: no refiner has that name; lists those that exist.
    """
    if name in own.refiners:
        return own.refiners[name]
    if name not in REFINERS:
        raise SettingsError(unknown("refiner", name, REFINERS))
    return REFINERS[name](session)
