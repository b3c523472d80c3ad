"""Iterations as rerun draws them: poses, contacts, curves, bandit, events, text; one batch per entity for many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, EVENT_COLORS, STAGE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.core.records import NO_CONTACTS, EventKind, Iteration
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.recording import curves, entities
from verefine_viz.recording.block import Block, last_contacts
from verefine_viz.recording.drawn_poses import Poses
from verefine_viz.recording.graphs import TreeGraphs
from verefine_viz.recording.iteration_text import describe
from verefine_viz.recording.layout import Layout, ObjectBranch
from verefine_viz.recording.recording_file import RecordingFile
from verefine_viz.run.iteration_words import sentence

ARROW_M_PER_N = 0.002
"""Length of a contact's arrow; 1 kg at rest presses with 9.81 N."""
CONTACT_COLOR, COLLISION_COLOR = 0xFFE650FF, 0xFF5A3CFF
"""With the support, and with another object."""
_NO_PATH = np.zeros((0, 4, 4))


class Drawing:
    """Draws iterations in order, block by block; remembers what the next block needs of the ones before."""

    def __init__(self, layout: Layout, targets: Mapping[int, Target], refiner: str) -> None:
        """``targets``: the objects, by instance; ``refiner``: name of the session's."""
        self._layout, self._targets, self._refiner = layout, targets, refiner
        self._labels = {branch.instance_id: branch.name for branch in layout.branches}
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
            path_style = rr.LineStrips3D.from_fields(colors=[STAGE_COLORS["simulated"]], radii=[0.0008])
            file.log(entities.simulated_path(branch.name), path_style)
        self._poses.start(file)
        if self._layout.has_choice:
            _log_bars(file, self._layout)
        file.log(entities.LANE, _lane_style(self._layout))
        file.log(entities.CHOICE, rr.TextDocument.from_fields(media_type="text/markdown"))
        if self._layout.is_scene or self._layout.has_tree:
            curves.log_scene_styles(file, self._layout)
            curves.send_initial_best(file, self._layout)
        if self._layout.has_tree:
            file.log(entities.TREE, rr.GraphEdges.from_fields(graph_type="directed"))

    def draw(self, file: RecordingFile, iterations: Sequence[Iteration], errors: Float) -> None:
        """Draw iterations, which follow the ones before without a gap; ``errors`` as :class:`Block` takes them."""
        block = Block(iterations, errors)
        turns = self._turns(block.iterations)
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
        words = [sentence(i, self._targets[i.instance_id], self._refiner, self._labels) for i in block.iterations]
        _send_events(file, self._layout, block, words)
        _send_choices(file, block)

    def _turns(self, iterations: Sequence[Iteration]) -> dict[int, list[int]]:
        """Iterations at which another object's turn begins, by the object whose turn that ends."""
        turns: dict[int, list[int]] = {}
        for i in iterations:
            if self._worked_on is not None and self._worked_on != i.instance_id:
                turns.setdefault(self._worked_on, []).append(i.index)
            self._worked_on = i.instance_id
        return turns


def _send_contacts(
    file: RecordingFile, branch: ObjectBranch, iterations: Sequence[Iteration], turns: Sequence[int]
) -> None:
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
    hits = np.concatenate([c.others for c in contacts]) != SUPPORT_ID
    colors = np.where(hits, COLLISION_COLOR, CONTACT_COLOR).astype(np.uint32)
    arrows = rr.Arrows3D.columns(origins=origins, vectors=normals * lengths_m[:, None], colors=colors)
    file.send(entities.contacts(branch.name), indices, arrows.partition(lengths))
    lines = rr.LineStrips3D.columns(strips=[path[:, :3, 3] for path in paths if len(path)])
    file.send(entities.simulated_path(branch.name), indices, lines.partition([min(len(path), 1) for path in paths]))


def _send_events(file: RecordingFile, layout: Layout, block: Block, words: Sequence[str]) -> None:
    lane: list[str] = []
    for i in block.iterations:
        notable = _notable([event.kind for event in i.events])
        lane += [layout.branch(i.instance_id).name, f"hypothesis {i.arm + 1}", i.accepted, notable]
    file.send(entities.LANE, block.indices, rr.StateChange.columns(state=lane).partition([4] * len(block.indices)))
    events = [(i.index, event) for i in block.iterations for event in i.events]
    if events:
        levels = [_LEVELS.get(event.kind, "INFO") for _, event in events]
        log = rr.TextLog.columns(text=[event.text for _, event in events], level=levels)
        file.send(entities.LOG, [k for k, _ in events], log)
    rows = zip(block.iterations, words, block.errors.tolist(), block.motions(), strict=True)
    texts = [describe(iteration, layout, did, errors, *motions) for iteration, did, errors, motions in rows]
    file.send(entities.CHOICE, block.indices, rr.TextDocument.columns(text=texts))


