"""Writes every iteration of a run to a rerun recording; a watcher, so it can change nothing."""

from __future__ import annotations

import json
import math
import platform
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.protocols import RunState, Verifier
from verefine_viz.core.records import Best, Iteration
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.errors import pose_errors
from verefine_viz.recording import entities
from verefine_viz.recording.background import log_background
from verefine_viz.recording.blueprint import make_blueprint
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.journal import Journal
from verefine_viz.recording.layout import Layout, layout_of
from verefine_viz.recording.maps import Maps
from verefine_viz.recording.row import Row, row_of
from verefine_viz.session.files import session_toml

SCHEMA = 1
"""Of the recording; a reader refuses a later one."""
BLOCK = 50
"""Iterations that are handed to rerun together; the journal holds them until then."""
PACKAGES = ("verefine-viz", "numpy", "numba", "scipy", "pybullet", "open3d", "coacd", "trimesh", "rerun-sdk")


def part_path(path: Path) -> Path:
    """Where a recording lies while it is written."""
    return path.with_name(path.name + ".part")


def journal_path(path: Path) -> Path:
    """The journal beside a recording that is being written."""
    return path.with_name(path.name + ".journal")


class Recorder:
    """Records one run to ``path``.

    The file is ``path`` + ``.part`` until the run is over. When :meth:`on_iteration` returns, the iteration is on disk
    and survives the end of the process. Belongs to the thread of the run (rerun's time is per thread).
    """

    def __init__(
        self,
        path: Path,
        session: Session,
        problem: Problem,
        verifier: Verifier | None = None,
        live_port: int | None = None,
        block: int = BLOCK,
    ) -> None:
        """Nothing is written before :meth:`on_start`.

        Args:
            path: the recording, ``….rrd``; its folder is made if needed.
            session: what is being run; written into the recording.
            problem: the frame.
            verifier: makes the score maps; None = no maps, whatever the session says.
            live_port: also serve the recording to rerun viewers on this port of 127.0.0.1.
            block: iterations drawn together; with a live viewer every iteration is drawn at once.
        """
        self._path = path
        self._session = session
        self._problem = problem
        self._verifier = verifier if session.recording.maps else None
        self._live_port = live_port
        self._block = 1 if live_port is not None else block
        self._rec: rr.RecordingStream | None = None
        self._pending: list[Row] = []
        self._maps: tuple[int, Maps] | None = None
        self._best_error: tuple[Best | None, float] = (None, float("nan"))

    def on_start(self, state: RunState) -> None:
        """Opens the file and logs the frame, the hypotheses and their scores.

        Raises:
            InputError: the file cannot be written.
        """
        layout = layout_of(self._problem, state)
        self._targets = {t.instance.instance_id: t for t in self._problem.targets}
        self._drawing = Drawing(layout)
        rec = rr.RecordingStream(entities.APPLICATION, send_properties=True)
        rec.set_log_time_enabled(False)
        self._open(rec)
        log_properties(rec, self._session, self._problem, layout)
        rec.flush()
        self._rec = rec
        # What makes the iterations readable is on disk; the pictures of the frame get there while the run goes on.
        pool = ThreadPoolExecutor(1, "recording")
        self._opening = pool.submit(self._log_frame, rec, layout)
        pool.shutdown(wait=self._live_port is not None)

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        """Writes one iteration; it is on disk when this returns."""
        assert self._rec is not None, "on_start comes first"
        row = row_of(iteration, self._errors(self._targets[iteration.instance_id], iteration))
        self._journal.append(row)
        self._pending.append(row)
        if self._verifier is not None:
            self._log_maps(self._rec, self._verifier, row)
        if len(self._pending) >= self._block:
            self.draw_now()
        if self._verifier is not None:
            self._rec.flush()

    def draw_now(self) -> None:
        """Hands the iterations that wait for their block to rerun, for whoever opens the unfinished file."""
        if self._rec is not None and self._pending:
            self._opening.result()
            self._drawing.draw(self._rec, self._pending)
            self._pending = []
            self._rec.flush()

    def on_finish(self, state: RunState) -> None:
        """Completes the file and gives it its name."""
        self.close()

    def close(self) -> None:
        """Completes the file with what there is; for a run that is left before its end. Later calls do nothing."""
        if self._rec is None:
            return
        self._opening.result()
        self.draw_now()
        rec, self._rec = self._rec, None
        rec.disconnect()
        part_path(self._path).replace(self._path)
        self._journal.remove()

    def _open(self, rec: rr.RecordingStream) -> None:
        part = part_path(self._path)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._journal = Journal(journal_path(self._path))
            if self._live_port is None:
                rec.save(part)
            else:
                live = rr.GrpcServerSink(bind_ip="127.0.0.1", port=self._live_port)
                rec.set_sinks(rr.FileSink(part), live)
        except (OSError, RuntimeError) as error:
            raise InputError(f"cannot write the recording {self._path}: {error}") from None

    def _log_frame(self, rec: rr.RecordingStream, layout: Layout) -> None:
        """Everything that is known before the first iteration, all of it outside time, which rerun has per thread."""
        rec.send_blueprint(make_blueprint(layout, has_maps=self._verifier is not None), make_active=False)
        self._drawing.start(rec)
        log_background(rec, self._problem)
        # Otherwise rerun would wait with the compression until the run's own data come.
        rec.flush()

    def _log_maps(self, rec: rr.RecordingStream, verifier: Verifier, row: Row) -> None:
        rec.set_time(entities.TIMELINE, sequence=row.index)
        if self._maps is None or self._maps[0] != row.instance_id:
            maps = Maps(self._targets[row.instance_id], verifier, self._session.score.tau_m)
            maps.log_observed(rec)
            self._maps = (row.instance_id, maps)
        self._maps[1].log(rec, row)

    def _errors(self, target: Target, iteration: Iteration) -> Float:
        """What ``Row.errors`` says. ADD(-S) needs a search over all points, so only when the best pose changed."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return np.full(3, np.nan)
        best, T_kept = iteration.best, iteration.accepted_stage.T_cam_obj
        if self._best_error[0] is not best:
            self._best_error = (best, _add_s_mm(target.model, best.T_cam_obj, T_gt))
        translation_mm = 1e3 * math.dist(T_kept[:3, 3].tolist(), T_gt[:3, 3].tolist())
        return np.array([_rotation_deg(target.model, T_kept, T_gt), translation_mm, self._best_error[1]])


def log_properties(rec: rr.RecordingStream, session: Session, problem: Problem, layout: Layout) -> None:
    """Everything that is needed to run it again, and who made it."""
    title = session.title or problem.title
    rec.send_recording_name(f"{title} {problem.frame} {session.method.name}".strip())
    properties = rr.AnyValues(
        schema=SCHEMA,
        title=title,
        frame=problem.frame,
        method=session.method.name,
        seed=session.method.seed,
        settings=session.model_dump_json(),
        session=session_toml(session),
        layout=layout.to_json(),
        versions=json.dumps(versions()),
    )
    rec.send_property(entities.PROPERTY, properties)


def _rotation_deg(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """As ``rotation_error_deg``, from the traces alone: to 1e-5°, which is enough for a curve."""
    traces = np.einsum("kij,ij->k", model.symmetries[:, :3, :3], (T_gt[:3, :3].T @ T_est[:3, :3]).T)
    return math.degrees(math.acos(min(1.0, max(-1.0, (float(traces.max()) - 1) / 2))))


def _add_s_mm(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """As :func:`pose_errors` has it, without its search for nearest points where the object is not symmetric."""
    if model.is_symmetric:
        return pose_errors(model, T_est, T_gt).add_s_mm
    apart = apply(T_est - T_gt, model.points)
    return 1e3 * float(np.sqrt(np.einsum("ij,ij->i", apart, apart)).mean())


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
