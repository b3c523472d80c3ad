"""How the page names things: methods, hypotheses, stages, scores; and what fits of a name into little room."""

from __future__ import annotations

import re
from collections.abc import Sequence

from verefine_viz.core.palette import ARM_COLORS, RGB
from verefine_viz.core.problem import Hypothesis, Target
from verefine_viz.core.surroundings import SUPPORT_ID, unknown_number
from verefine_viz.evaluation.matched_estimates import CORRECT
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.scene_state import ObjectState
from verefine_viz.viewer.snapshot.snapshot import Snapshot

TERMS = {
    "frame score": "all objects of the frame at their answers so far, rendered together",
    "pass score": "the objects of one cluster as one pass over them left them, rendered together",
    "incumbent": "the highest score at which the objects of one cluster were ever rendered together: their answer",
}
"""Scores of several objects, and what each is of."""

STAGE_MEANINGS = {
    "initial": "where the hypothesis started",
    "current": "where this iteration started",
    "simulated": "after physics",
    "mixed": "rotation of simulated, translation of current: where the refiner starts",
    "refined": "after the refiner",
    "flipped": "turned to where the shape looks nearly the same: the best of these",
    "accepted": "what was accepted, outlined",
    "best": "the best of all so far, outlined; where a finished run shows its answer, solid",
    "runner-up": "the best of another hypothesis than the answer's, at the end of a run",
    "edited": "the pose that you edit",
    "ground truth": "outlined in white (G)",
}


def in_focus(snapshot: Snapshot) -> ObjectState:
    """The object in focus, among those of the scene."""
    return snapshot.scene.object(snapshot.target.instance.instance_id)


def counted(n: int, name: str) -> str:
    """As in: 1 pose, 2 poses."""
    return f"{n} {name}{'s' if n != 1 else ''}"


def without_model(instance_id: int | None) -> str:
    """What is touched that is no object of the frame: the table, or an unknown object; "" for objects with a model."""
    if instance_id is None or instance_id > SUPPORT_ID:
        return ""
    number = unknown_number(instance_id)
    return "table" if number is None else f"unknown object {number}"


def method_name(name: str) -> str:
    """As in papers: RIR, VF_b."""
    return method_of(name).label


def refiner_name(name: str) -> str:
    """As people write it."""
    names = {"trimmed_icp": "trimmed ICP", "depth_net": "depth net", "depth_net_icp": "depth net + ICP"} | {
        "densefusion": "DenseFusion"
    }
    return names.get(name, name.upper())


# Hypotheses.


def arm_color(j: int) -> RGB:
    """The colour of hypothesis ``j``, from 0."""
    return ARM_COLORS[j % len(ARM_COLORS)]


def arm_name(target: Target, j: int) -> str:
    """As in: hypothesis 2 (cosypose). Plain text; without the source where all have the same."""
    name = f"hypothesis {j + 1}"
    return f"{name} ({source_of(target.instance.hypotheses[j])})" if has_several_sources(target) else name


def source_of(hypothesis: Hypothesis) -> str:
    """Where it comes from, without the number that disturbed poses have."""
    return re.sub(r" #\d+$", "", hypothesis.source)


def has_several_sources(target: Target) -> bool:
    """Whether hypotheses come from more than one source."""
    return len({source_of(h) for h in target.instance.hypotheses}) > 1


# Whether a pose is right.


def is_correct(errors: PoseErrors | None) -> bool:
    """Whether a pose is near enough; False also where that is unknown."""
    return errors is not None and errors.relative < CORRECT


def verdict_mark(errors: PoseErrors | None) -> str:
    """✓ or ✗; nothing where that is unknown."""
    if errors is None:
        return ""
    return "✓" if is_correct(errors) else "✗"


# Names in little room.

_CHARACTER_PX = 6.2


def shortened(name: str, width_px: float) -> str:
    """As much of a name as there is room for [px], in plain text."""
    return abridged(name, int((width_px - 5) / _CHARACTER_PX))


def abridged(name: str, n: int) -> str:
    """At most ``n`` characters of a name, without some of its middle; a number that tells twins apart stays."""
    if len(name) <= n:
        return name
    end = stem_and_number(name)[1] or name[-n // 3 :]
    n_stem = n - 1 - len(end)
    return f"{name[:n_stem]}…{end}" if n_stem > 2 else f"{name[: max(n - 1, 1)]}…"


def without_common_start(names: Sequence[str]) -> list[str]:
    """Names without the words that all begin with: cut at their end, they would look the same."""
    words = [name.split() for name in names]
    n = 0
    while len(names) > 1 and all(len(w) > n + 1 for w in words) and len({w[n] for w in words}) == 1:
        n += 1
    return [f"…{' '.join(w[n:])}" for w in words] if n else list(names)


def stem_and_number(name: str) -> tuple[str, str]:
    """A name, and the number behind it that tells twins apart; "" where there is none."""
    stem, sign, number = name.rpartition(" #")
    return (stem, f"#{number}") if sign else (name, "")
