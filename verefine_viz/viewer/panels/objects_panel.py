"""The Objects panel: one row per object in the order to solve them; a click filters the page to that object."""

from __future__ import annotations

import viser

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import Row, cut, fitted, link, number, swatch, table, text
from verefine_viz.viewer.drawing.plausibility_picture import LIGHT_MEANING, LIGHTS
from verefine_viz.viewer.panels.widgets import Block
from verefine_viz.viewer.snapshot.scene_state import ObjectState, Phase
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import (
    TERMS,
    arm_color,
    arm_name,
    in_focus,
    is_correct,
    method_name,
    verdict_mark,
)
from verefine_viz.viewer.text.plausibility_verdict import plausibility_verdict, unsupported_stacking

PHASES: dict[Phase, tuple[str, str]] = {
    "waiting": ("waiting", "its turn is still to come"),
    "working": ("<b>working</b>", "the iteration at the cursor is about it"),
    "placed": ("placed", "it stands in the scene while others are worked on"),
    "rolled out": ("roll-out", "the search completed the scene with it, drawn as a ghost"),
    "done": ("done", "it has used its budget, or the run is over"),
    "no pose": ("no pose", "it has no hypothesis, so it is excluded"),
}
MOST_OVERLAPS = 3


class ObjectsPanel:
    """What the page is filtered to, the table, its legend and collisions in words."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._rows = Block(gui, "objects brief")

    def show(self, snapshot: Snapshot) -> None:
        """All objects at the cursor."""
        self._rows.show(objects_html(snapshot))


def objects_html(snapshot: Snapshot) -> str:
    """The whole content of the panel."""
    return f"{filter_line(snapshot)}{objects_table(snapshot)}{legend(snapshot)}{overlap_lines(snapshot)}"


def filter_line(snapshot: Snapshot) -> str:
    """What the panels show, and how to change that."""
    follow = link("follow the run", c.Focus(None), "always show the object that is worked on")
    if snapshot.is_whole_scene:
        return f"<p>Showing the <b>whole scene</b> · {follow}</p>"
    if snapshot.options.focus is not None:
        return f"<p>Filtered to <b>{cut(in_focus(snapshot).label, 125)}</b> · {follow}</p>"
    return ""


def objects_table(snapshot: Snapshot) -> str:
    """A row for the scene, then one per object; a thicker line between clusters."""
    scene = snapshot.scene
    grouped = 1 < scene.n_clusters < len(scene.objects)
    has_errors = any(o.errors is not None for o in scene.objects)
    stacked = unsupported_stacking(snapshot)
    rows = [_scene_row(snapshot, has_errors)]
    before = None
    for o in scene.objects:
        parted = grouped and before is not None and before.cluster != o.cluster
        sinks = ""
        if o.instance_id in stacked:
            method = method_name(snapshot.session.method.name)
            why = f"{stacked[o.instance_id]}; {method} settles it on the table alone, so it sinks"
            sinks = f'<b class="sinks" title="{text(why)}">⤓</b> '  # Before the name, which may be cut.
        rows.append(_object_row(snapshot, o, grouped, has_errors, sinks, parted))
        before = o
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
    return table([column for column in head if has_errors or column[0] != "mm"], rows)


def _scene_row(snapshot: Snapshot, has_errors: bool) -> Row:
    objects, latest = snapshot.scene.objects, snapshot.scene.latest_pass
    score = snapshot.frame_score.score if snapshot.frame_score else None
    tip = text(f"frame score: {TERMS['frame score']}")
    known = [is_correct(o.errors) for o in objects if o.errors is not None]
    n_right = f'<span title="so many are within 10 % of their diameter">{sum(known)}/{len(known)} ✓</span>'
    cells = [
        "",
        f'<b title="{tip}; click for all objects">Frame</b>',
        "",
        f'<span title="{tip}">{number(score, 2)}</span>',
        *([n_right] if has_errors else []),
        f"{sum(o.n_iterations for o in objects)}",
        f"pass {latest.number}" if latest and not snapshot.is_answer else "",
    ]
    return Row(cells, c.ShowScene(), marked=snapshot.is_whole_scene)


def _object_row(snapshot: Snapshot, o: ObjectState, grouped: bool, has_errors: bool, sinks: str, parted: bool) -> Row:
    is_focus = not snapshot.is_whole_scene and o.instance_id == snapshot.target.instance.instance_id
    order = f"{o.order}"
    if grouped:
        order = f"{o.cluster}.{1 + sum(p.cluster == o.cluster and p.order < o.order for p in snapshot.scene.objects)}"
    error = "" if o.errors is None else f"{o.errors.add_s_mm:.1f}"
    error = f"<b>{error}</b>" if is_correct(o.errors) else f"{error} {verdict_mark(o.errors)}".strip()
    label, tip = PHASES[o.phase]
    if snapshot.is_answer and o.answer is not None:
        arm, iteration = o.answer.arm, o.answer.iteration
        label = f"{swatch(arm_color(arm))}{arm + 1}"
        when = f"iteration {iteration}, {o.answer.stage}" if iteration else "its initial pose"
        tip = f"{arm_name(o.target, arm)}, {when}"
    cells = [
        order,
        fitted(o.label, f"{swatch(o.color)}{sinks}"),
        _light(snapshot, o),
        number(o.answer.score.score if o.answer else None, 2),
        *([error] if has_errors else []),
        f"{o.n_iterations}",
        f'<span title="{text(tip)}">{label}</span>',
    ]
    follows_run = is_focus and snapshot.options.focus is not None
    return Row(cells, c.Focus(None if follows_run else o.instance_id), marked=is_focus, parted=parted)


def _light(snapshot: Snapshot, o: ObjectState) -> str:
    plausibility = snapshot.physics.plausible.get(o.instance_id)
    if plausibility is None:
        return "–" if snapshot.physics.complete else '<span class="dim" title="being worked out">…</span>'
    verdict = plausibility_verdict(plausibility, o, snapshot.scene)
    return _dot(verdict.light, text(f"{LIGHT_MEANING[verdict.light][0]}: {verdict.sentence}"))


def _dot(light: str, tip: str = "") -> str:
    return f'<i class="light" style="background:rgb{LIGHTS[light]}" title="{tip}"></i>'


def legend(snapshot: Snapshot) -> str:
    """What the lights mean, and how objects are drawn in 3D."""
    scene = snapshot.scene
    lit = {plausibility_verdict(p, scene.object(i), scene).light for i, p in snapshot.physics.plausible.items()}
    lights = " ".join(
        f'<span title="{text(LIGHT_MEANING[light][1])}">{_dot(light)} {LIGHT_MEANING[light][0]}</span>'
        for light in LIGHTS
        if light in lit or light != "grey"
    )
    tip = "Could it lie still like that, by gravity and contact? Not how far off it is: a wrong pose can be stable."
    sinks = ""
    if unsupported_stacking(snapshot):
        sinks = (
            '<p class="legend" title="stands on others, which the method does not know: it sinks in the simulation">'
        )
        sinks += '<b class="sinks">⤓</b> sinks</p>'
    return f'<p class="legend" title="{tip}">Physically: {lights}</p>{sinks}'


def overlap_lines(snapshot: Snapshot) -> str:
    """Collisions in words, as in: can sinks 12 mm into box. The deepest first."""
    overlaps, names = snapshot.physics.overlaps, {o.instance_id: o.label for o in snapshot.scene.objects}
    lines = [
        f'<p class="bad">{text(names.get(one.first, "object"))} sinks {one.depth_mm:.0f} mm into '
        f"{text(names.get(one.second, 'object'))}.</p>"
        for one in overlaps[:MOST_OVERLAPS]
    ]
    if len(overlaps) > MOST_OVERLAPS:
        lines.append(f'<p class="dim">{len(overlaps) - MOST_OVERLAPS} more overlaps.</p>')
    return "".join(lines)
