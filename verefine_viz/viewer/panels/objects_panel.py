"""The Objects panel: one row per object in the order to solve them; a click filters the page to that object."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import Row, cut, fitted, link, number, sentence, swatch, table, text
from verefine_viz.viewer.drawing.plausibility_picture import LIGHT_MEANING, LIGHTS
from verefine_viz.viewer.panels.widgets import Block, Send
from verefine_viz.viewer.snapshot.scene_state import ObjectState, Phase
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import TERMS, arm_color, arm_name, is_correct, verdict_mark
from verefine_viz.viewer.text.plausibility_verdict import (
    plausibility_verdict,
    unsupported_stacking,
    unsupported_stacking_hint,
)
from verefine_viz.viewer.text.scene import objects_words, overlap_sentence

PHASES: dict[Phase, tuple[str, str]] = {
    "waiting": ("waiting", "its turn is still to come"),
    "working": ("<b>working</b>", "the iteration at the cursor is about it"),
    "placed": ("placed", "it stands in the scene while others are worked on"),
    "rolled out": ("roll-out", "the search completed the scene with it, drawn as a ghost"),
    "done": ("done", "it has used its budget, or the run is over"),
    "no pose": ("no pose", "it has no hypothesis, so it is left out"),
}
ROW_PX, HEAD_PX, MOST_PX = 17, 226, 388
MOST_OVERLAPS = 3


class ObjectsPanel:
    """The table, collisions in words, and what the page is filtered to."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._rows = Block(gui, "objects brief")

    def show(self, snapshot: Snapshot) -> None:
        """All objects at the cursor."""
        self._rows.show(objects_html(snapshot))


def height_px(n_objects: int) -> int:
    """How tall the panel has to be to show every row."""
    return min(HEAD_PX + ROW_PX * n_objects, MOST_PX)


def objects_html(snapshot: Snapshot) -> str:
    """The whole content of the panel."""
    said = sentence(objects_words(snapshot))
    return f"{said}{filter_line(snapshot)}{objects_table(snapshot)}{legend(snapshot)}{overlap_lines(snapshot)}"


def filter_line(snapshot: Snapshot) -> str:
    """What the panels show, and how to change that."""
    follow = link("follow the run", c.Focus(None), "always show the object that is worked on")
    if snapshot.is_whole_scene:
        return f"<p>Showing the <b>whole scene</b> · {follow}</p>"
    if snapshot.options.focus is not None:
        name = snapshot.scene.object(snapshot.target.instance.instance_id).label
        return f"<p>Filtered to <b>{cut(name, 125)}</b> · {follow}</p>"
    return '<p class="dim">Panels follow the run; a click filters them.</p>'


def objects_table(snapshot: Snapshot) -> str:
    """A row for the scene, then one per object; a thicker line between clusters."""
    scene = snapshot.scene
    rows = [_scene_row(snapshot)]
    grouped = 1 < scene.n_clusters < len(scene.objects)
    for k, o in enumerate(scene.objects):
        first = grouped and k > 0 and scene.objects[k - 1].cluster != o.cluster
        rows.append(_object_row(snapshot, o, grouped, first))
    head = [
        ("", "place in the order to solve them" + ("; cluster.place" if grouped else "")),
        ("object", "click a row to filter the page to it"),
        ("", "plausibility of the pose among the others: could it lie still like that? Not how far off it is."),
        ("score", "of the answer so far"),
        ("mm", "ADD(-S) of the answer against ground truth [mm]; bold = within 10 % of the diameter, ✗ = not"),
        ("it.", "iterations spent on it up to the cursor"),
        ("hyp.", "the hypothesis that became the answer") if snapshot.is_answer
        else ("state", "waiting, working, placed or done"),
    ]  # fmt: skip
    if not _has_errors(snapshot):
        head = [column for column in head if column[0] != "mm"]
    return table(head, rows)


def _has_errors(snapshot: Snapshot) -> bool:
    """Whether there is ground truth to compare with."""
    return any(o.errors is not None for o in snapshot.scene.objects)


def _scene_row(snapshot: Snapshot) -> Row:
    scene, latest = snapshot.scene, snapshot.scene.latest_pass
    score = snapshot.frame_score.score if snapshot.frame_score else None
    phase = "" if snapshot.is_answer else f"pass {latest.number}" if latest else ""
    tip = text(f"frame score: {TERMS['frame score']}")
    shown = f'<span title="{tip}">{number(score, 2)}</span>'
    spent = f"{sum(o.n_iterations for o in scene.objects)}"
    errors = [_scene_error(snapshot)] if _has_errors(snapshot) else []
    cells = ["", f'<b title="{tip}; click for all objects">Frame</b>', "", shown, *errors, spent, phase]
    return Row(cells, c.ShowScene(), marked=snapshot.is_whole_scene)


