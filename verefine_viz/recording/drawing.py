"""Iterations as rerun draws them: poses, contacts, curves, bandit, events, text; one chunk per entity for many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import accumulate

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, OBJECT_COLORS, STAGE_COLORS
from verefine_viz.core.records import EventKind, Iteration
from verefine_viz.recording import chunks, columns, curves, entities
from verefine_viz.recording.block import Block, last_contacts
from verefine_viz.recording.entry import NO_CONTACTS, Entry
from verefine_viz.recording.exact import exact
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.poses import Poses
from verefine_viz.recording.scene_curves import scene_curves, scene_styles, start_best
from verefine_viz.recording.tree import Tree
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
        self._tree = Tree(layout)
        self._held = {b.instance_id: np.array(b.initial_scores) for b in layout.branches}
        self._worked_on: int | None = None
        self._started: set[int] = set()

    def start(self) -> Iterator[Piece]:
        """Styles of everything that follows."""
        branches = self._layout.branches
        for branch in branches:
            yield from curves.styles(branch.name, branch.n_arms, branch.has_truth)
            yield from _object_styles(branch.name)
        yield from self._poses.start()
        yield from _lane_styles(tuple(b.name for b in branches), max((b.n_arms for b in branches), default=0) + 1)
        if self._layout.is_scene or self._layout.has_tree:
            yield from scene_styles(tuple(b.name for b in branches))
            yield from start_best(self._layout)
        yield from self._tree.styles()

    def draw(self, entries: Sequence[Entry]) -> Iterator[Piece]:
        """The iterations, which follow the ones before without a gap."""
        block = Block(entries)
        turns = self._turns(block.iterations)
        # First: where a file is cut, all else can be drawn again.
        yield exact(block)
        for iteration in block.iterations:
            self._poses.add(iteration)
        yield from self._poses.chunks()
        for branch in self._layout.branches:
            own = block.own(branch.instance_id)
            mine = [block.iterations[k] for k in own]
            yield from _contacts(branch, mine, turns.get(branch.instance_id, []))
            if own:
                if branch.instance_id not in self._started:
                    self._started.add(branch.instance_id)
                    yield curves.start(branch, mine[0].index - 1)
                yield from curves.curves(branch, block, own, self._held[branch.instance_id])
        if self._layout.is_scene or self._layout.has_tree:
            yield from scene_curves(self._layout, block)
        yield from self._tree.draw(block.iterations)
        yield from _events(self._layout, block)

    def _turns(self, iterations: Sequence[Iteration]) -> dict[int, list[int]]:
        """Iterations at which another object's turn begins, by the object whose turn that ends."""
        turns: dict[int, list[int]] = {}
        for i in iterations:
            if self._worked_on is not None and self._worked_on != i.instance_id:
                turns.setdefault(self._worked_on, []).append(i.index)
            self._worked_on = i.instance_id
        return turns


@lru_cache(maxsize=64)
def _object_styles(branch_name: str) -> tuple[Piece, ...]:
    root = f"{entities.OBJECTS}/{branch_name}"
    return (
        chunks.fixed(f"{root}/contacts", rr.Arrows3D.from_fields(colors=[CONTACT_COLOR], radii=[0.0008])),
        chunks.fixed(f"{root}/path", rr.LineStrips3D.from_fields(colors=[PATH_COLOR], radii=[0.0008])),
    )


