"""Iterations as rerun draws them: poses, contacts, curves, bandit, events, text; one batch per entity for many."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, OBJECT_COLORS, STAGE_COLORS
from verefine_viz.core.records import EventKind, Iteration
from verefine_viz.recording import curves, entities
from verefine_viz.recording.block import Block, last_contacts
from verefine_viz.recording.graphs import TreeGraphs
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.lossless_log import ENTRY, NO_CONTACTS, Entry, framed
from verefine_viz.recording.poses import Poses
from verefine_viz.recording.recording_file import RecordingFile
from verefine_viz.recording.wording import describe

ARROW_M_PER_N = 0.002
"""Length of a contact's arrow; 1 kg at rest presses with 9.81 N."""
CONTACT_COLOR = 0xFFE650FF
COLLISION_COLOR = 0xFF5A3CFF
"""Of a contact with another object."""
PATH_COLOR = STAGE_COLORS["simulated"]


class Drawing:
    """Draws iterations in order, block by block; remembers what the next block needs of the ones before."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._poses = Poses(layout)
        self._trees = TreeGraphs(layout)
        self._last_scores = {b.instance_id: np.array(b.initial_scores) for b in layout.branches}
        self._worked_on: int | None = None
        self._started: set[int] = set()

    def start(self, file: RecordingFile) -> None:
        """Styles of everything that follows."""
        branches = self._layout.branches
        for branch in branches:
            curves.log_styles(file, branch)
            contact_style = rr.Arrows3D.from_fields(colors=[CONTACT_COLOR], radii=[0.0008])
            file.log(entities.contacts(branch.name), contact_style)
            path_style = rr.LineStrips3D.from_fields(colors=[PATH_COLOR], radii=[0.0008])
            file.log(entities.simulated_path(branch.name), path_style)
        self._poses.start(file)
        names = [b.name for b in branches]
        file.log(entities.LANE, _lane_style(names, max((b.n_arms for b in branches), default=0) + 1))
        file.log(entities.CHOICE, rr.TextDocument.from_fields(media_type="text/markdown"))
        if self._layout.is_scene or self._layout.has_tree:
            curves.log_scene_styles(file, self._layout)
            curves.send_initial_best(file, self._layout)
        if self._layout.has_tree:
            file.log(entities.TREE, rr.GraphEdges.from_fields(graph_type="directed"))

    def draw(self, file: RecordingFile, entries: Sequence[Entry]) -> None:
        """The iterations, which follow the ones before without a gap."""
        block = Block(entries)
        turns = self._turns(block.iterations)
        # First: where a file is cut, all else can be drawn again.
        _send_lossless(file, block)
        for iteration in block.iterations:
            self._poses.add(iteration)
        self._poses.send(file)
        for branch in self._layout.branches:
            own = block.own(branch.instance_id)
            mine = [block.iterations[k] for k in own]
            _send_contacts(file, branch, mine, turns.get(branch.instance_id, []))
            if own:
                if branch.instance_id not in self._started:
                    self._started.add(branch.instance_id)
                    curves.send_initial(file, branch, mine[0].index - 1)
                curves.send_curves(file, branch, block, own, self._last_scores[branch.instance_id])
        if self._layout.is_scene or self._layout.has_tree:
            curves.send_scene_curves(file, self._layout, block)
        self._trees.send(file, block.iterations)
        _send_events(file, self._layout, block)
        _send_choices(file, block)

    def _turns(self, iterations: Sequence[Iteration]) -> dict[int, list[int]]:
        """Iterations at which another object's turn begins, by the object whose turn that ends."""
        turns: dict[int, list[int]] = {}
        for i in iterations:
            if self._worked_on is not None and self._worked_on != i.instance_id:
                turns.setdefault(self._worked_on, []).append(i.index)
            self._worked_on = i.instance_id
        return turns


def _send_lossless(file: RecordingFile, block: Block) -> None:
    """Every iteration bit by bit: the poses by their stages (float64, row by row) for whoever looks at recordings with
    other tools, and everything as :class:`Entry`.
    """
    stages = rr.components.TextBatch([name for names in block.names for name in names])
    poses = rr.AnyBatchValue(_named("Ts_cam_obj"), block.Ts_cam_obj.ravel())
    entries = rr.components.BlobBatch([framed(entry.packed) for entry in block.entries])
    file.send(
        entities.LOSSLESS,
        block.indices,
        [
            rr.ComponentColumn(_named("stages"), stages, lengths=block.n_stages),
            rr.ComponentColumn(_named("Ts_cam_obj"), poses, lengths=[16 * n for n in block.n_stages]),
            rr.ComponentColumn(_named(ENTRY), entries),
        ],
    )


def _named(name: str) -> str:
    return f"{entities.PROPERTY}:{name}"


def _send_contacts(file: RecordingFile, branch: Branch, iterations: Sequence[Iteration], turns: Sequence[int]) -> None:
    """Contacts and path of the simulation; nothing from an iteration of ``turns`` on."""
    shown = {i.index: (last_contacts(i), i.path.Ts_cam_obj) for i in iterations if i.path is not None}
    shown |= {k: (NO_CONTACTS, _NO_PATH) for k in turns}
    if not shown:
        return
    indices = sorted(shown)
    contacts, paths = zip(*[shown[k] for k in indices], strict=True)
    # All at once: most iterations have a handful of contacts.
    lengths = [len(c.depths_m) for c in contacts]
    origins = np.concatenate([c.points_cam for c in contacts])
    normals = np.concatenate([c.normals_cam for c in contacts])
    # Light touches stay visible: an arrow is at least 10 mm long.
    lengths_m = np.maximum(ARROW_M_PER_N * np.concatenate([c.forces_n for c in contacts]), 0.01)
    hits = np.concatenate([c.others for c in contacts]) >= 0
    colors = np.where(hits, COLLISION_COLOR, CONTACT_COLOR).astype(np.uint32)
    arrows = rr.Arrows3D.columns(origins=origins, vectors=normals * lengths_m[:, None], colors=colors)
    file.send(entities.contacts(branch.name), indices, arrows.partition(lengths))
    lines = rr.LineStrips3D.columns(strips=[path[:, :3, 3] for path in paths if len(path)])
    file.send(entities.simulated_path(branch.name), indices, lines.partition([min(len(path), 1) for path in paths]))


