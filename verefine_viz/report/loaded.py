"""A batch as a report looks at it: its rows, what failed in it, and where its answers and recordings are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from verefine_viz.batch.index import BatchIndex, read_batch
from verefine_viz.batch.journal import Journal
from verefine_viz.batch.rows import FrameResult, ObjectRow, frame_name
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError

Key = tuple[int, int, int | None, int | None]
"""scene_id, im_id, instance_id, obj_id: the same object in two runs."""


@dataclass(frozen=True, eq=False)
class Loaded:
    """One run."""

    label: str
    """"A" or "B" beside another run; empty where it stands alone."""
    index: BatchIndex

    @property
    def folder(self) -> Path:
        return self.index.folder

    @property
    def rows(self) -> tuple[ObjectRow, ...]:
        """One per object; one per failed frame of which nobody knows what is in it."""
        return self.index.rows

    @property
    def method(self) -> str:
        return self.index.session.method.name

    @property
    def name(self) -> str:
        """For legends and headings."""
        return f"{self.label}: {self.method} ({self.folder.name})" if self.label else self.method

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Each "scene/image", in the order of frames.csv."""
        return tuple(dict.fromkeys(row.frame for row in self.rows))

    @cached_property
    def objects(self) -> tuple[ObjectRow, ...]:
        """Rows of objects, also of those that were left out or are in failed frames: they are missed."""
        return tuple(row for row in self.rows if row.is_object)

    @cached_property
    def with_truth(self) -> tuple[ObjectRow, ...]:
        """Objects that can be right or wrong."""
        return tuple(row for row in self.objects if row.has_truth or row.add_s_mm is not None)

    @cached_property
    def failures(self) -> tuple[ObjectRow, ...]:
        """Objects whose answer is wrong or missing, worst first; without any ground truth all objects, by score.

        Only those that were asked for: what is left out or in a failed frame is no failure of the method.
        """
        worst_first = [row for row in self.index.sorted_by("error") if row.was_asked_for]
        if not self.with_truth:
            return tuple(worst_first)
        return tuple(row for row in worst_first if row.status == "no_answer" or row.is_correct is False)

    @cached_property
    def _by_key(self) -> dict[Key, ObjectRow]:
        return {key(row): row for row in self.objects}

    def row_of(self, other: ObjectRow) -> ObjectRow | None:
        """The same object as another run's row; None where this run does not have it."""
        return self._by_key.get(key(other))

    @property
    def journal(self) -> Journal:
        return Journal(self.folder / "frames")

    @cached_property
    def solving_ms(self) -> float | None:
        """Mean of the times that results.csv states for images with an answer [ms]; None where there are none."""
        times_s = [result.solving_s for result in self.journal.results(self.frames) if result.estimates]
        return 1e3 * sum(times_s) / len(times_s) if times_s else None

    def result(self, frame: str) -> FrameResult | None:
        """What the journal says about a frame; None where it says nothing."""
        return self.journal.read(frame)

    def answers(self, frame: str) -> dict[int, Float]:
        """instance_id → T_cam_obj (4, 4) [m] of a frame's answers; empty where the journal is gone."""
        return self.index.answers(frame)

    def recording(self, frame: str) -> Path:
        """Where the frame's recording is, if it was kept."""
        return self.folder / "recordings" / f"{frame_name(frame)}.rrd"


def load(folder: Path, label: str = "") -> Loaded:
    """The run in ``folder``.

    Raises:
        InputError: it is no batch folder, its files are missing or damaged, or it holds no result.
    """
    loaded = Loaded(label, read_batch(folder))
    if not loaded.rows:
        raise InputError(f"{folder} holds a run without a single finished frame; run verefine-viz batch again")
    return loaded


def load_pair(folder: Path, other: Path) -> tuple[Loaded, Loaded]:
    """Two runs that can be compared.

    Raises:
        InputError: one of them cannot be read, or they are not about the same objects of the same data set.
    """
    a, b = load(folder, "A"), load(other, "B")
    if folder.resolve() == other.resolve():
        raise InputError(f"{folder} and {other} are the same folder; name two runs, or one")
    there, here = data_set(a), data_set(b)
    if there != here:
        raise InputError(f"{folder} is a run on {there} and {other} one on {here}; only runs on the same data compare")
    if not {key(row) for row in a.objects} & {key(row) for row in b.objects}:
        raise InputError(f"{folder} and {other} have no object in common: they are about other frames or other objects")
    return a, b


def data_set(run: Loaded) -> str:
    """Which data a run is about, for people."""
    scene = run.index.session.scene
    return f"{Path(scene.dataset).name}/{scene.split}" if scene.source == "bop" else f"the built-in scene {scene.demo}"


def key(row: ObjectRow) -> Key:
    """What makes two rows be about the same object."""
    return row.scene_id, row.im_id, row.instance_id, row.obj_id


def error_or_infinite(row: ObjectRow) -> float:
    """ADD(-S) of the answer as a share of the diameter; infinite where there is no answer or no ground truth."""
    return math.inf if row.relative_error is None else row.relative_error
