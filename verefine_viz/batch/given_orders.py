"""What can be known about a given order of objects before the first frame is read."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.observation.given_order import Entries, checked, read_orders
from verefine_viz.scenes.frames import frame_name, parse_frame
from verefine_viz.scenes.models import ModelLibrary


def check_orders(session: Session, frames: Sequence[str]) -> None:
    """Looks at the order that ``session`` gives for all frames, or at those that its file gives for ``frames``.

    Which objects and instances are in a frame is known when it is read; what does not fit it is noted then.

    Raises:
        InputError: the order file cannot be read.
        SettingsError: an order is malformed, runs in a circle, or names an object that the data set does not have.
    """
    settings = session.dependency
    if not (settings.order or settings.order_file):
        return
    known = _objects(session)
    if settings.order:
        _check(checked(settings.order, "dependency.order"), "dependency.order", known)
        return
    orders = read_orders(Path(settings.order_file))
    for frame in orders:
        try:
            known_as = frame_name(parse_frame(frame))
        except SettingsError as error:
            raise SettingsError(f"order file {settings.order_file}: {error}") from None
        if frame != known_as:
            raise SettingsError(f"order file {settings.order_file}: frame {frame!r} is called {known_as!r}; rename it")
    for frame in frames:
        if frame in orders:
            _check(orders[frame], f"order file {settings.order_file}, frame {frame!r}", known)


def _check(entries: Entries, where: str, known: Collection[int] | None) -> None:
    seen: set[int | str] = set()
    for entry in (entry for cluster in entries for entry in cluster):
        if known is not None and isinstance(entry, int) and entry not in known:
            raise SettingsError(f"{where}: {unknown('object', entry, sorted(known))}")
        if entry in seen:
            raise SettingsError(
                f"{where} runs in a circle: it names {entry!r} twice; name what carries others first, each once"
            )
        seen.add(entry)


def _objects(session: Session) -> Collection[int] | None:
    """The ids of all objects that can occur; None for built-in scenes."""
    scene = session.scene
    return set(ModelLibrary(Path(scene.dataset), scene.model_points, scene.seed).ids) if scene.source == "bop" else None
