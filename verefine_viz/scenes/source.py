"""The one door to problems: a data set's folder or a built-in scene, opened from settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings


class SceneSource(Protocol):
    """Where problems come from."""

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames to be solved, as "scene/image"."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know about the list of frames."""
        ...

    def problem(self, frame: str) -> Problem:
        """The problem of one frame.

        Raises:
            VerefineError: the frame does not exist or cannot be used; the message is one line.
        """
        ...


def open_scene(scene: SceneSettings, hypotheses: HypothesesSettings) -> SceneSource:
    """The source that the settings name; all paths in them are absolute.

    Raises:
        VerefineError: folder, file, frame, object or built-in scene does not exist.
    """
    if scene.source == "bop":
        from verefine_viz.scenes.bop_source import BopSource

        return BopSource(scene, hypotheses)
    return DemoSource(scene, hypotheses)


DEMO_FRAME = "0/0"
"""The name of a built-in scene's only frame."""


class DemoSource:
    """A built-in scene: one frame, made when it is first asked for."""

    def __init__(self, scene: SceneSettings, hypotheses: HypothesesSettings) -> None:
        from verefine_viz.scenes.demo import demo_names

        names = tuple(demo_names())
        if scene.demo not in names:
            raise InputError(unknown("demo scene", scene.demo, names))
        self._scene = scene
        self._hypotheses = hypotheses
        self._problem: Problem | None = None
        self.frames: tuple[str, ...] = (DEMO_FRAME,)
        self.notes: tuple[str, ...] = ()

    def problem(self, frame: str) -> Problem:
        """The scene's only frame.

        Raises:
            InputError: another frame is asked for.
        """
        if frame not in self.frames:
            raise InputError(unknown("frame", frame, self.frames))
        problem = self._problem
        if problem is None:
            from verefine_viz.scenes.demo import demo_problem

            made = demo_problem(self._scene.demo, self._scene, self._hypotheses)
            problem = self._problem = replace(made, scene_id=0, im_id=0)
        return problem
