"""Runs of a method on a frame: solved all at once or iteration by iteration, or opened from a file."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, overload

import msgspec
import numpy as np
from msgspec import structs

from verefine_viz.batch.summary import run_end
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.arguments import checked_mapping, checked_path, checked_text, described
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.errors import ArgumentTypeError, InputError, unknown
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import check_no_link
from verefine_viz.diagnosis.diagnose import Diagnosis, diagnose
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.library.frame_to_solve import AnyFrame, Frame, OpenedFrame, check_frame
from verefine_viz.library.pictures import WIDTH_PX, PicturedAnswer, gallery, pictured
from verefine_viz.library.plugins import with_parts
from verefine_viz.library.tables import table_of
from verefine_viz.pictures.answer_pictures import thumbnail
from verefine_viz.recording.reader import read_recording
from verefine_viz.run.engine import Run as EngineRun
from verefine_viz.run.record import Answer, RunEnd, RunRecord
from verefine_viz.run.record_data import recorded_problem, recorded_run, session_on_its_frame
from verefine_viz.run.run_file import SUFFIX, decoded, encoded, write_record
from verefine_viz.run.session_file import session_toml
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.trace_files import is_trace

if TYPE_CHECKING:
    from typing import Unpack

    from verefine_viz.library.plugins import AnyEstimator, AnyRefiner, AnySimulator, AnyVerifier
    from verefine_viz.library.sections import MethodName, MethodSection, OtherSections

D = TypeVar("D")
Named = tuple[str, int | None]
"""Name and instance_id of an object."""
OF_ITS_FRAME = ("scene", "data", "hypotheses", "ppf", "pcs", "densefusion")
"""Sections that define the frame of a run, and the source of its initial poses."""


class _Solving:
    """A run that is computed here."""

    def __init__(self, frame: AnyFrame, sections: Mapping[str, Any]) -> None:
        check_frame(frame)
        self.frame = frame
        self.tools, own = frame.tools(sections)
        self.engine = self.tools.run(self.tools.problem(own))

    @property
    def session(self) -> Session:
        return self.tools.session

    @property
    def n_made(self) -> int:
        return self.engine.length

    @property
    def n_iterations(self) -> int:
        return self.engine.n_iterations

    @property
    def is_done(self) -> bool:
        return self.engine.is_done

    @property
    def can_go_on(self) -> bool:
        return not self.is_done

    def finish(self) -> None:
        self.engine.finish()

    @property
    def objects(self) -> tuple[Named, ...]:
        problem = self.engine.problem
        solved = [(target.model.name, target.instance.instance_id) for target in problem.targets]
        return (*solved, *((one.name, one.instance_id) for one in problem.left_out))

    @cached_property
    def end(self) -> RunEnd:
        self.engine.finish()
        return run_end(self.engine, self.session)

    @property
    def doubts(self) -> tuple[str, ...]:
        # Doubts about the camera, too, as on the page.
        return texts_of(data_doubts(self.engine.problem)) or self.end.doubts

    def iteration(self, k: int) -> Iteration:
        self.engine.seek(k)
        return self.engine.step()

    def record(self) -> RunRecord:
        record = self.engine.record(self.session, weights_of(self.session))
        return structs.replace(record, end=self.end) if self.is_done else record


class _Recorded:
    """A run that was read; its frame's data are read when something needs them.

    Args:
        record: the run.
        frame: the frame of arrays that it was made from, if any.
    """

    def __init__(self, record: RunRecord, frame: Frame | None = None) -> None:
        self._record, self.given = record, frame
        self.session = session_on_its_frame(record.header)

    @cached_property
    def tools(self) -> Toolbox:
        return Toolbox(self.session) if self.given is None else self.given.tools(msgspec.to_builtins(self.session))[0]

    @cached_property
    def frame(self) -> AnyFrame:
        settings = {name: msgspec.to_builtins(getattr(self.session, name)) for name in OF_ITS_FRAME}
        return self.given or OpenedFrame(None, settings, self.tools.source, self._record.header.frame)

    @cached_property
    def engine(self) -> EngineRun:
        problem = recorded_problem(self._record, self.tools, Toolbox)
        return recorded_run(self._record, self.tools, problem)

    @property
    def n_made(self) -> int:
        return len(self._record.iterations)

    @property
    def n_iterations(self) -> int:
        return self.n_made

    @property
    def is_done(self) -> bool:
        return self._record.is_complete

    can_go_on = False

    def finish(self) -> None:
        _ = self.end

    @property
    def objects(self) -> tuple[Named, ...]:
        if self._record.end is None:
            return tuple((one.name, one.instance_id) for one in self._record.header.objects)
        return tuple((one.name, one.instance_id) for one in self._record.end.answers)

    @property
    def end(self) -> RunEnd:
        if self._record.end is None:
            raise InputError(self._record.missing or "the run was not finished: it has no answers")
        return self._record.end

    @property
    def doubts(self) -> tuple[str, ...]:
        return self.end.doubts

    def iteration(self, k: int) -> Iteration:
        return self._record.iterations[k]

    def record(self) -> RunRecord:
        return self._record


_Source: TypeAlias = _Solving | _Recorded


class Iterations(Sequence[Iteration]):
    """The iterations of a run. ``len`` and ``[k]`` see those made so far; iterating makes the next ones."""

    def __init__(self, run: _Source) -> None:
        self._run = run

    def __len__(self) -> int:
        return self._run.n_made

    @overload
    def __getitem__(self, k: int) -> Iteration: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[Iteration, ...]: ...
    def __getitem__(self, k: int | slice) -> Iteration | tuple[Iteration, ...]:
        if isinstance(k, slice):
            return tuple(map(self._run.iteration, range(len(self))[k]))
        if not isinstance(k, Integral) or not -len(self) <= k < len(self):
            made = f"{len(self)} were made"
            raise _NoIteration(f"iteration {described(k)}, expected a number from 0 to {len(self) - 1}: {made}")
        return self._run.iteration(range(len(self))[int(k)])

    def __iter__(self) -> Iterator[Iteration]:
        k = 0
        while k < self._run.n_made or self._run.can_go_on:
            yield self._run.iteration(k)
            k += 1

    def __repr__(self) -> str:
        return f"<{len(self)} of {self._run.n_iterations} iterations>"


class _NoIteration(InputError, IndexError):
    """An index that no iteration has."""


class Run(Mapping[str | int, Answer]):
    """A run of a method on a frame; :func:`solve`, :func:`step` and :func:`open_run` make them.

    It maps the names of objects to their answers; where several objects share a name, their instance_ids.
    """

    def __init__(self, of: _Source) -> None:
        if not isinstance(of, _Solving | _Recorded):
            raise ArgumentTypeError(f"a run is made by solve, step and open_run, not of {described(of)}")
        self._of = of

    @property
    def frame(self) -> AnyFrame:
        """The frame that is solved."""
        return self._of.frame

    @property
    def session(self) -> Session:
        """The settings that define the run, all of them explicit."""
        return self._of.session

    def finish(self) -> Run:
        """Make all remaining iterations; returns the run itself.

        Raises:
            InputError: the run was read from a file that ends early.
        """
        self._of.finish()
        return self

    @property
    def is_done(self) -> bool:
        """Whether no iteration is left."""
        return self._of.is_done

    @property
    def iterations(self) -> Iterations:
        """The iterations made so far; iterating over them makes the next ones.
        :class:`~verefine_viz.core.records.Iteration` has the pose and the score of each stage, and what was accepted.
        """
        return Iterations(self._of)

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The answer about each object of the frame, unsolvable ones last; finishes the run."""
        return self._pictured

    @cached_property
    def _pictured(self) -> tuple[PicturedAnswer, ...]:
        return tuple(pictured(answer, self._picture) for answer in self._of.end.answers)

    def __len__(self) -> int:
        return len(self._keys)

    def __iter__(self) -> Iterator[str | int]:
        return iter(self._keys)

    def __contains__(self, name: object) -> bool:
        is_id = isinstance(name, Integral) and not isinstance(name, bool)
        return name in (self._ids if is_id else self._keys)

    def __getitem__(self, name: str | int) -> Answer:
        """The answer about an object: ``T_cam_obj`` (4, 4) [m], ``score`` in [0, 1], errors where ground truth is
        known, ``undetermined_mm`` and ``undetermined_deg``; finishes the run.

        Args:
            name: the object's name, or its instance_id where several have one name.

        Raises:
            InputError: the frame has no such object, or several.
        """
        return self.answers[self._place(name)]

    @overload
    def get(self, name: str | int, /) -> Answer | None: ...
    @overload
    def get(self, name: str | int, /, default: Answer | D) -> Answer | D: ...
    def get(self, name: str | int, /, default: Any = None) -> Any:
        """The answer about an object, or ``default`` where the frame has no object of that name."""
        return self[name] if name in self else default  # noqa: SIM401 – this is what get is.

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)

    @cached_property
    def _keys(self) -> tuple[str | int, ...]:
        n_of = Counter(name for name, _ in self._of.objects)
        keys = [name if name and n_of[name] == 1 else own for name, own in self._of.objects]
        return tuple(key for key in keys if key is not None)

    @property
    def _ids(self) -> tuple[int, ...]:
        return tuple(own for _, own in self._of.objects if own is not None)

    def _place(self, name: str | int) -> int:
        """The index of the answer about an object."""
        objects = self._of.objects
        if isinstance(name, Integral) and not isinstance(name, bool):
            if name not in self._ids:
                raise InputError(unknown("instance", int(name), self._ids))
            return next(k for k, (_, own) in enumerate(objects) if own == name)
        checked_text(name, "name", "an object's name, or its instance_id")
        places = [k for k, (own, _) in enumerate(objects) if own == name]
        if not places:
            raise InputError(unknown("object", name, [own for own, _ in objects]))
        if len(places) > 1:
            ids = ", ".join(str(objects[k][1]) for k in places)
            raise InputError(f"the frame has {len(places)} objects {name!r}; name one by its instance: {ids}")
        return places[0]

    def allowed(self, name: str | int) -> AllowedPoses:
        """The poses that the image allows besides the answer about an object: intervals of shifts and turns
        (``extents``), distant poses that fit as well (``alike``); finishes the run.

        Args:
            name: as in ``run[name]``.

        Raises:
            InputError: the frame has no such object, or several, or it has no answer.
        """
        answer = self[name]
        if answer.T_cam_obj is None or answer.instance_id is None:
            raise InputError(f"{answer.name} has no answer; expected an object that was solved")
        engine = self._of.engine
        verifier = self._of.tools.verifier_of(engine.length + 1)
        target = engine.problem.target(answer.instance_id)
        return allowed_poses(verifier, target, np.array(answer.T_cam_obj), (), engine.iterations)

    def to_frame(self) -> Any:
        """The answers as a table, a row for each: a DataFrame where pandas is installed, else lists by column.

        Columns are the fields of :class:`~verefine_viz.run.record.Answer`, ``scene_id``, ``im_id``, ``cause``,
        ``evidence`` and ``right``: whether ADD(-S) is below 10 % of the diameter. What is unknown is NaN.
        """
        return table_of(self.answers)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frame's data; finishes the run."""
        return self._of.end.notes

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about the frame's data: what does not fit together, and what would fit; finishes the run."""
        return self._of.doubts

    def record(self) -> RunRecord:
        """The record of the run so far, as it would be written to a file."""
        return self._of.record()

    def save(self, path: Path | str) -> Path:
        """Write the run to a file (``.vfrun``), which :func:`open_run` and ``verefine-viz view`` open.

        A frame of arrays is written beside it as a trace, into a folder named like the file with ``-frame`` appended.
        File and folder of an earlier run with that name are replaced.

        Args:
            path: the file, as "drop.vfrun".

        Returns:
            The file.

        Raises:
            InputError: the path has another ending, the trace's folder holds something else, or the file cannot be
                written.
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
            record = structs.replace(record, header=structs.replace(record.header, session=session_toml(session)))
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

    def diagnose(self) -> dict[str | int, Diagnosis]:
        """Why each failed answer failed, by the object's name, or by its instance_id where several have one name.

        Finishes the run, and re-runs it without each possible cause.

        Returns:
            An entry for each object whose ADD(-S) is not below 10 % of its diameter; none without ground truth.
        """
        self.finish()
        engine = self._of.engine
        engine.finish()
        names = {own: name for name, own in self._of.objects if name in self._keys}
        return {names.get(one.instance_id, one.instance_id): one for one in diagnose(engine, self._of.tools)}

    def _picture(self, answer: Answer) -> bytes:
        if answer.instance_id is None:
            return b""
        return thumbnail(self._of.engine.problem.target(answer.instance_id), answer.T_cam_obj, WIDTH_PX)

    def __reduce__(self) -> tuple[Any, ...]:
        frame = self._of.frame if isinstance(self._of, _Solving) else self._of.given
        return _unpickled, (encoded(self.record()), frame if isinstance(frame, Frame) else None)

    def __repr__(self) -> str:
        made, n = self._of.n_made, self._of.n_iterations
        return f"<Run of {self.session.method.name} on {self.session.title}: {made} of {n} iterations>"

    def _repr_html_(self) -> str:
        return gallery(repr(self).strip("<>"), self._pictured if self.is_done else ())


def _unpickled(content: bytes, frame: Frame | None) -> Run:
    return Run(_Recorded(decoded(content, "the pickled run"), frame))


def step(
    frame: AnyFrame,
    method: MethodName | MethodSection = "rir",
    refiner: AnyRefiner = "",
    preset: str = "",
    verifier: AnyVerifier = "",
    simulator: AnySimulator = "",
    estimator: AnyEstimator = "",
    **sections: Unpack[OtherSections],
) -> Run:
    """Begin a run; going through its ``iterations`` makes them.

    Args:
        frame: what is solved.
        method: refine, pir, sir, rir, vf_breadth, vf_depth, … (an unknown name lists them), or the method's section,
            such as {"name": "rir", "iterations": 10, "seed": 3}.
        refiner: icp, depth_net, …, or your own, by name or as an object; "" = the default.
        preset: recommended, paper, published; "" = recommended.
        verifier: your own in place of Eq. 1, by name or as an object.
        simulator: your own in place of Bullet, by name or as an object.
        estimator: what makes the initial poses: ppf, pcs, or your own, by name or as an object; "" = those of the
            frame.
        sections: other settings, each section a dict as in a session file: ``score={"tau_m": 0.01}``.

    A part of your own is an object with the method of its kind, its class, or a function that makes one; runs name it
    by its class. It gets copies of the arrays, so it may write into them.

    Returns:
        The run before its first iteration: ``for iteration in vv.step(frame).iterations`` makes them.

    Raises:
        SettingsError: a setting is unknown or out of range.
        InputError: the frame has nothing to solve.
    """
    given = {"name": method} if isinstance(method, str) else method
    given = checked_mapping(given, "method", 'its name, or its section as {"name": "rir", …}')
    checked_text(preset, "preset", "recommended, paper or published")
    settings = {**({"preset": preset} if preset else {}), **sections, "method": given}
    parts = {"refiner": refiner, "verifier": verifier, "simulator": simulator, "estimator": estimator}
    return Run(_Solving(frame, with_parts(settings, **parts)))


def solve(
    frame: AnyFrame,
    method: MethodName | MethodSection = "rir",
    refiner: AnyRefiner = "",
    preset: str = "",
    verifier: AnyVerifier = "",
    simulator: AnySimulator = "",
    estimator: AnyEstimator = "",
    **sections: Unpack[OtherSections],
) -> Run:
    """Run a method on a frame to its end.

    Args:
        frame: what is solved.
        method: refine, pir, sir, rir, vf_breadth, vf_depth, … (an unknown name lists them), or the method's section,
            such as {"name": "rir", "iterations": 10, "seed": 3}.
        refiner: icp, depth_net, …, or your own, by name or as an object; "" = the default.
        preset: recommended, paper, published; "" = recommended.
        verifier: your own in place of Eq. 1, by name or as an object.
        simulator: your own in place of Bullet, by name or as an object.
        estimator: what makes the initial poses: ppf, pcs, or your own, by name or as an object; "" = those of the
            frame.
        sections: other settings, each section a dict as in a session file: ``score={"tau_m": 0.01}``.

    Parts of your own are as in :func:`step`.

    Returns:
        The finished run: ``run["mug"]`` is the answer about an object.

    Raises:
        SettingsError: a setting is unknown or out of range.
        InputError: the frame has nothing to solve.
    """
    return step(frame, method, refiner, preset, verifier, simulator, estimator, **sections).finish()


def open_run(path: Path | str) -> Run:
    """Open a run that was saved, or one of a batch.

    Args:
        path: its file (``.vfrun``), or a recording of it (``.rrd``).

    Returns:
        The run as :func:`solve` gave it. Its frame's data are read when they are needed: by ``allowed``, ``diagnose``,
        ``frame`` and pictures. A run that was stopped has iterations but no answers.

    Raises:
        InputError: there is no such file, it is not a run, or it is damaged.
    """
    file = checked_path(path, "path", f"a run ({SUFFIX}), or a recording of one (.rrd)")
    if file.suffix not in (SUFFIX, ".rrd"):
        raise InputError(f"{file} is no run; expected a file that a run was saved to ({SUFFIX}), or a recording (.rrd)")
    return Run(_Recorded(read_recording(file)))
