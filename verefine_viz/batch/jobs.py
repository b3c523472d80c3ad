"""The runs of one ``batch`` command: several sessions, or every method with every seed of each; a folder for each."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from verefine_viz.batch.folder import SESSION_FILE, RunFolder
from verefine_viz.batch.session_check import check
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_no_link
from verefine_viz.methods.known_methods import METHODS
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.session_file import changed, load_session


@dataclass(frozen=True)
class BatchJob:
    """One run: a session, and the folder that its results go to."""

    session: Session
    folder: Path
    group: str
    """A name shared by runs that differ in their seeds only: the method, after the session where there are several."""


def session_jobs(paths: Sequence[Path | None], out: Path, overrides: Mapping[str, Any]) -> list[BatchJob]:
    """A run for each session: in ``out`` itself for one, in ``out/NAME`` for several.

    Args:
        paths: session files; None = a session made of ``overrides`` alone, as for a built-in scene.
        out: folder of the results.
        overrides: settings of the command line.

    Raises:
        VerefineError: a session cannot be used, two would write to the same folder, or ``out`` lies among a session's
            images.
    """
    names = _stems(paths, out)
    jobs = [
        BatchJob(_session(path, overrides), out / name if len(paths) > 1 else out, name)
        for path, name in zip(paths, names, strict=True)
    ]
    for job in jobs:
        check_outside(out, job.session)
        if job.folder != out:
            check_no_link(job.folder)
    return jobs


def sweep_jobs(
    paths: Sequence[Path | None], out: Path, overrides: Mapping[str, Any], methods: Sequence[str], n_seeds: int | None
) -> list[BatchJob]:
    """A run for each method and seed of each session, in ``out/METHOD-SEED``, after the session's name if there are
    several. All methods with the first seed come first, so that they can be compared early.

    Args:
        paths: session files.
        out: the folder of all runs.
        overrides: settings of the command line, for all sessions.
        methods: names; none = each session's own.
        n_seeds: how many seeds, from 0, of initial poses and method alike; None = each session's own seed.

    Raises:
        VerefineError: a session cannot be used, a name is unknown or comes twice, ``out`` holds a run itself, or lies
            among a session's images.
    """
    _check_sweep(out, overrides, methods, n_seeds)
    stems = _stems(paths, out)
    sessions = [_session(path, overrides) for path in paths]
    for session in sessions:
        check_outside(out, session)
    jobs: list[BatchJob] = []
    for seed in (None,) if n_seeds is None else range(n_seeds):
        for stem, session in zip(stems, sessions, strict=True):
            for method in methods or (session.method.name,):
                group = f"{stem}-{method}" if len(paths) > 1 else method
                name = group if seed is None else f"{group}-{seed}"
                check_no_link(out / name)
                jobs.append(BatchJob(_with(session, method, seed), out / name, group))
    return jobs


def _session(path: Path | None, overrides: Mapping[str, Any]) -> Session:
    return load_session(None, overrides) if path is None else open_session(path, overrides, partial(say, to=sys.stderr))


def check_jobs(jobs: Sequence[BatchJob]) -> int:
    """Check all sessions and folders first, so that a mistake in the last of many runs does not show after hours.

    Returns:
        How many frames all runs have together.

    Raises:
        VerefineError: a session cannot be used, or a folder holds another run.
    """
    n_frames: dict[str, int] = {}
    for job in jobs:
        # Runs of a group differ in their seeds only, which cannot be wrong.
        if job.group not in n_frames:
            n_frames[job.group] = len(check(job.session)[0])
        if (job.folder / SESSION_FILE).exists():
            with closing(RunFolder(job.folder, job.session)):
                pass
    return sum(n_frames[job.group] for job in jobs)


def check_outside(out: Path, session: Session) -> None:
    """Refuse results in the data set's split, where other programs look for scenes and images.

    Raises:
        SettingsError: ``out`` lies in the split that the session reads.
    """
    if session.scene.source != "bop" or Path(session.scene.split).name != session.scene.split:
        return
    split = Path(session.scene.dataset) / session.scene.split
    if out.resolve().is_relative_to(split.resolve()):
        raise SettingsError(f"--out {out} lies among the images of the data set, in {split}; choose another --out")


def _check_sweep(out: Path, overrides: Mapping[str, Any], methods: Sequence[str], n_seeds: int | None) -> None:
    for name in methods:
        if "," in name:
            apart = " ".join(name.replace(",", " ").split())
            raise SettingsError(f"--methods {name}: separate the names by blanks, --methods {apart}")
        if name not in METHODS:
            raise SettingsError(unknown("method", name, tuple(METHODS)))
        if methods.count(name) > 1:
            raise SettingsError(f"--methods names {name!r} twice; name each method once")
    doubled = [("--methods", "method", "name")] if methods else []
    doubled += [("--seeds", "method", "seed"), ("--seeds", "hypotheses", "seed")] if n_seeds is not None else []
    for option, section, name in doubled:
        if name in overrides.get(section, {}):
            field = f"--{section}.{name}"
            raise SettingsError(f"{field} and {option} contradict each other; leave {field} out")
    if (out / SESSION_FILE).exists():
        raise SettingsError(f"{out} holds a single run; choose another --out for the runs of --methods and --seeds")


def _with(session: Session, method: str, seed: int | None) -> Session:
    settings: dict[str, dict[str, Any]] = {"method": {"name": method}}
    if seed is not None:
        settings["method"]["seed"] = seed
        settings["hypotheses"] = {"seed": seed}
    return changed(session, settings, ("method", "hypotheses"))


def _stems(paths: Sequence[Path | None], out: Path) -> list[str]:
    stems = [out.name if path is None else path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise SettingsError(f"two sessions are called {stem!r} and would share {out / stem}; rename one")
    return stems
