"""When a running method should stop and wait for the user."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

from verefine_viz.core.algorithm_settings import MOST, BreakpointSettings
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration, Stage
from verefine_viz.core.text_format import distinguishing_digits
from verefine_viz.evaluation.pose_errors import add_s_mm

UNITS = {"score_falls_by": "", "jump_mm": " mm", "jump_deg": "°", "error_grows_by_mm": " mm"}
"""Breakpoints with a threshold, and its unit as it is written behind the number."""
LABELS = {"score_falls_by": "score −", "jump_mm": "moved", "jump_deg": "turned", "error_grows_by_mm": "error +"}
"""Names of them as the page calls them."""
_WAITING = "waiting."


def number_of(settings: BreakpointSettings, name: str) -> float | None:
    """The threshold of a breakpoint, on or off; None where it never had one."""
    value = getattr(settings, name)
    return getattr(settings.waiting, name) if value is None else value


def with_changes(settings: BreakpointSettings, changes: Iterable[tuple[str, Any]]) -> BreakpointSettings:
    """``settings`` with some fields replaced.

    A threshold of None switches its breakpoint off, and the number is saved for later; ``waiting.jump_mm`` is the
    threshold of a breakpoint that is off.

    Raises:
        SettingsError: there is no such breakpoint, or its value is none.
    """
    wanted = msgspec.to_builtins(settings)
    waiting = wanted.pop("waiting")
    for name, value in changes:
        own = name.removeprefix(_WAITING)
        if own not in (waiting if own != name else wanted):
            raise SettingsError(unknown("breakpoint", name, tuple(wanted)))
        if own != name:
            waiting[own] = value
            continue
        if own in waiting:
            waiting[own] = None if value is not None else number_of(settings, own)
        wanted[own] = value
    try:
        return msgspec.convert({**wanted, "waiting": waiting}, BreakpointSettings, strict=False)
    except msgspec.ValidationError as error:
        *_, group, name = re.findall(r"\w+", str(error))  # The message ends in the field's place.
        raise SettingsError(_refusal(name, (waiting if group == "waiting" else wanted)[name])) from None


def _refusal(name: str, value: Any) -> str:
    if name not in UNITS:
        return f"the breakpoint {name} cannot be {value}: give on or off; it stays as it was"
    given = f"{value:.10g}{UNITS[name]}" if isinstance(value, int | float) else value
    return f"“{LABELS[name]}” cannot be {given}: give a number from 0 to {MOST[name]}{UNITS[name]}; it stays as it was"


def hits(settings: BreakpointSettings, problem: Problem, iteration: Iteration) -> tuple[str, ...]:
    """Why the run should stop after ``iteration``, a sentence each; empty = go on."""
    current, accepted = iteration.stages[0], iteration.accepted_stage
    kinds = {event.kind: event.text for event in iteration.events}
    reasons: list[str] = []
    fall = _score(current) - _score(accepted)
    if settings.score_falls_by is not None and fall > settings.score_falls_by:
        reasons.append(_over("the score fell by", fall, settings.score_falls_by, "", 3))
    if settings.simulated_rejected and "kept_refined" in kinds:
        reasons.append(f"simulated pose rejected: {kinds['kept_refined']}")
    if settings.refined_rejected and "kept_simulated" in kinds:
        reasons.append(kinds["kept_simulated"])
    jump_mm = 1e3 * float(np.linalg.norm(accepted.T_cam_obj[:3, 3] - current.T_cam_obj[:3, 3]))
    if settings.jump_mm is not None and jump_mm > settings.jump_mm:
        reasons.append(_over("the pose jumped by", jump_mm, settings.jump_mm, " mm"))
    jump_deg = float(np.rad2deg(angle_between(current.T_cam_obj[:3, :3], accepted.T_cam_obj[:3, :3])))
    if settings.jump_deg is not None and jump_deg > settings.jump_deg:
        reasons.append(_over("the pose turned by", jump_deg, settings.jump_deg, "°"))
    by_event = {
        "arm_switched": settings.arm_switched,
        "unstable": settings.unstable,
        "physics_worse": settings.physics_worse,
        "empty_render": settings.empty_render,
        "nan_score": settings.empty_render,
    }
    reasons += [kinds[kind] for kind, is_on in by_event.items() if is_on and kind in kinds]
    if settings.error_grows_by_mm is not None:
        growth = _error_growth_mm(problem, iteration)
        if growth is not None and growth > settings.error_grows_by_mm:
            reasons.append(_over("the error against ground truth grew by", growth, settings.error_grows_by_mm, " mm"))
    return tuple(reasons)


def _over(what: str, value: float, limit: float, unit: str, digits: int = 1) -> str:
    """What happened: "the pose jumped by 30.0 mm, more than 25 mm"."""
    if round(value, digits) <= limit:  # Else it would read as if it were not more.
        digits = distinguishing_digits(value - limit)
    return f"{what} {value:.{digits}f}{unit}, more than {limit:g}{unit}"


def _score(stage: Stage) -> float:
    return stage.score.score if stage.score else 0.0


def _error_growth_mm(problem: Problem, iteration: Iteration) -> float | None:
    target = next(t for t in problem.targets if t.instance.instance_id == iteration.instance_id)
    T_gt = target.instance.T_cam_obj_gt
    if T_gt is None:
        return None
    before = add_s_mm(target.model, iteration.stages[0].T_cam_obj, T_gt)
    return add_s_mm(target.model, iteration.accepted_stage.T_cam_obj, T_gt) - before
