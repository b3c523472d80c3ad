"""The Settings panel: settings of the method, for a restart or a fork."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import viser

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import first_of
from verefine_viz.methods.registry import ALL_METHOD_NAMES, method_of
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.run.session_file import AT_ITS_START, changed, resolve
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import sentence
from verefine_viz.viewer.panels.widgets import Block, Send, add_style, by_user
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.branch import current_values, nested
from verefine_viz.viewer.text.display_names import shortened
from verefine_viz.viewer.web.viser_internals import compact, side_by_side, unlabelled

ROW_PX = 17
"""So that all settings fit into the panel."""
PAIRS = (
    ("method.iterations", "method.exploration"),
    ("score.tau_m", "score.alpha"),
    ("physics.enabled", "physics.steps"),
)
"""What shares a row."""
RIGHT_FROM_PX, LABEL_PX = 138, 58
ESTIMATORS: dict[str, Literal["ppf", "pcs", "densefusion", "session"]] = {
    "ppf": "ppf",
    "pcs": "pcs",
    "DenseFusion": "densefusion",
    "the session's": "session",
}
NAME_PX = 90
"""Room for an object's name in the button that estimates."""


class SettingsPanel:
    """Edits are only a draft until Restart or Fork is pressed.

    The boxes have no limits of their own: the page would put another number in place of what was typed without a word.
    """

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui, "brief tight")
        # Above the fields, so that it is in sight however many settings there are.
        self.apply = gui.add_button_group(
            "Apply", ["Restart with these", "Fork here"],
            hint="Restart: from before iteration 1 with these settings, without edited poses. "
            "Fork: keeps the iterations up to the cursor and goes on as a new branch",
        )  # fmt: skip
        self._fields: dict[str, Any] = {
            "method.name": gui.add_dropdown("Method", ALL_METHOD_NAMES, hint="the algorithm"),
            "method.refiner": gui.add_dropdown("Refiner", tuple(REFINERS), hint="what improves a pose"),
            "method.iterations": gui.add_number("K", 5, step=1, hint="K: refiner calls per hypothesis, on average"),
            "method.exploration": gui.add_number(
                "c", 0.7, step=0.01, hint="c: weight of UCB's bonus; the larger, the more is tried"
            ),
            "method.discount": gui.add_number(
                "γ", 0.99, step=0.01, hint="vf_depth: what a play of the pass before still counts"
            ),
            "score.pixels": gui.add_dropdown(
                "Pixels", ("classes", "published", "observed"), hint="which pixels count in the score"
            ),
            "score.tau_m": gui.add_number("τ [m]", 0.02, step=0.001, hint="depth tolerance of Eq. 1"),
            "score.alpha": gui.add_number(
                "α", 0.707, step=0.001, hint="α: normal tolerance; angles beyond acos(1 − α) count 0"
            ),
            "physics.enabled": gui.add_checkbox("Physics", True, hint="off: simulated pose = current pose"),
            "physics.steps": gui.add_number("Steps", 3, step=1, hint="simulation steps of 1/60 s per iteration"),
            "icp.max_iterations": gui.add_number("ICP its.", 10, step=1, hint="inner iterations per call"),
            "tricp.trim": gui.add_number("Trim", 1.0, step=0.05, hint="share of the observed points that the fit uses"),
            "dependency.rule": gui.add_dropdown(
                "Order by",
                ("recommended", "published"),
                hint="the rule that the order of the objects follows, where none is given; needs a restart",
            ),
            "hypotheses.seed": gui.add_number(
                "Seed", 0, step=1, hint="of the initial poses, disturbed ground truth; needs a restart"
            ),
        }
        self.estimator = gui.add_dropdown(
            "Estimator", tuple(ESTIMATORS),
            hint="point pair features, congruent point sets (Super4PCS), or back to the initial poses of the session",
        )  # fmt: skip
        self.estimate = gui.add_button(
            "Estimate here", hint="new initial poses for this object in this frame, as a new branch"
        )
        rows = (*self._fields.values(), self.estimator)
        pairs = ((self._fields[a], self._fields[b]) for a, b in PAIRS)
        rules = [compact(row, ROW_PX) for row in rows] + [unlabelled(self.apply)]
        rules += [side_by_side(left, right, ROW_PX, RIGHT_FROM_PX, LABEL_PX) for left, right in pairs]
        add_style(gui, *rules)
        self._labels = {name: handle.label for name, handle in self._fields.items()}
        for handle in self._fields.values():
            handle.on_update(by_user(lambda _: self._show_words()))
        self._snapshot: Snapshot | None = None
        self._known: dict[str, Any] = {}
        self._focus = 0

        def estimate(_: bool) -> None:
            send(c.Estimate(self._focus, ESTIMATORS[self.estimator.value]))

        self.estimate.on_click(by_user(estimate))
        self.estimator.on_update(by_user(lambda _: self._label_estimate()))

        def apply(label: str) -> None:
            changes = tuple((k, f.value) for k, f in self._fields.items() if f.value != self._known.get(k))
            send(c.Fork(changes) if label == "Fork here" else c.Restart(changes))

        self.apply.on_click(by_user(apply))

    def show(self, snapshot: Snapshot) -> None:
        """The settings that hold at the end of this branch; drafts are kept until those change."""
        values = dict(current_values(snapshot.session, tuple(self._fields)))
        if values != self._known:
            self._known = values
            for name, handle in self._fields.items():
                # A recording may name a refiner that this program does not have.
                if isinstance(handle, viser.GuiDropdownHandle) and values[name] not in handle.options:
                    handle.options = (*handle.options, values[name])
                handle.value = values[name]
        self._snapshot = snapshot
        self._show_words()
        self._focus = snapshot.target.instance.instance_id
        self._label_estimate()
        self._fields["method.discount"].visible = method_of(snapshot.session.method.name).has_passes
        self._fields["tricp.trim"].visible = snapshot.session.method.refiner == "trimmed_icp"
        self._fields["icp.max_iterations"].visible = snapshot.session.method.refiner in ("icp", "depth_net_icp")
        self._fields["dependency.rule"].visible = len(snapshot.problem.instances) > 1
        self._fields["hypotheses.seed"].visible = snapshot.session.hypotheses.source == "perturb"

    @property
    def waiting(self) -> tuple[str, ...]:
        """What was typed and waits for Restart or Fork, in words."""
        return () if self._snapshot is None else waiting(self._snapshot.session, self._labels, self._typed)

    @property
    def _typed(self) -> dict[str, Any]:
        return {name: handle.value for name, handle in self._fields.items()}

    def _label_estimate(self) -> None:
        """What the button does with the object in focus."""
        if self._snapshot is not None:
            does = "Restore" if ESTIMATORS[self.estimator.value] == "session" else "Estimate"
            self.estimate.label = f"{does} {shortened(self._snapshot.name, NAME_PX)} here"

    def _show_words(self) -> None:
        """What holds, and what was typed since."""
        if self._snapshot is not None:
            words = settings_words(self._snapshot.session, self._labels, self._typed, self._snapshot.cursor)
            self._words.show(sentence(words))


