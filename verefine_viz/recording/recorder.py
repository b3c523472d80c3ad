"""Writes every iteration of a run to a rerun recording; a watcher, so it can change nothing."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.protocols import RunState, Verifier
from verefine_viz.core.records import Iteration, PlacedPose
from verefine_viz.core.settings import Session
from verefine_viz.recording.against_truth import AgainstTruth
from verefine_viz.recording.blueprint import blueprint_messages
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.frame import frame_chunks
from verefine_viz.recording.journal import Journal
from verefine_viz.recording.layout import Layout, layout_of
from verefine_viz.recording.live_file import LiveFile
from verefine_viz.recording.maps import SCENE_TILE_PX, Maps
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.rrd_file import RrdFile
from verefine_viz.recording.threaded_file import ThreadedFile
from verefine_viz.recording.unfinished import journal_path, name_finished, part_path
from verefine_viz.session.files import session_toml

SCHEMA = 3
"""Of the recording; a reader refuses others. 3: iterations as msgpack."""
BLOCK = 200
"""Iterations that are drawn together; the journal holds them until then."""
BLOCK_WITH_MAPS = 10
"""The same where score maps are recorded, which are large: a file that is cut later keeps what lies before the cut."""
PACKAGES = ("verefine-viz", "numpy", "numba", "scipy", "pybullet", "open3d", "coacd", "trimesh", "rerun-sdk")


class Recorder:
    """Records one run to ``path``.

    The file is ``path`` + ``.part`` until the run is over. When :meth:`on_iteration` returns, the iteration is in the
    journal and survives the end of the process; it is drawn beside the run or, in one go, at its end.
    """

    def __init__(
        self,
        path: Path,
        session: Session,
        problem: Problem,
        verifier_of: Callable[[int], Verifier] | None = None,
        live_port: int | None = None,
        block: int = BLOCK,
    ) -> None:
        """Nothing is written before :meth:`on_start`.

        Args:
            path: the recording, ``….rrd``; its folder is made if needed.
            session: what is being run; written into the recording.
            problem: the frame.
            verifier_of: what judged iteration k, to make its score maps; None = no maps, whatever the session says.
            live_port: also serve the recording to rerun viewers on this port of 127.0.0.1.
            block: iterations drawn together, with score maps at most 10; with a live viewer every iteration is drawn
                at once.
        """
        self._path = path
        self._session = session
        self._problem = problem
        self._verifier_of = verifier_of if session.recording.maps else None
        self._live_port = live_port
        self._block = block
        if self._verifier_of is not None:
            self._block = min(block, BLOCK_WITH_MAPS)
        if live_port is not None:
            self._block = 1
        self._file: RrdFile | ThreadedFile | LiveFile | None = None
        self._pending: list[Entry] = []
        self._maps: tuple[int, Verifier, Maps] | None = None
        self._truth = AgainstTruth()

    def on_start(self, state: RunState) -> None:
        """Opens the file and logs the frame, the hypotheses and their scores.

        Raises:
            InputError: the file cannot be written.
        """
        # A method may add hypotheses of its own to the problem it was given.
        self._problem = state.problem
        self._layout = layout_of(self._problem, state, self._session.method.name)
        self._targets = {t.instance.instance_id: t for t in self._problem.targets}
        self._drawing = Drawing(self._layout)
        about = properties(self._session, self._problem, self._layout)
        part = part_path(self._path)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._journal = Journal(journal_path(self._path), about)
            part.unlink(missing_ok=True)
            has_maps = self._verifier_of is not None
            port = self._live_port
            if port is not None:
                self._file = LiveFile(part, port, self._layout, has_maps)
            else:
                file = RrdFile(part)
                self._file = ThreadedFile(file) if has_maps else file
        except (OSError, RuntimeError) as error:
            raise InputError(f"cannot write the recording {self._path}: {error}") from None
        self._file.send(frame_chunks(about, self._problem, self._layout, self._drawing, pictures=has_maps))

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        """Writes one iteration; it is on disk when this returns.

        Raises:
            InputError: the file cannot be written any more.
        """
        assert self._file is not None, "on_start comes first"
        errors = self._truth.errors(self._targets[iteration.instance_id], iteration)
        entry = Entry.of(iteration, errors)
        self._journal.append(entry)
        self._pending.append(entry)
        if self._verifier_of is not None:
            for chunks in self._pictures(self._verifier_of(iteration.index), iteration):
                self._file.send(chunks)
        if len(self._pending) >= self._block:
            self.draw_now()

    def draw_now(self) -> None:
        """Draws the iterations that wait for their block."""
        if self._pending and self._file is not None:
            pending, self._pending = self._pending, []
            self._file.send(self._drawing.draw(pending))

    def flush(self) -> None:
        """Waits until all that was drawn is in the file, for whoever opens it unfinished."""
        if self._file is not None:
            self._file.flush()

    def on_finish(self, state: RunState) -> None:
        """Completes the file and gives it its name."""
        self.close()

    def close(self) -> None:
        """Completes the file with what there is; for a run that is left before its end. Later calls do nothing.

        Raises:
            InputError: it could not be written.
        """
        if self._file is None:
            return
        self.draw_now()
        file, self._file = self._file, None
        try:
            file.close(blueprint_messages(self._layout, self._verifier_of is not None))
        finally:
            self._journal.close()
        name_finished(self._path)

    def _pictures(self, verifier: Verifier, iteration: Iteration) -> Iterator[Iterable[Piece]]:
        """The maps of an iteration, and of the scene where it closes a pass."""
        placed = self._placed(iteration.placed) if self._session.method.occluders == "placed" else ()
        if self._maps is None or self._maps[:2] != (iteration.instance_id, verifier):
            maps = Maps([self._targets[iteration.instance_id]], verifier)
            self._maps = (iteration.instance_id, verifier, maps)
            yield [maps.observed(iteration.index)]
        yield self._maps[2].pair(iteration, placed)
        scene = iteration.scene
        if scene is not None:
            targets = [self._targets[p.instance_id] for p in scene.poses]
            own = {p.instance_id for p in scene.poses}
            others = [p for p in placed if p.instance_id not in own]
            maps = Maps(targets, verifier, SCENE_TILE_PX)
            yield maps.scene(iteration.index, np.array([p.T_cam_obj for p in scene.poses]), others)

    def _placed(self, poses: Sequence[PlacedPose]) -> list[Placed]:
        return [Placed(p.instance_id, self._targets[p.instance_id].model, p.T_cam_obj) for p in poses]


def properties(session: Session, problem: Problem, layout: Layout) -> dict[str, Any]:
    """Everything that is needed to run it again, and who made it."""
    settings = session.model_dump_json()
    return {
        "schema": SCHEMA,
        "title": session.title or problem.title,
        "frame": problem.frame,
        "method": session.method.name,
        "seed": session.method.seed,
        "settings": settings,
        "session": _toml(settings),
        "layout": layout.to_json(),
        "versions": json.dumps(versions()),
    }


@lru_cache(maxsize=8)
def _toml(settings: str) -> str:
    """A session as a file; made once for all frames of a batch."""
    return session_toml(Session.model_validate_json(settings))


@cache
def versions() -> dict[str, str]:
    """Python and the packages whose numbers enter a run."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found
