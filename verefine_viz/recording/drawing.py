"""Rows as rerun draws them: poses, contacts, curves, bandit, events, text; one chunk per entity for many rows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, STAGE_COLORS
from verefine_viz.recording import columns, entities
from verefine_viz.recording.curves import send_curves, send_start, styles
from verefine_viz.recording.exact import send_exact
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.row import Row
from verefine_viz.recording.wording import describe

NOWHERE = np.diag([1e-6, 1e-6, 1e-6, 1.0])
"""Too small to be seen: what has no valid transform at all would be reported as an error in the view."""
ARROW_M_PER_N = 0.002
"""Length of a contact's arrow; 1 kg at rest presses with 9.81 N."""


CONTACT_COLOR = (255, 230, 80)
PATH_COLOR = STAGE_COLORS["simulated"]


class Drawing:
    """Draws rows in order, block by block; remembers what the next block needs of the ones before."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._held = {b.instance_id: np.array(b.initial_scores) for b in layout.branches}
        self._shown: Branch | None = None
        self._started: set[int] = set()

    def start(self, rec: rr.RecordingStream) -> None:
        """Styles of everything that follows."""
        for branch in self._layout.branches:
            rec.send_chunks(styles(branch.name, branch.n_arms, branch.has_truth))
            rec.send_chunks(_object_styles(branch.name))
            _hide_stages(rec, branch, 0, entities.DRAWN_STAGES)
        n_arms = max((b.n_arms for b in self._layout.branches), default=0)
        rec.send_chunks(_lane_styles(tuple(b.name for b in self._layout.branches), n_arms))

    def skip(self, rows: Sequence[Row]) -> None:
        """Takes rows as drawn already."""
        for row in rows:
            kept = row.score(row.accepted)
            if not np.isnan(kept):
                self._held[row.instance_id][row.arm] = kept
            self._shown = self._layout.branch(row.instance_id)
            self._started.add(row.instance_id)

    def draw(self, rec: rr.RecordingStream, rows: Sequence[Row]) -> None:
        """Sends the rows, which follow the ones before without a gap."""
        for block in _by_instance(rows):
            branch = self._layout.branch(block[0].instance_id)
            if self._shown is not None and self._shown != branch:
                _clear(rec, self._shown, block[0].index)
            self._shown = branch
            if branch.instance_id not in self._started:
                self._started.add(branch.instance_id)
                send_start(rec, branch, block[0].index - 1)
            _send_poses(rec, branch, block)
            _send_contacts(rec, branch, block)
            send_curves(rec, branch, block, self._held[branch.instance_id])
            _send_events(rec, branch, block)
        send_exact(rec, rows)


@lru_cache(maxsize=64)
def _object_styles(branch_name: str) -> tuple[Chunk, ...]:
    root = f"{entities.OBJECTS}/{branch_name}"
    return (
        columns.fixed(f"{root}/contacts", rr.Arrows3D.from_fields(colors=[CONTACT_COLOR], radii=[0.0008])),
        columns.fixed(f"{root}/path", rr.LineStrips3D.from_fields(colors=[PATH_COLOR], radii=[0.0008])),
    )


def _by_instance(rows: Sequence[Row]) -> list[list[Row]]:
    blocks: list[list[Row]] = []
    for row in rows:
        if not blocks or blocks[-1][0].instance_id != row.instance_id:
            blocks.append([])
        blocks[-1].append(row)
    return blocks


def _send_poses(rec: rr.RecordingStream, branch: Branch, rows: Sequence[Row]) -> None:
    """One row of transforms per stage; a stage that an iteration does not have is drawn nowhere."""
    drawn = entities.DRAWN_STAGES
    stages = [s for s in drawn if s == "best" or any(s in r.stages for r in rows)]
    poses = np.array(
        [[r.T_best if s == "best" else _pose(r, s) for s in stages] for r in rows], dtype=np.float32
    ).reshape(-1, 4, 4)
    _send_transforms(rec, branch, [r.index for r in rows for _ in stages], stages * len(rows), poses)


def _pose(row: Row, stage: str) -> np.ndarray:
    pose = row.pose(stage)
    return NOWHERE if pose is None else pose


def _hide_stages(rec: rr.RecordingStream, branch: Branch, iteration: int, stages: Sequence[str]) -> None:
    nowhere = np.tile(NOWHERE, (len(stages), 1, 1))
    _send_transforms(rec, branch, [iteration] * len(stages), stages, nowhere)


def _clear(rec: rr.RecordingStream, branch: Branch, iteration: int) -> None:
    """From here on another object is worked on: of this one only the best pose stays."""
    _hide_stages(rec, branch, iteration, [s for s in entities.DRAWN_STAGES if s != "best"])
    for what, nothing in _NOTHING.items():
        columns.send(rec, f"{entities.OBJECTS}/{branch.name}/{what}", [iteration], nothing)


def _send_transforms(
    rec: rr.RecordingStream, branch: Branch, iterations: Sequence[int], stages: Sequence[str], poses: np.ndarray
) -> None:
    frames = [[entities.stage_frame(branch.name, s)] for s in stages]
    # rerun keeps matrices column by column.
    matrices = poses[:, :3, :3].transpose(0, 2, 1).reshape(-1, 1, 9)
    parts = [
        columns.vectors(rr.Transform3D.descriptor_translation(), poses[:, None, :3, 3], 3),
        columns.vectors(rr.Transform3D.descriptor_mat3x3(), matrices, 9),
        columns.texts(rr.Transform3D.descriptor_child_frame(), frames),
        columns.texts(rr.Transform3D.descriptor_parent_frame(), [[f"tf#{entities.SCENE}"]] * len(poses)),
    ]
    columns.send(rec, f"{entities.OBJECTS}/{branch.name}/poses", iterations, parts)


def _send_contacts(rec: rr.RecordingStream, branch: Branch, rows: Sequence[Row]) -> None:
    simulated = [r for r in rows if len(r.path)]
    if not simulated:
        return
    root, iterations = f"{entities.OBJECTS}/{branch.name}", [r.index for r in simulated]
    # Light touches stay visible: an arrow is at least 10 mm long.
    lengths = [np.maximum(ARROW_M_PER_N * r.contacts[:, 7:8], 0.01) for r in simulated]
    arrows = [
        columns.vectors(rr.Arrows3D.descriptor_origins(), [r.contacts[:, :3] for r in simulated], 3),
        columns.vectors(
            rr.Arrows3D.descriptor_vectors(),
            [r.contacts[:, 3:6] * n for r, n in zip(simulated, lengths, strict=True)],
            3,
        ),
    ]
    columns.send(rec, f"{root}/contacts", iterations, arrows)
    lines = [columns.strips(rr.LineStrips3D.descriptor_strips(), [r.path[:, :3, 3] for r in simulated])]
    columns.send(rec, f"{root}/path", iterations, lines)


_NOTHING = {
    "contacts": [
        columns.vectors(rr.Arrows3D.descriptor_origins(), [[]], 3),
        columns.vectors(rr.Arrows3D.descriptor_vectors(), [[]], 3),
    ],
    "path": [columns.strips(rr.LineStrips3D.descriptor_strips(), [[]])],
}


def _send_events(rec: rr.RecordingStream, branch: Branch, rows: Sequence[Row]) -> None:
    iterations = [r.index for r in rows]
    lane = [[branch.name, f"hypothesis {r.arm + 1}", r.accepted, _notable(r)] for r in rows]
    columns.send(rec, entities.LANE, iterations, [columns.texts(rr.StateChange.descriptor_state(), lane)])
    logged = [(r.index, kind, text) for r in rows for kind, text in zip(r.event_kinds, r.event_texts, strict=True)]
    if logged:
        parts = [
            columns.texts(rr.TextLog.descriptor_text(), [[text] for _, _, text in logged]),
            columns.texts(rr.TextLog.descriptor_level(), [[_LEVELS.get(kind, "INFO")] for _, kind, _ in logged]),
        ]
        columns.send(rec, entities.LOG, [k for k, _, _ in logged], parts)
    document = rr.TextDocument.descriptor_text()
    columns.send(rec, entities.CHOICE, iterations, [columns.texts(document, [[describe(r, branch)] for r in rows])])
    if rows[0].choice.shape[1]:
        columns.send(
            rec,
            entities.BANDIT,
            iterations,
            [columns.bars(rr.BarChart.descriptor_values(), [r.choice[3] for r in rows])],
        )


_LEVELS = {"score_fell": "WARN", "unstable": "WARN", "empty_render": "ERROR", "nan_score": "ERROR"}
_LEVELS |= {"refiner_stuck": "WARN", "no_physics": "WARN"}
_NOTABLE = ("nan_score", "empty_render", "unstable", "refiner_stuck", "score_fell", "edited", "new_best")
"""What the lane shows where several things happened, most important first."""


def _notable(row: Row) -> str:
    """One event per iteration for the lane; empty where nothing stands out."""
    return next((kind.replace("_", " ") for kind in _NOTABLE if kind in row.event_kinds), "")


@lru_cache(maxsize=64)
def _lane_styles(branch_names: tuple[str, ...], n_arms: int) -> tuple[Chunk, ...]:
    colors: dict[str, tuple[int, int, int]] = {name: (110, 110, 110) for name in branch_names}
    colors |= {f"hypothesis {j + 1}": ARM_COLORS[j % len(ARM_COLORS)] for j in range(n_arms)}
    colors |= {s: STAGE_COLORS[s] for s in ("current", "simulated", "mixed", "refined", "edited")}
    colors |= {kind.replace("_", " "): EVENT_COLORS[kind] for kind in _NOTABLE}
    return (
        columns.fixed(entities.LANE, rr.StateConfiguration(values=list(colors), colors=list(colors.values()))),
        columns.fixed(entities.CHOICE, rr.TextDocument.from_fields(media_type="text/markdown")),
    )
