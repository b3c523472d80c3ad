"""Checks whether a session can run over its frames, so that a mistake shows before the first frame."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.settings import Session
from verefine_viz.grasping.grasp_poses import grasp_files
from verefine_viz.observation.given_order import Entries, checked, read_orders
from verefine_viz.physics.given_parts import check_collider_folder
from verefine_viz.run.session_parts import check_names
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.environment_mesh import environment_mesh
from verefine_viz.scenes.models import ModelLibrary


def check(session: Session) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Check everything in a session that can be wrong.

    Returns:
        Its frames, and notes about the choice of frames and about the initial poses.

    Raises:
        VerefineError: the data set, a frame, the method, a given order, the mesh of the surroundings, the folder of
            colliders or of grasps or another name in the session is wrong, or the results files are of other frames or
            objects.
    """
    toolbox = Toolbox(session)
    frames = toolbox.frames
    if not frames:
        raise InputError("the session names no frames: the split and the targets file hold none")
    notes = (*toolbox.notes, *toolbox.source.check_initial_poses())
    _check_orders(session, frames)
    check_names(session)
    _ = toolbox.method  # The method with its refiner and verifier.
    if session.physics.support == "mesh":
        environment_mesh(session.physics)
    if session.physics.collider_folder:
        check_collider_folder(Path(session.physics.collider_folder))
    if session.grasp.answers and session.grasp.folder:
        grasp_files(Path(session.grasp.folder))
    return frames, notes


def _check_orders(session: Session, frames: Sequence[str]) -> None:
    """Check the order of objects that ``session`` gives for all frames, or that its order file gives for ``frames``.

    Which objects and instances are in a frame is known when it is read; what does not fit it is noted then.

    Raises:
        InputError: the order file cannot be read.
        SettingsError: an order is malformed, runs in a circle, or names an object that the data set does not have.
    """
    scene, settings = session.scene, session.dependency
    if not (settings.order or settings.order_file):
        return
    known = None  # Built-in scenes have no list of objects.
    if scene.source == "bop":
        known = set(ModelLibrary(Path(scene.dataset), scene.model_points, scene.seed).ids)
    if settings.order:
        _check_order(checked(settings.order, "dependency.order"), "dependency.order", known)
        return
    orders = read_orders(Path(settings.order_file))
    for frame in orders:
        try:
            name = frame_name(parse_frame(frame))
        except SettingsError as error:
            raise SettingsError(f"order file {settings.order_file}: {error}") from None
        if frame != name:
            raise SettingsError(f"order file {settings.order_file}: frame {frame!r} is called {name!r}; rename it")
    for frame in frames:
        if frame in orders:
            _check_order(orders[frame], f"order file {settings.order_file}, frame {frame!r}", known)


def _check_order(entries: Entries, where: str, known: Collection[int] | None) -> None:
    seen: set[int | str] = set()
    for entry in (entry for cluster in entries for entry in cluster):
        if known is not None and isinstance(entry, int) and entry not in known:
            raise SettingsError(f"{where}: {unknown('object', entry, sorted(known))}")
        if entry in seen:
            raise SettingsError(
                f"{where} runs in a circle: it names {entry!r} twice; name what supports others first, each once"
            )
        seen.add(entry)