# The sentence above the settings: what holds now that is not usual, and what a change that was typed will do.

MOST = 3
"""Settings that are named; of more only how many."""


def settings_words(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any], cursor: int) -> str:
    """As in: As recommended, but c 0.4, not 0.7.

    Args:
        session: the settings that hold.
        labels: by dotted name of a setting, what the panel calls it.
        typed: values in the fields by dotted name.
        cursor: the iteration that a fork would go on from.
    """
    held = current_values(session, tuple(labels))
    changes = waiting(session, labels, typed)
    if mistake := _mistake(session, labels, typed):
        return f"{mistake}. Restart and Fork would refuse it."
    if changes:
        fork = (
            f"keeps iterations 1 to {cursor}" if cursor > 1 else "keeps iteration 1" if cursor else "is the same here"
        )
        return f"Not in use yet: {first_of(changes, MOST)}. Restart starts again with it; Fork {fork}."
    usual = current_values(resolve({"preset": session.preset}), tuple(labels))
    other = [
        f"{labels[name]} {_shown_value(held[name])}, not {_shown_value(usual[name])}"
        for name in labels
        if held[name] != usual[name]
    ]
    of = "as published" if session.preset == "published" else "as recommended"
    if not other:
        return f"All {of}."
    return f"{of.capitalize()}, but {first_of(other, MOST, '; ')}."


def waiting(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> tuple[str, ...]:
    """What was typed and is not in use yet, as in: c 0.7 → 0.4. Takes what :func:`settings_words` does."""
    held = current_values(session, tuple(labels))
    return tuple(
        f"{labels[name]} {_shown_value(held[name])} → {_shown_value(value)}"
        for name, value in typed.items()
        if value != held[name]
    )


def _mistake(session: Session, labels: Mapping[str, str], typed: Mapping[str, Any]) -> str | None:
    """What is wrong with the first value that no run can have, as in: K = -3: input should be greater than …"""
    held = current_values(session, tuple(labels))
    for name, value in typed.items():
        try:
            if value != held[name]:
                changed(session, nested(((name, value),)), (*AT_ITS_START, "hypotheses"))
        except SettingsError as error:
            return str(error).removeprefix("changed settings: ").replace(name, labels[name])
    return None


def _shown_value(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, int | float) else str(value)
