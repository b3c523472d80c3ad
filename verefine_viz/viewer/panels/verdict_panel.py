"""The verdict bar: one line above the pictures, and on a click why, over the page."""

from __future__ import annotations

import secrets
from collections.abc import Sequence

import viser

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Instance
from verefine_viz.pictures.answer_pictures import in_uri, thumbnail
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.drawing.markup import carries, link, sentence, text, warning
from verefine_viz.viewer.panels.widgets import Block, add_style
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.findings import Note, findings
from verefine_viz.viewer.text.headline import HINTS, headline
from verefine_viz.viewer.text.verdict import Verdict, verdict

CROP_PX = 240
"""Width of the crop of the photo; the bar shows it smaller."""
PROGRAM = secrets.token_hex(4)
"""Tells a page that is reloaded whether the program is still the one that it showed."""
CHAIN = (
    '<svg viewBox="0 0 16 16" width="14" height="14" fill="none" stroke="currentColor" stroke-width="1.6">'
    '<path d="M7 9.5a3 3 0 0 0 4.2 0l2-2a3 3 0 0 0-4.2-4.2l-1 1"/>'
    '<path d="M9 6.5a3 3 0 0 0-4.2 0l-2 2a3 3 0 0 0 4.2 4.2l1-1"/></svg>'
)
"""Two links of a chain."""
KINDS = {"✓": "right", "✗": "wrong", "?": "unknown", "…": "going"}
"""By mark, the bar's class."""


class VerdictPanel:
    """Mark, number and cause; the rest opens on a click, and page.js keeps it open while the content changes."""

    def __init__(self, gui: viser.GuiApi) -> None:
        add_style(gui, asset("verdict.css"))
        self._bar = Block(gui, "verdict")
        self._pictured: tuple[Instance, bytes] | None = None
        self._picture = ""

    def show(self, snapshot: Snapshot) -> None:
        """The verdict at once; a new crop comes with the score maps."""
        it = verdict(snapshot)
        warnings = findings(snapshot)
        crop = self._crop(it, snapshot.deep)
        why, n_warnings = why_html(snapshot, it, warnings), sum(not one.calm for one in warnings)
        self._bar.show(bar_html(it, crop, why, n_warnings, snapshot.link, named_object(snapshot, it)))

    def _crop(self, it: Verdict, draws: bool) -> str:
        """A data URI; "" where there is none, or not yet."""
        if it.pictured is None:
            return ""
        target, T_cam_obj = it.pictured
        instance, pose = target.instance, T_cam_obj.tobytes()
        if self._pictured is None or self._pictured[0] is not instance or self._pictured[1] != pose:
            if not draws:
                return ""
            self._pictured = instance, pose
            try:
                self._picture = in_uri(thumbnail(target, T_cam_obj, CROP_PX))
            except VerefineError:  # The words do without it.
                self._picture = ""
        return self._picture


def named_object(snapshot: Snapshot, it: Verdict) -> c.Focus | None:
    """What filters the page to the one object that a verdict on several names; None = the verdict is on one alone."""
    if it.pictured is None or len(snapshot.finished) < 2 or snapshot.options.focus is not None:
        return None
    return c.Focus(it.pictured[0].instance.instance_id)


def bar_html(
    it: Verdict, crop: str, why: str, n_warnings: int = 0, page_link: str = "", named: c.Focus | None = None
) -> str:
    """The bar, and behind it what opens on a click; ``crop`` is a data URI, ``why`` HTML with so many warnings.

    ``page_link`` is what the page's address gets behind its #, which `assets/page_link.js` reads here. ``named`` is
    sent by a click on the words or the picture.
    """
    picture = f'<img src="{crop}" alt="the answer on the photo">' if crop else ""
    look = link(it.look_at[0], it.look_at[1], "go there") if it.look_at is not None else ""
    done = f'<i class="done" style="width:{100 * it.share:.1f}%"></i>' if it.share is not None else ""
    count = f" ({n_warnings})" if n_warnings else ""
    jump, tip = (carries(named), "; click: show this object") if named is not None else ("", "")
    return (
        f'<div class="bar-line {KINDS[it.mark]}">{done}<b class="mark">{it.mark}</b>'
        f'<b class="number" title="{text(it.number_means)}">{text(it.number)}</b>'
        f'<span class="cause" {jump} title="{text(it.line)}{tip}">{text(it.cause)}</span>{look}'
        f'<span class="crop" {jump} title="{text(it.line)}{tip}">{picture}</span>'
        f'<button class="copy-link" data-link="{text(page_link)}" data-program="{PROGRAM}" '
        f'title="copy a link to this frame, object and iteration">{CHAIN}</button>'
        f'<button class="why" title="evidence and numbers">why{count}</button></div>'
        f'<div class="because">{picture}{why}</div>'
    )


def why_html(snapshot: Snapshot, it: Verdict, warnings: Sequence[Note]) -> str:
    """The evidence: what happened at the cursor in full, and everything that may be wrong, with what to do."""
    means = f'<p class="dim">{text(it.number)}: {text(it.number_means)}.</p>' if it.number_means else ""
    if it.about is not None:  # The evidence of what the bar says comes first.
        warnings = sorted(warnings, key=lambda finding: finding.cause != it.about)
    return f"{means}{sentence(headline(snapshot), HINTS)}{finding_boxes(warnings)}"


def finding_boxes(warnings: Sequence[Note]) -> str:
    """A box each; what is good to know without one."""
    boxes = []
    for finding in warnings:
        extra = link(finding.label, finding.command) if finding.command else ""
        if finding.calm:
            boxes.append(f'<p class="dim">{text(finding.text)} {extra}</p>')
        else:
            boxes.append(warning(finding.text, extra, finding.red))
    return "".join(boxes)
