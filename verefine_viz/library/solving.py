"""Runs of a method on a frame: all at once, or iteration by iteration."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from verefine_viz.batch.summary import run_end
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.arguments import checked_mapping, checked_path, checked_text
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import check_no_link
from verefine_viz.diagnosis.diagnose import Diagnosis, diagnose
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.library.frame_to_solve import AnyFrame, Frame, check_frame, target_of
from verefine_viz.run.record import Answer, RunEnd, RunRecord
from verefine_viz.run.run_file import SUFFIX, write_record
from verefine_viz.run.session_parts import weights_of
from verefine_viz.scenes.trace_files import is_trace

Section = Mapping[str, Any]


class Run:
    """A run of a method on a frame; :func:`solve` and :func:`step` make them.

    Iterating over it makes its iterations, one after the other; ``run["mug"]`` is the answer about an object.
    """

    def __init__(self, frame: AnyFrame, sections: Mapping[str, Any]) -> None:
        check_frame(frame)
        self.frame = frame
        self._tools, self._id = frame.tools(sections)
        self._run = self._tools.run(self._tools.problem(self._id))

    @property
    def session(self) -> Session:
        """The settings that define the run, each explicit."""
        return self._tools.session

    def __iter__(self) -> Iterator[Iteration]:
        """The iterations, those that were made and then the next ones; :class:`~verefine_viz.core.records.Iteration`
        has the pose and the score of each stage, and what was accepted.
        """
        k = 0
        while k < self._run.length or not self._run.is_done:
            self._run.seek(k)
            yield self._run.step()
            k += 1

    def finish(self) -> Run:
        """Make all iterations that are left; returns the run itself."""
        self._run.finish()
        return self

    @property
    def is_done(self) -> bool:
        """Whether no iteration is left."""
        return self._run.is_done

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """The iterations made so far."""
        return self._run.iterations

    @property
    def answers(self) -> tuple[Answer, ...]:
        """The answer about each object of the frame, those that could not be solved last; finishes the run."""
        return self._end.answers

    def __getitem__(self, name: str | int) -> Answer:
        """The answer about an object: ``T_cam_obj`` (4, 4) [m], ``score`` in [0, 1], errors where ground truth is
        known, ``undetermined_mm`` and ``undetermined_deg``; finishes the run.

        Args:
            name: the object's name, or its instance_id where several have one name.

        Raises:
            InputError: the frame has no such object, or several.
        """
        own = target_of(self._run.problem, name).instance.instance_id
        return next(answer for answer in self.answers if answer.instance_id == own)

    def allowed(self, name: str | int) -> AllowedPoses:
        """The poses that the image allows beside the answer about an object: intervals of shifts and turns
        (``extents``), poses elsewhere that fit as well (``alike``); finishes the run.

        Args:
            name: as in ``run[name]``.

        Raises:
            InputError: the frame has no such object, or several, or it has no answer.
        """
        target = target_of(self._run.problem, name)
        T_cam_obj = self[name].T_cam_obj
        if T_cam_obj is None:
            raise InputError(f"{target.model.name} has no answer; expected an object that was solved")
        return allowed_poses(self._run.final_verifier, target, np.array(T_cam_obj), (), self._run.iterations)

    def to_frame(self) -> dict[str, list[Any]]:
        """The answers as columns by name, as ``pandas.DataFrame(run.to_frame())`` takes them."""
        names = (*Answer.__struct_fields__, "cause", "evidence")
        return {name: [getattr(one, name) for one in self.answers] for name in names}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frame's data; finishes the run."""
        return self._end.notes

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about the frame's data: what does not fit together, and what would; finishes the run."""
        return (
            texts_of(data_doubts(self._run.problem)) or self._end.doubts
        )  # Those of the camera as well, as on the page.

    def record(self) -> RunRecord:
        """The run so far, as it is written to a file."""
        record = self._run.record(self.session, weights_of(self.session))
        return structs.replace(record, end=self._end) if self._run.is_done else record

    def save(self, path: Path | str) -> Path:
        """Write the run to a file (``.vfrun``), which ``verefine-viz view`` opens.

        A frame of arrays is written beside it as a trace, into a folder that is called as the file with ``-frame``;
        that of an earlier run of the name is replaced, as the file is.

        Args:
            path: the file, as "drop.vfrun".

        Returns:
            The file.

        Raises:
            InputError: the path has another ending, its folder holds something else, or it cannot be written.
        """
        path = checked_path(path, "path", f'the name of a file, as "drop{SUFFIX}"')
        if path.suffix != SUFFIX:
            raise InputError(f"{path} is no name of a run; expected {path.stem}{SUFFIX}")
        record, session = self.record(), self.session
        if isinstance(self.frame, Frame):
            folder = path.with_name(f"{path.stem}-frame")
            check_no_link(folder)
            if folder.exists() and not is_trace(folder):
                raise InputError(f"{folder} holds something else; choose another name for the run")
            shutil.rmtree(folder, ignore_errors=True)
            self.frame.save(folder)
            scene = structs.replace(session.scene, dataset=str(folder.resolve()))
            session = structs.replace(session, scene=scene)
            record = structs.replace(record, header=self._run.record(session, weights_of(session)).header)
        write_record(path, record)
        return path

    def show(self, height: int = 800) -> Any:
        """Show the run on the page, within a notebook; see :func:`~verefine_viz.page.notebook.show`.

        Args:
            height: height of the page in the notebook [px].
        """
        from verefine_viz.page.notebook import show

        return show(self, height)

    def share(self, out: Path | str, maps: Any = "marked", with_scene: bool = True) -> str:
        """Write the run as one HTML file that opens anywhere; see :func:`~verefine_viz.page.share.share`.

        Args:
            out: the HTML file.
            maps: iterations whose score maps are in the file: end, marked or all.
            with_scene: whether the 3D view is in the file.

        Returns:
            What the file shows, and what is not in it.

        Raises:
            VerefineError: the file cannot be written.
        """
        from verefine_viz.page.share import share

        return share(self, out, None, maps, with_scene)

    @cached_property
    def _end(self) -> RunEnd:
        self._run.finish()
        return run_end(self._run, self.session)

    def __repr__(self) -> str:
        method, n = self.session.method.name, self._run.length
        return f"<Run of {method} on {self.frame.name}: {n} of {self._run.n_iterations} iterations>"

    def diagnose(self) -> dict[str | int, Diagnosis]:
        """Why each failed answer failed, by the object's name, or by its instance_id where several have one name.

        It finishes the run and re-runs it without each cause.

        Returns:
            An entry for each object whose ADD(-S) is not below 10 % of its diameter; none without ground truth.
        """
        self._run.finish()
        targets = self._run.problem.targets
        n_of = Counter(target.model.name for target in targets)
        keys = {t.instance.instance_id: t.model.name for t in targets if n_of[t.model.name] == 1}
        return {keys.get(one.instance_id, one.instance_id): one for one in diagnose(self._run, self._tools)}