def _scene_error(snapshot: Snapshot) -> str:
    known = [is_correct(o.errors) for o in snapshot.scene.objects if o.errors is not None]
    return f'<span title="so many are within 10 % of their diameter">{sum(known)}/{len(known)} ✓</span>'


def _object_row(snapshot: Snapshot, o: ObjectState, grouped: bool, first_of_cluster: bool) -> Row:
    pinned = snapshot.options.focus is not None and not snapshot.is_whole_scene
    in_focus = not snapshot.is_whole_scene and o.instance_id == snapshot.target.instance.instance_id
    order = o.order
    if grouped:
        order = f"{o.cluster}.{1 + sum(p.cluster == o.cluster and p.order < o.order for p in snapshot.scene.objects)}"
    label, tip = PHASES[o.phase]
    error = "" if o.errors is None else f"{o.errors.add_s_mm:.1f}"
    error = f"<b>{error}</b>" if is_correct(o.errors) else f"{error} {verdict_mark(o.errors)}".strip()
    cells = [
        f"{order}",
        fitted(o.label, f"{swatch(o.color)}{_sinks(snapshot, o)}"),
        _light(snapshot, o),
        number(o.answer.score.score if o.answer else None, 2),
        *([error] if _has_errors(snapshot) else []),
        f"{o.n_iterations}",
        _winner(o) if snapshot.is_answer and o.answer is not None else f'<span title="{text(tip)}">{label}</span>',
    ]
    return Row(cells, c.Focus(None if pinned and in_focus else o.instance_id), marked=in_focus, parted=first_of_cluster)


def _winner(o: ObjectState) -> str:
    """Which hypothesis became the answer, and when."""
    assert o.answer is not None
    arm, found = o.answer.arm, o.answer.iteration
    when = f"iteration {found}, {o.answer.stage}" if found else "its initial pose"
    return f'<span title="{text(f"{arm_name(o.target, arm)}, {when}")}">{swatch(arm_color(arm))}{arm + 1}</span>'


def _sinks(snapshot: Snapshot, o: ObjectState) -> str:
    """A mark before the name of what stands on other objects that the method does not know of; a name may be cut."""
    why = unsupported_stacking_hint(snapshot, o.instance_id)
    return f'<b class="sinks" title="{text(why)}">⤓</b> ' if why else ""


def _light(snapshot: Snapshot, o: ObjectState) -> str:
    found = snapshot.physics.plausible.get(o.instance_id)
    if found is None:
        why = "no pose, or no support plane known" if snapshot.physics.complete else "being worked out"
        return f'<span class="dim" title="{why}">…</span>' if not snapshot.physics.complete else "–"
    said = plausibility_verdict(found, o, snapshot.scene)
    return _dot(said.light, text(f"{LIGHT_MEANING[said.light][0]}: {said.sentence}"))


def overlap_lines(snapshot: Snapshot) -> str:
    """Collisions in words, the deepest first."""
    found = snapshot.physics.overlaps
    lines = [f'<p class="bad">{text(overlap_sentence(one, snapshot.scene))}.</p>' for one in found[:MOST_OVERLAPS]]
    if len(found) > MOST_OVERLAPS:
        lines.append(f'<p class="dim">{len(found) - MOST_OVERLAPS} more overlaps.</p>')
    return "".join(lines)


def legend(snapshot: Snapshot) -> str:
    """What the lights mean, and how objects are drawn in 3D."""
    judged = {
        plausibility_verdict(found, snapshot.scene.object(i), snapshot.scene).light
        for i, found in snapshot.physics.plausible.items()
    }
    shown = judged | LIGHTS.keys() - {"grey"}
    lights = " ".join(
        f'<span title="{text(LIGHT_MEANING[light][1])}">{_dot(light)} {LIGHT_MEANING[light][0]}</span>'
        for light in LIGHTS
        if light in shown
    )
    drawn = "3D: the answer" if snapshot.is_answer else "3D: placed ones solid, waiting ones as ghosts"
    drawn = f"{drawn}, overlaps red" if snapshot.comparison is None else "3D: A solid, B as an outline"
    tip = "Could it lie still like that, by gravity and contact? A wrong pose can be green."
    sinks = (
        '<p class="legend"><b class="sinks">⤓</b> stands on others, sinks here: hover</p>'
        if unsupported_stacking(snapshot)
        else ""
    )
    return f'<p class="legend" title="{tip}">Physics, not error: {lights}</p>{sinks}<p class="legend dim">{drawn}.</p>'


def _dot(light: str, tip: str = "") -> str:
    return f'<i class="light" style="background:rgb{LIGHTS[light]}" title="{tip}"></i>'
