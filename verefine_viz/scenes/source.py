"""Opens what problems come from: a data set's folder or a built-in scene, as settings name it."""

from __future__ import annotations

from typing import Protocol

from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.problem import LeftOut, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.frames import repeated_notes
from verefine_viz.scenes.hypothesis_pool import check_asked


class SceneSource(Protocol):
    """Where problems come from."""

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames to be solved, as "scene/image"."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """About the choice of frames and objects."""
        ...

    @property
    def is_sequence(self) -> bool:
        """Whether the frames of a scene are in order, as of a video."""
        ...

    def check_initial_poses(self) -> tuple[str, ...]:
        """Notes about initial poses, as far as they are known before a frame is read.

        Raises:
            VerefineError: they come out of results files that have none for any object of any of the frames.
        """
        ...

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """The problem of one frame.

        Args:
            frame: which.
            progress: checked before anything that may take seconds, and on the way.

        Raises:
            VerefineError: the frame does not exist or cannot be used; the message is one line.
            Cancelled: ``progress`` was cancelled.
        """
        ...

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """The objects of a frame that cannot be solved, by ground truth; none without any.

        Args:
            frame: which; its images need not be there.
            why: what is wrong with it.

        Raises:
            VerefineError: ground truth is damaged.
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
    if scene.source == "folder":
        from verefine_viz.scenes.recorded_source import RecordedSource

        return RecordedSource(scene, hypotheses)
    if scene.source == "layout":
        from verefine_viz.scenes.graspa_layout import LayoutSource

        return LayoutSource(scene, hypotheses)
    if scene.source == "labels":
        from verefine_viz.scenes.labelled_source import LabelledSource

        return LabelledSource(scene, hypotheses)
    return DemoSource(scene, hypotheses)


class DemoSource:
    """A built-in scene: one frame per viewpoint, each made when it is first asked for."""

    def __init__(self, scene: SceneSettings, hypotheses: HypothesesSettings) -> None:
        from verefine_viz.scenes.demo import demo_frames, demo_objects

        available = demo_frames(scene.demo)

        def check_frame(frame: str) -> None:
            if frame not in available:
                raise InputError(f"{unknown('frame', frame, available)} (demo scene {scene.demo!r})")

        for frame in scene.frames:
            check_frame(frame)
        check_asked(hypotheses, check_frame)
        objects = demo_objects(scene.demo)
        for obj_id in scene.objects:
            if obj_id not in objects:
                there = ", ".join(f"{i} ({name})" for i, name in sorted(objects.items()))
                raise SettingsError(
                    f"unknown object {obj_id} in scene.objects; available: {there} (demo scene {scene.demo!r})"
                )
        self._objects = frozenset(scene.objects or objects)
        self._scene = scene
        self._hypotheses = hypotheses
        self.is_sequence = scene.sequence
        self._problems: dict[str, Problem] = {}
        self.frames: tuple[str, ...] = tuple(dict.fromkeys(scene.frames)) or available
        self.notes: tuple[str, ...] = repeated_notes(scene.frames)

    def check_initial_poses(self) -> tuple[str, ...]:
        """See :class:`SceneSource`."""
        from verefine_viz.scenes.hypothesis_pool import check_covered, file_notes, results_of

        files, frames = results_of(self._hypotheses), [parse_frame(frame) for frame in self.frames]
        return (*file_notes(files), *check_covered(files, self._hypotheses, frames, lambda _: self._objects))

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """See :class:`SceneSource`; the same object at each call."""
        if frame not in self.frames:
            raise InputError(unknown("frame", frame, self.frames))
        if frame not in self._problems:
            from verefine_viz.scenes.demo import demo_problem

            self._problems[frame] = demo_problem(self._scene.demo, self._scene, self._hypotheses, frame, progress)
        return self._problems[frame]

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """See :class:`SceneSource`."""
        return tuple(target.left_out(why) for target in self.problem(frame).targets)