def step(
    frame: AnyFrame,
    method: str | Mapping[str, Any] = "rir",
    refiner: str = "",
    preset: str = "",
    **sections: Mapping[str, Any],
) -> Run:
    """Begin a run; iterating over it makes its iterations.

    Args:
        frame: what is solved.
        method: refine, pir, sir, rir, vf_breadth, vf_depth, … (an unknown name lists them), or the section of the
            method, as {"name": "rir", "iterations": 10, "seed": 3}.
        refiner: icp, depth_net, …; empty = the default.
        preset: recommended, paper, published; empty = recommended.
        sections: other settings, each section a dict as in a session file: ``score={"tau_m": 0.01}``.

    Returns:
        The run before its first iteration: ``for iteration in vv.step(frame)`` makes them.

    Raises:
        SettingsError: a setting is unknown or out of range.
        InputError: nothing can be solved in the frame.
    """
    given = {"name": method} if isinstance(method, str) else method
    given = {**checked_mapping(given, "method", 'its name, or its section as {"name": "rir", …}')}
    if checked_text(refiner, "refiner", "its name"):
        given["refiner"] = refiner
    checked_text(preset, "preset", "recommended, paper or published")
    return Run(frame, {**({"preset": preset} if preset else {}), **sections, "method": given})


def solve(
    frame: AnyFrame,
    method: str | Mapping[str, Any] = "rir",
    refiner: str = "",
    preset: str = "",
    **sections: Mapping[str, Any],
) -> Run:
    """Run a method on a frame to its end.

    Args:
        frame: what is solved.
        method: refine, pir, sir, rir, vf_breadth, vf_depth, … (an unknown name lists them), or the section of the
            method, as {"name": "rir", "iterations": 10, "seed": 3}.
        refiner: icp, depth_net, …; empty = the default.
        preset: recommended, paper, published; empty = recommended.
        sections: other settings, each section a dict as in a session file: ``score={"tau_m": 0.01}``.

    Returns:
        The finished run: ``run["mug"]`` is the answer about an object.

    Raises:
        SettingsError: a setting is unknown or out of range.
        InputError: nothing can be solved in the frame.
    """
    return step(frame, method, refiner, preset, **sections).finish()
