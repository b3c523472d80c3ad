"""The sentence above the switches of the View panel: what is drawn of the object in focus, and what is not."""

from __future__ import annotations

from collections.abc import Iterable

from verefine_viz.viewer.look import STAGES
from verefine_viz.viewer.view import View

LABELS = {"camera image": "photo", "ground truth": "truth"}
"""Layers that the panel calls otherwise."""


def view_words(view: View, switches: Iterable[str]) -> str:
    """As in: Drawn of mug: current, truth. On, but not made here: simulated. Off: best.

    Args:
        view: what is on the screen.
        switches: the layers that can be switched, in the order to name them.
    """
    layers, names = view.look.layers, tuple(switches)
    if view.sides is not None:
        drawn = "Drawn: the poses of A, solid, and of B, as an outline."
    else:
        poses = [name for name in STAGES if name in layers and name in view.poses]
        drawn = f"Drawn of {view.name}: {_listed(poses) or 'no pose'}{_others(view)}."
    waiting = [name for name in names if name in STAGES and name in layers and name not in view.poses]
    off = [name for name in names if name not in layers]
    return " ".join(
        (
            drawn,
            *([f"On, but not made here: {_listed(waiting)}."] if waiting and view.sides is None else []),
            f"Off: {_listed(off)}." if off else "Nothing is off.",
            *_cloud(view),
        )
    )


def _others(view: View) -> str:
    n = sum(o.T_cam_obj is not None for o in view.scene.objects) - 1
    return f"; {n} other object{'s' if n > 1 else ''}" if n > 0 and "others" in view.look.layers else ""


def _cloud(view: View) -> list[str]:
    if "cloud" not in view.look.layers or view.look.cloud == "colour":
        return []
    of = view.b.pose.label if view.b is not None else "B"
    meant = "observed − rendered depth" if view.look.cloud == "residual" else "class of each pixel"
    return [f"Cloud: {meant} for {of}."]


def _listed(names: Iterable[str]) -> str:
    return ", ".join(LABELS.get(name, name) for name in names)