def _contacts(branch: Branch, iterations: Sequence[Iteration], turns: Sequence[int]) -> Iterator[Piece]:
    """Contacts and way of the simulation; nothing from an iteration of ``turns`` on."""
    shown = {i.index: (last_contacts(i), i.path.Ts_cam_obj) for i in iterations if i.path is not None}
    shown |= {k: (NO_CONTACTS, _NO_PATH) for k in turns}
    if not shown:
        return
    root, indices = f"{entities.OBJECTS}/{branch.name}", sorted(shown)
    contacts, paths = zip(*[shown[k] for k in indices], strict=True)
    # All at once: most iterations have a handful of contacts.
    lengths = [len(c.depths_m) for c in contacts]
    origins = np.concatenate([c.points_cam for c in contacts])
    normals = np.concatenate([c.normals_cam for c in contacts])
    # Light touches stay visible: an arrow is at least 10 mm long.
    lengths_m = np.maximum(ARROW_M_PER_N * np.concatenate([c.forces_n for c in contacts]), 0.01)
    arrow = rr.Arrows3D
    parts = [
        columns.vectors(arrow.descriptor_origins(), columns.Ragged(lengths, origins), 3),
        columns.vectors(arrow.descriptor_vectors(), columns.Ragged(lengths, normals * lengths_m[:, None]), 3),
    ]
    hits = np.concatenate([c.others for c in contacts]) >= 0
    if hits.any():
        colors = columns.Ragged(lengths, np.where(hits, COLLISION_COLOR, CONTACT_COLOR))
        parts.append(columns.numbers(arrow.descriptor_colors(), colors, np.uint32))
    yield chunks.rows_of(f"{root}/contacts", indices, parts)
    ways = columns.Ragged([len(path) for path in paths], np.concatenate(paths)[:, :3, 3])
    yield chunks.rows_of(f"{root}/path", indices, [columns.strips(rr.LineStrips3D.descriptor_strips(), ways)])


_NO_PATH = np.zeros((0, 4, 4))


def _events(layout: Layout, block: Block) -> Iterator[Piece]:
    iterations, indices = block.iterations, block.indices
    names = {b.instance_id: b.name for b in layout.branches}
    lane = [
        [
            names[i.instance_id],
            f"hypothesis {i.arm + 1}",
            i.accepted,
            _notable(tuple([event.kind for event in i.events])),
        ]
        for i in iterations
    ]
    yield chunks.rows_of(entities.LANE, indices, [columns.texts(rr.StateChange.descriptor_state(), lane)])
    logged = [(i.index, event) for i in iterations for event in i.events]
    if logged:
        parts = [
            columns.text(rr.TextLog.descriptor_text(), [event.text for _, event in logged]),
            columns.text(rr.TextLog.descriptor_level(), [_LEVELS.get(event.kind, "INFO") for _, event in logged]),
        ]
        yield chunks.rows_of(entities.LOG, [k for k, _ in logged], parts)
    texts = [describe(entry, layout, *ways) for entry, ways in zip(block.entries, block.ways(), strict=True)]
    yield chunks.rows_of(entities.CHOICE, indices, [columns.text(rr.TextDocument.descriptor_text(), texts)])
    chosen = [(i.index, i.choice.ucb) for i in iterations if i.choice is not None]
    if chosen:
        lengths = [len(ucb) for _, ucb in chosen]
        heights = _above_lowest(np.concatenate([ucb for _, ucb in chosen]), lengths)
        bars = [
            columns.bars(rr.BarChart.descriptor_values(), columns.Ragged(lengths, heights)),
            _numbers_of_bars(tuple(lengths)),
        ]
        yield chunks.rows_of(entities.BANDIT, [k for k, _ in chosen], bars)


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


@lru_cache(maxsize=64)
def _numbers_of_bars(lengths: tuple[int, ...]) -> columns.Column:
    """A bar begins at its number: half before the hypothesis's, so that it stands over it."""
    return columns.bars(rr.BarChart.descriptor_abscissa(), [np.arange(n) + 0.5 for n in lengths])


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


@lru_cache(maxsize=64)
def _lane_styles(branch_names: tuple[str, ...], n_arms: int) -> tuple[Piece, ...]:
    colors = {name: OBJECT_COLORS[k % len(OBJECT_COLORS)] for k, name in enumerate(branch_names)}
    labels = {name: name for name in branch_names}
    for j in range(n_arms):
        colors[f"hypothesis {j + 1}"], labels[f"hypothesis {j + 1}"] = ARM_COLORS[j % len(ARM_COLORS)], f"h{j + 1}"
    for stage, short in _SHORT_STAGES.items():
        colors[stage], labels[stage] = STAGE_COLORS[stage], short
    for kind, short in _NOTABLE.items():
        name = kind.replace("_", " ")
        colors[name], labels[name] = EVENT_COLORS[kind], short
    look = rr.StateConfiguration(values=list(colors), labels=list(labels.values()), colors=list(colors.values()))
    return (
        chunks.fixed(entities.LANE, look),
        chunks.fixed(entities.CHOICE, rr.TextDocument.from_fields(media_type="text/markdown")),
    )


_SHORT_STAGES = {"current": "cur", "simulated": "sim", "mixed": "mix", "refined": "ref", "edited": "edit"}
