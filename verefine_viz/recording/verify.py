"""Compares a recording with a new run of its session: whether they agree bit for bit, and if not, how far apart they
are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, structs

from verefine_viz.core.errors import InputError
from verefine_viz.core.records import TIMES, Iteration
from verefine_viz.recording.reader import read_recording
from verefine_viz.run.engine import Run
from verefine_viz.run.first_format import as_read_from_it
from verefine_viz.run.record import FORMAT, RunEnd, RunHeader, RunRecord
from verefine_viz.run.run_file import as_read
from verefine_viz.run.run_header import NO_WEIGHTS, header_of, session_of
from verefine_viz.run.session_parts import weights_of
from verefine_viz.run.versions import versions

# Records are compared bit for bit, timings left out: this is what "the same run" means.


@dataclass(frozen=True)
class Difference:
    """A field in which two records differ."""

    words: str
    """Which field, and how: ``stages[1].T_cam_obj[0, 3]: 0.5 against 0.5000000000000001, by 1.1e-16``."""
    size: float
    """Difference of its numbers, as a share of the larger one where that is above 1; infinite unless both sides hold
    equally many floating-point numbers."""


def first_difference(a: Any, b: Any, path: str = "") -> str | None:
    """The path of the first field in which two records differ (``stages[1].T_cam_obj``), or None if they are the same.

    Arrays are compared bit by bit (NaN equals NaN), floats by equality; times are left out.
    """
    return next((difference.words for difference in differences(a, b, path)), None)


def differences(a: Any, b: Any, path: str = "") -> Iterator[Difference]:
    """All fields in which two records differ, as :func:`first_difference` compares them, in the order of the fields."""
    if type(a) is not type(b):
        kinds = [_KINDS.get(type(x), type(x).__name__) for x in (a, b)]
        yield Difference(f"{path or 'record'}: {kinds[0]} against {kinds[1]}", math.inf)
    elif is_dataclass(a) or isinstance(a, Struct):
        names = a.__struct_fields__ if isinstance(a, Struct) else [f.name for f in fields(a)]
        for name in names:
            if name not in TIMES:
                inner = f"{path}.{name}" if path else name
                yield from differences(getattr(a, name), getattr(b, name), inner)
    elif isinstance(a, np.ndarray):
        if a.shape != b.shape or a.dtype != b.dtype:
            yield Difference(f"{path}: {a.dtype} {a.shape} against {b.dtype} {b.shape}", math.inf)
        elif a.tobytes() != b.tobytes():
            yield _array_difference(a, b, path)
    elif isinstance(a, tuple | list):
        if len(a) != len(b):
            yield Difference(f"{path}: {len(a)} entries against {len(b)}", math.inf)
        else:
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                yield from differences(x, y, f"{path}[{i}]")
    elif a != b and not (isinstance(a, float) and a != a and b != b):
        yield _value_difference(a, b, path)


_KINDS: dict[type, str] = {type(None): "nothing", np.ndarray: "an array", tuple: "a list", list: "a list"}
"""Words for types of values in messages."""


def _array_difference(a: np.ndarray, b: np.ndarray, path: str) -> Difference:
    """The largest difference between two arrays of the same shape and type, at entries whose bits differ."""
    values_a, values_b = a.ravel().tolist(), b.ravel().tolist()
    bits_a, bits_b = (np.ascontiguousarray(x).view(np.uint8).reshape(a.size, -1) for x in (a, b))
    differing = np.flatnonzero((bits_a != bits_b).any(axis=1)).tolist()
    sizes = {k: _size(values_a[k], values_b[k]) for k in differing}
    k = max(differing, key=lambda k: sizes[k])
    at = ", ".join(str(i) for i in np.unravel_index(k, a.shape))
    largest = _value_difference(values_a[k], values_b[k], f"{path}[{at}]")
    more = f", the largest of {len(differing)} differences in it" if len(differing) > 1 else ""
    return Difference(largest.words + more, largest.size)


def _value_difference(a: Any, b: Any, path: str) -> Difference:
    size = _size(a, b)
    if isinstance(a, float):
        a, b = float(a), float(b)  # Python numbers, as numpy's would be shown with their type.
    by = f", by {abs(a - b):.2g}" if 0 < size < math.inf else ""
    return Difference(f"{path}: {a!r} against {b!r}{by}", size)


def _size(a: Any, b: Any) -> float:
    if not isinstance(a, float):
        return math.inf
    size = abs(a - b) / max(1.0, abs(a), abs(b))
    return math.inf if math.isnan(size) else size


MakeRun = Callable[[RunRecord], Run]
MakeEnd = Callable[[Run, RunRecord], RunEnd]
START, ANSWERS = "the start", "the answers"
"""Parts of a recording beside its iterations."""

ROUNDING = 1e-6
"""Numbers that differ by a smaller share, or absolutely by less where they are below 1, count as differing in their
last digits: a micrometre in a pose. Rounding begins ten digits further down, but contacts in the simulation amplify it.
"""


@dataclass(frozen=True)
class Verification:
    """Outcome of comparing a recording with a new run of its session."""

    n_compared: int
    """Number of iterations from the first on that agree bit for bit."""
    difference: str | None
    """Where the new run first differs, how, by how much and, if known, why; None = nowhere."""
    n_planned: int
    """Number of iterations of the new run."""
    missing: str = ""
    """A sentence on what part of the recording could not be read, or was never written; "" = none."""

    @property
    def ends_early(self) -> bool:
        """Whether nothing differs but the end of the recording is missing: it was stopped, truncated or damaged."""
        return self.difference is None and bool(self.missing)

    @property
    def text(self) -> str:
        if self.difference is not None:
            return f"differs, recorded against now: {self.difference}"
        if not self.ends_early and self.n_planned == 0:
            return "there is nothing to compare: neither the recording nor the new run has an iteration"
        if not self.ends_early:
            short = "" if self.n_compared == self.n_planned else f"; the whole run has {self.n_planned}"
            return f"no difference in {self.n_compared} iterations{short}"
        if self.n_compared == self.n_planned:
            return f"{self.missing}, all that there are, and the same; its answers are missing"
        early = f"{self.missing}, of {self.n_planned}"
        return f"{early}; the same up to iteration {self.n_compared}" if self.n_compared else early


def verify(path: Path, make_run: MakeRun | None = None, make_end: MakeEnd | None = None) -> Verification:
    """Runs the recorded session again and compares bit by bit, as far as the recording goes: what it began from
    (ground truth, hypotheses, their scores), every iteration, and the answers.

    Where only the last digits differ it goes on, to see whether larger differences follow.

    Args:
        path: the recording.
        make_run: builds the run of a recording; None = from its session, with the real simulator, refiner and verifier.
        make_end: works out the answers of the new run, as those of the recording were; None = they are not compared.

    Raises:
        InputError: the file is not a recording of this program, or its data are gone.
    """
    recorded = read_recording(path)
    run = (make_run or run_again)(recorded)
    first_and_real: list[tuple[str, Difference]] = []
    """The first difference, and the first that is more than rounding, each with its place."""
    n_same, largest = 0, 0.0
    for where, here in _compared(recorded, run, make_end):
        if where == ANSWERS and first_and_real:
            break  # Answers follow from iterations, which differ already.
        n_same += not first_and_real and not here and where not in (START, ANSWERS)
        largest = max([largest, *(d.size for d in here)])
        real = next((d for d in here if d.size > ROUNDING), None)
        if here and not first_and_real:
            first_and_real.append((where, here[0]))
        if real is not None:
            first_and_real.append((where, real))
            break
    words = None
    if first_and_real:
        words = _describe(first_and_real, largest, recorded)
    return Verification(n_same, words, run.n_iterations, recorded.missing)


def run_again(recorded: RunRecord) -> Run:
    """The run of a recording's session and frame, not yet stepped.

    Raises:
        InputError: the frame no longer holds all objects that were recorded.
    """
    # The engine's parts are heavy, and opening a recording does not need them.
    from verefine_viz.run.toolbox import Toolbox

    toolbox = Toolbox(session_of(recorded.header))
    frame = recorded.header.frame
    problem = toolbox.problem(frame)
    wanted = [one.instance_id for one in recorded.header.objects]
    lacking = set(wanted) - {instance.instance_id for instance in problem.instances}
    if lacking:
        why = [f"; {one.name}: {one.why}" for one in problem.left_out if one.instance_id in lacking]
        raise InputError(
            f"it cannot be run again: frame {frame} of the data no longer has instance "
            f"{', '.join(map(str, sorted(lacking)))}, which was there when it was recorded{''.join(why)}"
        )
    return toolbox.run(problem.only(wanted))


def _compared(recorded: RunRecord, run: Run, make_end: MakeEnd | None) -> Iterator[tuple[str, list[Difference]]]:
    """Each part of a recording, and how the same part of the new run differs; none of a frame that failed."""
    if recorded.end is not None and recorded.end.failed:
        return
    has_scores = bool(recorded.iterations) or any(one.initial for one in recorded.header.objects)
    session = session_of(recorded.header)
    start = header_of(run.problem, run.state_at(0) if has_scores else None, session, NO_WEIGHTS)
    yield START, [*differences(_derived(recorded.header), _derived(as_read(start)))]
    for iteration in recorded.iterations:
        yield f"iteration {iteration.index}", _differences(iteration, run)
    if make_end is not None and recorded.end is not None and run.is_done:
        end = as_read(make_end(run, recorded))
        yield ANSWERS, [*differences(recorded.end, as_read_from_it(end) if recorded.header.format == 1 else end)]


def _derived(header: RunHeader) -> RunHeader:
    """A header without the fields on what a run was made from and by which versions."""
    return structs.replace(header, format=FORMAT, session="", versions={})


def _differences(iteration: Iteration, run: Run) -> list[Difference]:
    if run.is_done:
        return [Difference(f"recorded, but the new run ended after {run.length}", float("inf"))]
    return list(differences(iteration, as_read(run.step())))


def _describe(first_and_real: list[tuple[str, Difference]], largest: float, recorded: RunRecord) -> str:
    """The first difference and, where that is only rounding, the first that is more."""
    (where, first), changed = first_and_real[0], _changed(recorded)
    text = f"{where}: {first.words}"
    if first.size > ROUNDING:
        return f"{text}; recorded with {changed}" if changed else text
    if largest <= ROUNDING:
        text += (
            f"; only last digits differ, in all {len(recorded.iterations)} iterations by {largest:.1g} at most, and "
            "everything else is the same: in effect it is the same run"
        )
    else:
        where, real = first_and_real[1]
        text += f"; it begins with last digits and leads to more, {where}: {real.words}"
    if changed:
        return f"{text}; recorded with {changed}, and other versions compute last digits differently"
    return f"{text}; another state of the program, or another machine, computes last digits differently (same versions)"


def _changed(recorded: RunRecord) -> str:
    """Names the libraries and weights that differ from the recording's, a possible reason."""
    here = versions(weights_of(session_of(recorded.header)))
    return ", ".join(f"{n} {v} (here {here.get(n)})" for n, v in recorded.header.versions.items() if here.get(n) != v)
