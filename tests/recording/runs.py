"""Recorded runs of made-up problems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.camera import Camera
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.protocols import Watcher
from verefine_viz.core.settings import MethodSettings, RecordingSettings, Session
from verefine_viz.methods.registry import make_method
from verefine_viz.recording.entities import LANE
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.run.engine import Run
from verefine_viz.run.record import Answer, RunEnd
from verefine_viz.run.run_file import SUFFIX, RunFile


def session(name: str = "rir", iterations: int = 5, maps: bool = True) -> Session:
    return Session(
        title="boxes",
        method=MethodSettings(name=name, iterations=iterations),
        recording=RecordingSettings(maps=maps),
    )


def new_run(s: Session, problem: Problem, watchers: tuple[Watcher[Any], ...] = ()) -> Run:
    method = make_method(s.method, FakeSimulator(), FakeRefiner(), FakeVerifier(), s.physics.steps)
    return Run(method, problem, watchers)


def ending(run: Run) -> RunEnd:
    """The end of a run, with an answer to stand for all."""
    return RunEnd(answers=(Answer(frame=run.problem.frame, status="ok", n_iterations=run.length),))


def recorded_run(path: Path, s: Session | None = None, problem: Problem | None = None, block: int = 25) -> Run:
    """A finished run, recorded to ``path``; maps only where the session has them."""
    s = s or session()
    problem = problem or box_problem(3, 2)
    recorder = Recorder(path, s, problem, lambda _: FakeVerifier(), block=block)
    file = RunFile(path.with_suffix(SUFFIX), s)
    run = new_run(s, problem, (file, recorder))
    run.finish()
    file.finish(ending(run))
    recorder.close(file.path.read_bytes())
    file.path.unlink()
    return run


def run_file(path: Path, s: Session, problem: Problem | None = None) -> Run:
    """A finished run, written as a run file."""
    file = RunFile(path, s)
    run = new_run(s, problem or box_problem(3, 2), (file,))
    run.finish()
    file.finish(ending(run))
    return run


def n_drawn(path: Path) -> int:
    """How many iterations a recording shows."""
    return sum(chunk.num_rows for chunk in chunks_of(path) if chunk.entity_path == LANE and not chunk.is_static)


def enlarged(problem: Problem, factor: int = 8) -> Problem:
    """The same scene through a camera of ``factor`` times the pixels, with sensor noise."""
    o = problem.observation
    rng = np.random.default_rng(0)

    def large(image: np.ndarray) -> np.ndarray:
        return image.repeat(factor, axis=0).repeat(factor, axis=1)

    K = o.camera.K.copy()
    K[:2] *= factor
    K[:2, 2] += (factor - 1) / 2
    camera = Camera(K, o.camera.width * factor, o.camera.height * factor)
    depth = large(o.depth_m)
    depth = np.where(depth > 0, depth + rng.normal(0, 0.002, depth.shape), 0).astype(np.float32)
    assert o.rgb is not None
    rgb = rng.integers(0, 255, (*depth.shape, 3), dtype=np.uint8)
    large_observation = Observation(camera, depth, large(o.normals_cam), rgb, large(o.object_mask), o.support)
    instances = tuple(
        Instance(i.instance_id, i.obj_id, large(i.mask), i.points_cam, i.hypotheses, i.T_cam_obj_gt, i.visib_fract)
        for i in problem.instances
    )
    return Problem(problem.scene_id, problem.im_id, large_observation, problem.models, instances, problem.title)
