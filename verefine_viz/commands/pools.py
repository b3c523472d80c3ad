"""What ``verefine-viz estimate`` does: run a session's estimator over its frames and write what it finds."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DependencySettings, Session
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.scenes.results import ResultRow, write_results
from verefine_viz.session.files import load_session
from verefine_viz.session.toolbox import Toolbox


@dataclass
class Pools:
    """What was found so far."""

    rows: list[ResultRow] = field(default_factory=list)
    n_frames: int = 0
    n_objects: int = 0
    without: list[str] = field(default_factory=list)
    """A line for each object for which nothing was found."""
    failed: list[str] = field(default_factory=list)
    """A line for each frame that failed."""

    def add(self, problem: Problem, seconds: float) -> None:
        """Takes the hypotheses of a frame."""
        self.n_objects += len(problem.instances)
        for instance in problem.instances:
            if not instance.hypotheses:
                name = problem.models[instance.obj_id].name
                self.without.append(f"frame {problem.frame}: no hypothesis for {name} (#{instance.instance_id})")
            self.rows += [
                ResultRow(problem.scene_id, problem.im_id, instance.obj_id, h.confidence, h.T_cam_obj, seconds)
                for h in instance.hypotheses
            ]


def write_pools(path: Path, out: Path, overrides: Mapping[str, Any]) -> int:
    """Estimates every frame of the session at ``path`` into the results file ``out``; the exit code.

    Frames that fail are listed and make it 1; the others are written. Where nothing was found in any frame there is
    nothing to write.

    Raises:
        VerefineError: the session or ``out`` cannot be used.
    """
    session = _only_estimating(load_session(path, overrides))
    if session.hypotheses.source not in ESTIMATORS:
        raise SettingsError(
            f"hypotheses.source is {session.hypotheses.source!r}, expected an estimator ({', '.join(ESTIMATORS)}); "
            "say --hypotheses.source ppf"
        )
    _check(out)
    started = time.perf_counter()
    pools = _estimated(session, out.name)
    if pools.rows:
        write_results(out, pools.rows)
    _print_summary(pools, out, time.perf_counter() - started)
    return 1 if pools.failed or not pools.rows else 0


def _only_estimating(session: Session) -> Session:
    """The same without what estimators do not need, and what could therefore only fail: simulator and given order."""
    physics = session.physics.model_copy(update={"enabled": False})
    return session.model_copy(update={"physics": physics, "dependency": DependencySettings()})


def _check(out: Path) -> None:
    """Makes the folder of ``out``, so that a mistake shows before the work and not after it."""
    if out.is_dir():
        raise InputError(f"{out} is a folder, expected the name of a results file, for example {out / 'pool.csv'}")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror}") from None


def _estimated(session: Session, title: str) -> Pools:
    errors = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeRemainingColumn(),
    )
    pools = Pools()
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        task = bar.add_task(escape(title), total=None, note="starting")
        toolbox = Toolbox(session, lambda doing: bar.update(task, note=escape(doing)))
        frames = toolbox.frames
        bar.update(task, total=len(frames))
        for frame in frames:
            started = time.perf_counter()
            try:
                problem = toolbox.problem(frame)
                pools.add(problem, round(time.perf_counter() - started, 3))
            except VerefineError as error:
                pools.failed.append(f"frame {frame} failed: {error}")
            except Exception as error:  # One frame must not cost the work of all others.
                pools.failed.append(f"frame {frame} failed: {type(error).__name__}: {error}")
            pools.n_frames += 1
            bar.update(task, completed=pools.n_frames)
    return pools


def _print_summary(pools: Pools, out: Path, seconds: float) -> None:
    console = Console(highlight=False, soft_wrap=True)
    counts = f"{pools.n_frames} frames, {pools.n_objects} objects, {len(pools.rows)} hypotheses; {seconds:.1f} s."
    where = f"Results in {out}" if pools.rows else f"Nothing was found, so {out} was not written"
    console.print(escape(f"{counts} {where}"))
    for line in (*pools.without, *pools.failed):
        console.print(escape(" ".join(line.split())))
