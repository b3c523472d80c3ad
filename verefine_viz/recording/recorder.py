"""Writes every iteration of a run to a rerun recording; a watcher, so it can change nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.protocols import Refiner, RunState, Verifier
from verefine_viz.core.records import Best, Iteration, PlacedPose
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.settings import EQ_1, Session
from verefine_viz.core.writing import make_inside
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.landscape import landscape
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.recording import entities
from verefine_viz.recording.background import log_background
from verefine_viz.recording.drawn_iterations import Drawing
from verefine_viz.recording.entities import branch
from verefine_viz.recording.film_tab import log_film
from verefine_viz.recording.graphs import log_dependencies
from verefine_viz.recording.grasps import log_grasps
from verefine_viz.recording.landscapes import log_landscape
from verefine_viz.recording.layout import layout_of
from verefine_viz.recording.maps import SCENE_TILE_PX, LoggedMaps, PendingMaps, log_colors, send_refiner_steps
from verefine_viz.recording.photo_contours import Contours
from verefine_viz.recording.recording_file import RecordingFile
from verefine_viz.recording.views import blueprint_of
from verefine_viz.run.record import Answer, RunHeader, RunRecord
from verefine_viz.run.run_file import decoded
from verefine_viz.run.run_header import NO_WEIGHTS, header_of

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import AnswerGrasps
    from verefine_viz.pictures.film import Film

BLOCK = 200
"""Iterations that are drawn together; the run file has each of them before."""
BLOCK_WITH_MAPS = 25
"""Iterations of a block with score maps, which are large: what lies before it in a truncated file is saved."""


class Recorder:
    """Draws one run into the recording ``path``, block by block, while it runs.

    The rerun viewer opens the file at any time, up to the last block. What is written for good is the run file
    (``run/run_file.py``), which goes into the recording last.
    """

    def __init__(
        self,
        path: Path,
        session: Session,
        problem: Problem,
        verifier_of: Callable[[int], Verifier] | None = None,
        block: int = BLOCK,
        refiner_of: Callable[[int], Refiner | None] | None = None,
        grasps_of: Callable[[RunState], AnswerGrasps | None] | None = None,
        weights: Mapping[str, str] = NO_WEIGHTS,
        films_of: Callable[[RunRecord], Mapping[int, Film]] | None = None,
    ) -> None:
        """Nothing is written before :meth:`on_start`.

        Args:
            path: the recording, ``….rrd``; its folder is made if needed.
            session: what is being run; written into the recording.
            problem: the frame.
            verifier_of: what scored iteration k, to make its score maps; None = no maps, whatever the session says. A
                verifier of another program has none.
            block: iterations drawn together, with score maps at most 25.
            refiner_of: what refined in iteration k, to draw beside the maps what a learned one saw; None = not drawn.
            grasps_of: what became of the answers of a finished run in the gripper; None = not drawn.
            weights: hashes of the run's weights, for the header, as in ``RunFile``.
            films_of: the key moments of a finished run, by instance, drawn where there are maps; None = not drawn.
        """
        self._path = path
        self._session, self._weights = session, weights
        self._problem = problem
        self._verifier_of = verifier_of if session.recording.maps and session.score.verifier == EQ_1 else None
        self._refiner_of = refiner_of
        self._grasps_of, self._films_of = grasps_of, films_of if self._verifier_of is not None else None
        self._has_grasps = False
        self._block = block if self._verifier_of is None else min(block, BLOCK_WITH_MAPS)
        self._file: RecordingFile | None = None
        self._pending: list[Iteration] = []
        self._pending_errors: list[Float] = []
        self._pending_maps = PendingMaps()
        self._n_drawn = 0
        self._maps: tuple[int, Verifier, LoggedMaps] | None = None
        self._errors = _GroundTruthErrors()
        self.allowed: dict[int, AllowedPoses] = {}
        """What the image allows beside the answers, by instance, as soon as it is recorded."""
        self._iterations: list[Iteration] = []

    def on_start(self, state: RunState) -> None:
        """Opens the file and logs the frame, the hypotheses and their scores.

        Raises:
            InputError: the file cannot be written.
        """
        # A method may add hypotheses of its own to the problem it was given.
        self._problem = state.problem
        header = header_of(self._problem, state, self._session, self._weights)
        self._layout = layout_of(self._problem, header, self._session)
        self._targets = {t.instance.instance_id: t for t in self._problem.targets}
        self._drawing = Drawing(self._layout, self._targets, self._session.method.refiner)
        self._contours = Contours(self._layout, self._targets)
        has_maps = self._verifier_of is not None
        make_inside(self._path.parent)
        method = self._session.method
        file = self._file = RecordingFile(self._path, _recording_id(header, self._session))
        about = {"title": header.title, "frame": header.frame, "method": method.name, "seed": str(method.seed)}
        about |= {"session": header.session, "versions": json.dumps(header.versions)}
        file.send_properties(about, f"{header.title} {header.frame} {method.name}".strip())
        self._drawing.start(file)
        if self._problem.dependencies is not None and self._layout.is_scene:
            log_dependencies(file, self._problem.dependencies, self._layout)
        log_background(file, self._problem, self._layout, pictures=has_maps)
        if has_maps:
            log_colors(file, self._has_colour)
            self._contours.start(file)
        file.flush()

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        """Draws one iteration, or has it wait for its block.

        Raises:
            InputError: the file cannot be written any more.
        """
        assert self._file is not None, "on_start comes first"
        self._pending.append(iteration)
        self._iterations.append(iteration)
        self._pending_errors.append(self._errors.errors(self._targets[iteration.instance_id], iteration))
        if self._verifier_of is not None:
            self._add_maps(self._file, self._verifier_of(iteration.index), iteration)
            self._contours.add(iteration)
        if len(self._pending) >= self._block:
            self._draw(self._file)
            self._file.flush()

    def on_finish(self, state: RunState) -> None:
        """Hides the hypotheses; adds the score around the answers where score maps are recorded, and their grasps."""
        if self._file is not None:
            for branch_of in self._layout.branches:
                end = self._n_drawn + len(self._pending)
                self._file.log_at(
                    entities.TIMELINE, end, entities.hypotheses(branch_of.name), rr.Clear(recursive=False)
                )
        if self._file is not None and self._verifier_of is not None:
            verifier = self._verifier_of(self._n_drawn + len(self._pending))
            for target, best in zip(state.problem.targets, state.best, strict=True):
                if best is not None:
                    allowed = allowed_poses(verifier, target, best.T_cam_obj, (), self._iterations)
                    self.allowed[target.instance.instance_id] = allowed
                    around = landscape(verifier, target, allowed)
                    log_landscape(self._file, branch(target.instance, self._problem), around)
        grasps = self._grasps_of(state) if self._file is not None and self._grasps_of is not None else None
        if self._file is not None and grasps is not None and grasps.pairs:
            self._has_grasps = True
            log_grasps(self._file, self._problem, self._layout, grasps, self._session.grasp.opening_m)

    def close(self, run: bytes = b"") -> None:
        """Completes the file with what there is, also of a run that was left before its end. Later calls do nothing.

        Args:
            run: the content of the run file, which goes into the recording.

        Raises:
            InputError: it could not be written.
        """
        if self._file is None:
            return
        file, self._file = self._file, None
        self._draw(file)
        n_moments: dict[str, int] = {}
        if run:
            file.log_bytes(entities.RUN_FILE, run)
            record = decoded(run, f"run of {self._path}", with_iterations=self._films_of is not None)
            if record.end is not None:
                file.send_properties(_outcome(record.end.answers))
            films = self._films_of(record) if self._films_of is not None else {}
            for instance_id, film in films.items():
                name = self._layout.branch(instance_id).name
                log_film(file, name, film)
                n_moments[name] = len(film.moments)
        has_maps = self._verifier_of is not None
        drawn = blueprint_of(self._layout, has_maps, self._has_colour, self._has_refiner, self._has_grasps, n_moments)
        file.send_blueprint(drawn)
        file.close()

    @property
    def _has_colour(self) -> bool:
        """Whether the colour term counts when the recording begins."""
        return self._verifier_of is not None and self._session.score.colour_weight > 0

    @property
    def _has_refiner(self) -> bool:
        """Whether the refiner is a learned one when the recording begins."""
        return self._refiner_of is not None and isinstance(self._refiner_of(1), LearnedRefiner)

    def _draw(self, file: RecordingFile) -> None:
        """Draws the iterations that wait for their block."""
        if self._pending:
            self._drawing.draw(file, self._pending, np.array(self._pending_errors))
            self._pending_maps.send(file)
            self._contours.send(file)
            self._n_drawn += len(self._pending)
            self._pending, self._pending_errors = [], []

    def _add_maps(self, file: RecordingFile, verifier: Verifier, iteration: Iteration) -> None:
        """The maps of an iteration, and of the scene where it closes a pass."""
        placed = self._placed(iteration.placed) if self._session.method.occluders == "placed" else ()
        if self._maps is None or self._maps[:2] != (iteration.instance_id, verifier):
            maps = LoggedMaps([self._targets[iteration.instance_id]], verifier)
            self._maps = (iteration.instance_id, verifier, maps)
            maps.send_observed(file, iteration.index)
        self._maps[2].add_pair(self._pending_maps, iteration, placed)
        refiner = self._refiner_of(iteration.index) if self._refiner_of is not None else None
        if isinstance(refiner, LearnedRefiner):
            send_refiner_steps(file, refiner, self._targets[iteration.instance_id], iteration)
        scene = iteration.scene
        if scene is not None:
            targets = [self._targets[p.instance_id] for p in scene.poses]
            own = {p.instance_id for p in scene.poses}
            others = [p for p in placed if p.instance_id not in own]
            maps = LoggedMaps(targets, verifier, SCENE_TILE_PX)
            maps.add_scene(self._pending_maps, iteration.index, np.array([p.T_cam_obj for p in scene.poses]), others)

    def _placed(self, poses: Sequence[PlacedPose]) -> list[Placed]:
        return [Placed(p.instance_id, self._targets[p.instance_id].model, p.T_cam_obj) for p in poses]


def _recording_id(header: RunHeader, session: Session) -> str:
    """``mug/50/1/rir/seed 0``: session, scene, image, method; runs of other seeds are other recordings."""
    return f"{header.title}/{header.frame}/{session.method.name}/seed {session.method.seed}"


def _outcome(answers: Sequence[Answer]) -> dict[str, Sequence[str] | Sequence[float]]:
    """What came of the objects, in their order, for lists of recordings; NaN and empty = unknown."""
    return {
        "object": [str(one.instance_id) if one.instance_id is not None else "" for one in answers],
        "status": [one.status for one in answers],
        "score": [math.nan if one.score is None else one.score for one in answers],
        "add_s_mm": [math.nan if one.add_s_mm is None else one.add_s_mm for one in answers],
        "cause": [one.cause for one in answers],
    }


class _GroundTruthErrors:
    """Errors of iterations, one after another; remembers those of each object's best pose, which seldom changes."""

    def __init__(self) -> None:
        self._best: dict[int, tuple[Best, float]] = {}

    def errors(self, target: Target, iteration: Iteration) -> Float:
        """(3,) as ``Block`` takes them. ADD(-S) goes over all points, so only when the best pose changed."""
        T_gt = target.instance.T_cam_obj_gt
        if T_gt is None:
            return _UNKNOWN
        best, T_accepted = iteration.best, iteration.accepted_stage.T_cam_obj
        known, best_mm = self._best.get(iteration.instance_id, (None, 0.0))
        if known is not best:
            best_mm = add_s_mm(target.model, best.T_cam_obj, T_gt)
            self._best[iteration.instance_id] = best, best_mm
        rotation_deg, translation_m = _turn_and_shift(T_accepted, T_gt, target.model.symmetries)
        return np.array([rotation_deg, 1e3 * translation_m, best_mm])


_UNKNOWN = np.full(3, np.nan)


@kernel()
def _turn_and_shift(T_est: Float, T_gt: Float, symmetries: Float) -> tuple[float, float]:
    """Angle to the nearest of the poses that look the same [deg], from the traces alone (to 1e-5°, enough for a curve),
    and distance of the origins.
    """
    largest = -1.0
    for S in symmetries:
        trace = 0.0
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    trace += T_est[k, i] * T_gt[k, j] * S[j, i]
        largest = max(largest, (trace - 1.0) / 2.0)
    square = 0.0
    for k in range(3):
        square += (T_est[k, 3] - T_gt[k, 3]) ** 2
    return math.degrees(math.acos(min(1.0, largest))), math.sqrt(square)