def _log_bars(file: RecordingFile, layout: Layout) -> None:
    """Colours and names of the bars of :func:`_send_choices`."""
    arms = range(max((b.n_arms for b in layout.branches), default=0))
    colors, labels = [ARM_COLORS[j % len(ARM_COLORS)] for j in arms], [f"h{j + 1}" for j in arms]
    style = rr.Boxes2D.from_fields(colors=colors, labels=labels, show_labels=len(arms) <= BARS_WITH_NAMES)
    file.log(entities.BANDIT, style)


def _send_choices(file: RecordingFile, block: Block) -> None:
    """The UCB of each hypothesis as bars, in its colour. The numbers are those of the curves."""
    choices = [(i.index, i.choice.ucb) for i in block.iterations if i.choice is not None]
    if not choices:
        return
    n_bars = [len(ucb) for _, ucb in choices]
    heights = np.concatenate([_bar_heights(ucb) for _, ucb in choices])
    at = np.concatenate([np.arange(n) for n in n_bars])
    bars = rr.Boxes2D.columns(
        half_sizes=np.column_stack([np.full(len(at), 0.4), heights / 2]),
        centers=np.column_stack([at + 0.5, -heights / 2]),
    )
    file.send(entities.BANDIT, [k for k, _ in choices], bars.partition(n_bars))


def _bar_heights(ucb: Float) -> Float:
    """(n,) from the lowest, so that differences of scores around 0.7 are seen; what was never played has no number and
    is as high as the highest.
    """
    known = ucb[np.isfinite(ucb)]
    lowest, highest = (known.min(), known.max()) if len(known) else (0.0, 0.0)
    above = np.where(np.isfinite(ucb), ucb, highest) - lowest
    return BAR_HEIGHT * len(ucb) * (0.05 + 0.95 * above / max(highest - lowest, 1e-12))


BAR_HEIGHT = 0.4
"""Height of the highest bar, as a share of the width of all."""
BARS_WITH_NAMES = 30


_LEVELS = {"score_fell": "WARN", "unstable": "WARN", "empty_render": "ERROR", "nan_score": "ERROR"}
_LEVELS |= {"refiner_stuck": "WARN", "no_physics": "WARN", "physics_worse": "WARN"}
_NOTABLE = {
    "nan_score": "NaN",
    "empty_render": "empty",
    "unstable": "tipped",
    "physics_worse": "worse",
    "refiner_stuck": "stuck",
    "score_fell": "fell",
    "flipped": "flip",
    "edited": "edited",
    "new_best_scene": "scene",
    "new_best": "best",
}
"""What the lane shows where several things happened, most important first, and how it is written where there is little
space."""


def _notable(kinds: Sequence[EventKind]) -> str:
    """The one of an iteration's events for the lane; empty where nothing stands out."""
    return next((kind.replace("_", " ") for kind in _NOTABLE if kind in kinds), "")


def _lane_style(layout: Layout) -> rr.StateConfiguration:
    colors = dict(zip(layout.names, layout.colors.values(), strict=True))
    labels = {name: name for name in layout.names}
    for j in range(max((b.n_arms for b in layout.branches), default=0) + 1):
        colors[f"hypothesis {j + 1}"], labels[f"hypothesis {j + 1}"] = ARM_COLORS[j % len(ARM_COLORS)], f"h{j + 1}"
    for stage, short in _SHORT_STAGES.items():
        colors[stage], labels[stage] = STAGE_COLORS[stage], short
    for kind, short in _NOTABLE.items():
        name = kind.replace("_", " ")
        colors[name], labels[name] = EVENT_COLORS[kind], short
    return rr.StateConfiguration(values=list(colors), labels=list(labels.values()), colors=list(colors.values()))


_SHORT_STAGES = {"current": "cur", "simulated": "sim", "mixed": "mix", "refined": "ref", "flipped": "flip"}
_SHORT_STAGES |= {"edited": "edit"}
