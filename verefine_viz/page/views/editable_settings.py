"""The settings that a run can be restarted or forked with."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

import msgspec

from verefine_viz.core.presets import preset_fields
from verefine_viz.core.setting_types import descriptions, kinds_of
from verefine_viz.core.settings import POSES_GIVEN, SURROUNDINGS, Session
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.page.frame_messages import EditableSetting
from verefine_viz.physics.registry import simulator_names
from verefine_viz.refiners.registry import REFINERS
from verefine_viz.rendering.registry import verifier_names
from verefine_viz.run.session_file import AT_ITS_START, DURING_A_RUN, WITH_ITS_DATA

_COMMON = (
    "method.name", "method.refiner", "method.iterations", "method.exploration", "method.discount", "score.verifier",
    "score.pixels", "score.tau_m", "score.alpha", "score.colour_weight", "score.plausibility_weight", "physics.enabled",
    "physics.collider", "physics.steps", "icp.max_iterations", "tricp.trim", "dependency.rule", "hypotheses.seed",
)  # fmt: skip
"""What is changed most, first on the page."""


def editable_settings(session: Session) -> list[EditableSetting]:
    """Return every setting that holds one value, with what is allowed, those changed most first."""
    rows = []
    standard = msgspec.convert(preset_fields(session.preset, session.method.refiner), Session)
    for section in (*AT_ITS_START, *WITH_ITS_DATA):
        settings, usual = getattr(session, section), getattr(standard, section)
        texts = descriptions(type(settings))
        for name, kind in kinds_of(type(settings)).items():
            values = getattr(settings, name), getattr(usual, name)
            row = _row(f"{section}.{name}", kind, *values, " ".join(texts[name].split()))
            if row is not None:
                rows.append(row)
    order = {name: k for k, name in enumerate(_COMMON)}
    return sorted(rows, key=lambda row: order.get(row.name, len(order)))


def _row(name: str, of: Any, value: Any, standard: Any, text: str) -> EditableSetting | None:
    choices: list[Any] | None = None
    if name == "method.name":
        choices = list(ALL_METHOD_NAMES)
    elif name == "method.refiner":
        choices = list(REFINERS)
    elif name == "score.verifier":
        choices = list(verifier_names())
    elif name == "physics.simulator":
        choices = list(simulator_names())
    elif name == "hypotheses.source":
        choices = [*POSES_GIVEN, *ESTIMATORS]
    elif get_origin(of) is Literal:
        choices = list(get_args(of))
    if choices is not None and value not in choices:
        choices.insert(0, value)  # Such as trace, which is not chosen but opened.
    if isinstance(value, bool):
        kind = "bool"
    elif choices is not None:
        kind = "choice"
    elif isinstance(value, int | float):
        kind = "int" if of is int else "float"
    elif isinstance(value, str):
        kind = "text"
    else:
        return None
    return EditableSetting(
        name=name,
        kind=kind,
        value=value,
        standard=standard,
        choices=choices,
        common=name in _COMMON,
        can_fork=name.partition(".")[0] in DURING_A_RUN and name.rpartition(".")[2] not in SURROUNDINGS,
        help=text,
    )
