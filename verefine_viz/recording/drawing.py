"""Rows as rerun draws them: poses, contacts, curves, bandit, events, text; one chunk per entity for many rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import accumulate

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, OBJECT_COLORS, STAGE_COLORS
from verefine_viz.recording import chunks, columns, curves, entities
from verefine_viz.recording.block import Block
from verefine_viz.recording.exact import exact
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.poses import Poses
from verefine_viz.recording.row import NO_CONTACTS, NO_PATH, Row
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
    """Draws rows in order, block by block; remembers what the next block needs of the ones before."""

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

    def skip(self, rows: Sequence[Row]) -> None:
        """Takes rows as drawn already."""
        for row in rows:
            kept = row.score(row.accepted)
            if not np.isnan(kept):
                self._held[row.instance_id][row.arm] = kept
            self._worked_on = row.instance_id
            self._started.add(row.instance_id)
            self._poses.add(row)
            if row.parts.tree is not None:
                self._tree.add(row.parts.tree)
        list(self._poses.chunks())

    def draw(self, rows: Sequence[Row]) -> Iterator[Piece]:
        """The rows, which follow the ones before without a gap."""
        block, turns = Block(rows), self._turns(rows)
        for row in rows:
            self._poses.add(row)
        yield from self._poses.chunks()
        for branch in self._layout.branches:
            own = block.own(branch.instance_id)
            yield from _contacts(branch, [rows[k] for k in own], turns.get(branch.instance_id, []))
            if own:
                if branch.instance_id not in self._started:
                    self._started.add(branch.instance_id)
                    yield curves.start(branch, rows[own[0]].index - 1)
                yield from curves.curves(branch, block, own, self._held[branch.instance_id])
        if self._layout.is_scene or self._layout.has_tree:
            yield from scene_curves(self._layout, block)
        yield from self._tree.draw(rows)
        yield from _events(self._layout, block)
        yield exact(rows)

    def _turns(self, rows: Sequence[Row]) -> dict[int, list[int]]:
        """Iterations at which another object's turn begins, by the object whose turn that ends."""
        turns: dict[int, list[int]] = {}
        for row in rows:
            if self._worked_on is not None and self._worked_on != row.instance_id:
                turns.setdefault(self._worked_on, []).append(row.index)
            self._worked_on = row.instance_id
        return turns


@lru_cache(maxsize=64)
def _object_styles(branch_name: str) -> tuple[Piece, ...]:
    root = f"{entities.OBJECTS}/{branch_name}"
    return (
        chunks.fixed(f"{root}/contacts", rr.Arrows3D.from_fields(colors=[CONTACT_COLOR], radii=[0.0008])),
        chunks.fixed(f"{root}/path", rr.LineStrips3D.from_fields(colors=[PATH_COLOR], radii=[0.0008])),
    )


def _contacts(branch: Branch, rows: Sequence[Row], turns: Sequence[int]) -> Iterator[Piece]:
    """Contacts and way of the simulation; nothing from an iteration of ``turns`` on."""
    shown = {r.index: (r.contacts, r.path) for r in rows if len(r.path)}
    shown |= {k: (NO_CONTACTS, NO_PATH) for k in turns}
    if not shown:
        return
    root, iterations = f"{entities.OBJECTS}/{branch.name}", sorted(shown)
    # All at once: most iterations have a handful of contacts.
    lengths = [len(shown[k][0]) for k in iterations]
    contacts = np.concatenate([shown[k][0] for k in iterations])
    # Light touches stay visible: an arrow is at least 10 mm long.
    vectors = contacts[:, 3:6] * np.maximum(ARROW_M_PER_N * contacts[:, 7:8], 0.01)
    arrow = rr.Arrows3D
    parts = [
        columns.vectors(arrow.descriptor_origins(), columns.Ragged(lengths, contacts[:, :3]), 3),
        columns.vectors(arrow.descriptor_vectors(), columns.Ragged(lengths, vectors), 3),
    ]
    hits = contacts[:, 8] >= 0
    if hits.any():
        colors = columns.Ragged(lengths, np.where(hits, COLLISION_COLOR, CONTACT_COLOR))
        parts.append(columns.numbers(arrow.descriptor_colors(), colors, np.uint32))
    yield chunks.rows_of(f"{root}/contacts", iterations, parts)
    paths = [shown[k][1] for k in iterations]
    ways = columns.Ragged([len(path) for path in paths], np.concatenate(paths)[:, :3, 3])
    yield chunks.rows_of(f"{root}/path", iterations, [columns.strips(rr.LineStrips3D.descriptor_strips(), ways)])


def _events(layout: Layout, block: Block) -> Iterator[Piece]:
    rows, iterations = block.rows, block.iterations
    branches = {b.instance_id: b for b in layout.branches}
    lane = [[branches[r.instance_id].name, f"hypothesis {r.arm + 1}", r.accepted, _notable(r)] for r in rows]
    yield chunks.rows_of(entities.LANE, iterations, [columns.texts(rr.StateChange.descriptor_state(), lane)])
    logged = [(r.index, kind, text) for r in rows for kind, text in zip(r.event_kinds, r.event_texts, strict=True)]
    if logged:
        parts = [
            columns.texts(rr.TextLog.descriptor_text(), [[text] for _, _, text in logged]),
            columns.texts(rr.TextLog.descriptor_level(), [[_LEVELS.get(kind, "INFO")] for _, kind, _ in logged]),
        ]
        yield chunks.rows_of(entities.LOG, [k for k, _, _ in logged], parts)
    texts = [[describe(r, layout, *ways)] for r, ways in zip(rows, block.ways(), strict=True)]
    yield chunks.rows_of(entities.CHOICE, iterations, [columns.texts(rr.TextDocument.descriptor_text(), texts)])
    chosen = [r for r in rows if r.choice.shape[1]]
    if chosen:
        lengths = [r.choice.shape[1] for r in chosen]
        heights = _above_lowest(np.concatenate([r.choice[3] for r in chosen]), lengths)
        bars = [
            columns.bars(rr.BarChart.descriptor_values(), columns.Ragged(lengths, heights)),
            _numbers_of_bars(tuple(lengths)),
        ]
        yield chunks.rows_of(entities.BANDIT, [r.index for r in chosen], bars)


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
_LEVELS |= {"refiner_stuck": "WARN", "no_physics": "WARN"}
_NOTABLE = {
    "nan_score": "NaN",
    "empty_render": "empty",
    "unstable": "tipped",
    "refiner_stuck": "stuck",
    "score_fell": "fell",
    "edited": "edited",
    "new_best_scene": "scene",
    "new_best": "best",
}
"""What the lane shows where several things happened, most important first, and how it is written where there is little
room."""


def _notable(row: Row) -> str:
    """One event per iteration for the lane; empty where nothing stands out."""
    if not row.event_kinds:
        return ""
    return next((kind.replace("_", " ") for kind in _NOTABLE if kind in row.event_kinds), "")


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
