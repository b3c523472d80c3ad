"""Instances whose first poses come from an estimator, wherever those of the others come from."""

from __future__ import annotations

from collections.abc import Callable

from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.frames import frame_name, parse_frame


def asked_estimators(hypotheses: HypothesesSettings) -> dict[tuple[str, int], str]:
    """The estimator of each frame's instance that ``hypotheses.estimate`` names; frames as "scene/image".

    Raises:
        SettingsError: a frame is something else, or an instance is named twice.
    """
    found: dict[tuple[str, int], str] = {}
    for frame, instance_id, estimator in hypotheses.estimate:
        try:
            name = frame_name(parse_frame(frame))
        except SettingsError as error:
            raise SettingsError(f"hypotheses.estimate: {error}") from None
        if (name, instance_id) in found:
            raise SettingsError(f"hypotheses.estimate names instance {instance_id} of frame {name} twice; name it once")
        found[name, instance_id] = estimator
    return found


def check_asked(hypotheses: HypothesesSettings, check_frame: Callable[[str], None]) -> None:
    """Looks whether the frames of ``hypotheses.estimate`` exist; which instances they have is known when they are read.

    Args:
        hypotheses: what is asked for.
        check_frame: raises where there is no such frame.

    Raises:
        SettingsError: see :func:`asked_estimators`.
        InputError: there is no such frame.
    """
    for frame, _ in asked_estimators(hypotheses):
        try:
            check_frame(frame)
        except VerefineError as error:
            raise InputError(f"hypotheses.estimate: {error}") from None