_NO_PATH = np.zeros((0, 4, 4))


def _send_events(file: RecordingFile, layout: Layout, block: Block) -> None:
    names = {b.instance_id: b.name for b in layout.branches}
    lane = [
        (
            names[i.instance_id],
            f"hypothesis {i.arm + 1}",
            i.accepted,
            _notable(tuple([event.kind for event in i.events])),
        )
        for i in block.iterations
    ]
    states = rr.StateChange.columns(state=[state for row in lane for state in row])
    file.send(entities.LANE, block.indices, states.partition([4] * len(lane)))
    events = [(i.index, event) for i in block.iterations for event in i.events]
    if events:
        texts = rr.TextLog.columns(
            text=[event.text for _, event in events],
            level=[_LEVELS.get(event.kind, "INFO") for _, event in events],
        )
        file.send(entities.LOG, [k for k, _ in events], texts)
    described = [describe(entry, layout, *ways) for entry, ways in zip(block.entries, block.ways(), strict=True)]
    file.send(entities.CHOICE, block.indices, rr.TextDocument.columns(text=described))


def _send_choices(file: RecordingFile, block: Block) -> None:
    """The UCB of each hypothesis as bars."""
    choices = [(i.index, i.choice.ucb) for i in block.iterations if i.choice is not None]
    if not choices:
        return
    lengths = [len(ucb) for _, ucb in choices]
    heights = _above_lowest(np.concatenate([ucb for _, ucb in choices]), lengths)
    bars = [_tensor(row) for row in np.split(heights, list(accumulate(lengths[:-1])))]
    # What rr.BarChart.columns does not make: a tensor for each row.
    columns = [
        rr.ComponentColumn(descriptor, rr.components.TensorDataBatch(pa.concat_arrays(tensors)))
        for descriptor, tensors in (
            (rr.BarChart.descriptor_values(), bars),
            (rr.BarChart.descriptor_abscissa(), [_numbers_of_bars(n) for n in lengths]),
        )
    ]
    file.send(entities.BANDIT, [k for k, _ in choices], columns)


def _tensor(values: NDArray[Any]) -> pa.Array:
    return rr.components.TensorDataBatch(np.ascontiguousarray(values)).as_arrow_array()


@lru_cache(maxsize=64)
def _numbers_of_bars(n: int) -> pa.Array:
    """A bar begins at its number: half before the hypothesis's, so that it stands over it."""
    return _tensor(np.arange(n) + 0.5)


def _above_lowest(ucb: Float, lengths: Sequence[int]) -> Float:
    """Bars begin at 0, where scores around 0.7 would all look alike; what was never played has no number and is as high
    as the highest.
    """
    firsts, known = list(accumulate(lengths[:-1], initial=0)), np.isfinite(ucb)
    lowest = np.minimum.reduceat(np.where(known, ucb, np.inf), firsts)
    highest = np.maximum.reduceat(np.where(known, ucb, -np.inf), firsts)
    none = lowest > highest
    lowest[none], highest[none] = 0.0, 0.0
    return np.where(known, ucb, np.repeat(highest, lengths)) - np.repeat(lowest, lengths)


_LEVELS = {"score_fell": "WARN", "unstable": "WARN", "empty_render": "ERROR", "nan_score": "ERROR"}
_LEVELS |= {"refiner_stuck": "WARN", "no_physics": "WARN", "physics_worse": "WARN"}
_NOTABLE = {
    "nan_score": "NaN",
    "empty_render": "empty",
    "unstable": "tipped",
    "physics_worse": "worse",
    "refiner_stuck": "stuck",
    "score_fell": "fell",
    "edited": "edited",
    "new_best_scene": "scene",
    "new_best": "best",
}
"""What the lane shows where several things happened, most important first, and how it is written where there is little
room."""


@lru_cache(maxsize=256)
def _notable(kinds: tuple[EventKind, ...]) -> str:
    """Of an iteration's events the one for the lane; empty where nothing stands out."""
    return next((kind.replace("_", " ") for kind in _NOTABLE if kind in kinds), "")


def _lane_style(branch_names: Sequence[str], n_arms: int) -> rr.StateConfiguration:
    colors = {name: OBJECT_COLORS[k % len(OBJECT_COLORS)] for k, name in enumerate(branch_names)}
    labels = {name: name for name in branch_names}
    for j in range(n_arms):
        colors[f"hypothesis {j + 1}"], labels[f"hypothesis {j + 1}"] = ARM_COLORS[j % len(ARM_COLORS)], f"h{j + 1}"
    for stage, short in _SHORT_STAGES.items():
        colors[stage], labels[stage] = STAGE_COLORS[stage], short
    for kind, short in _NOTABLE.items():
        name = kind.replace("_", " ")
        colors[name], labels[name] = EVENT_COLORS[kind], short
    return rr.StateConfiguration(values=list(colors), labels=list(labels.values()), colors=list(colors.values()))


_SHORT_STAGES = {"current": "cur", "simulated": "sim", "mixed": "mix", "refined": "ref", "edited": "edit"}
