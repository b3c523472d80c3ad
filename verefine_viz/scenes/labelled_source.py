"""The frames of a folder with the objects that were labelled in them: a frame without labels has none."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.core.errors import InputError, SettingsError, VerefineError, unknown
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Hypothesis, Instance, LeftOut, Placed, Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.scenes.labels import Label, read_labels
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels
from verefine_viz.scenes.unlabelled_frames import UnlabelledFrames, unlabelled_frames

SOURCE = "label"
"""Where such an initial pose comes from, as shown to the user."""


class LabelledSource:
    """Frames of ``scene.dataset``, each with the objects that ``scene.labels`` names in it; the file is read at each
    call, as labels come while frames are looked at.

    Raises:
        VerefineError: folder or file cannot be used.
    """

    def __init__(self, scene: SceneSettings, hypotheses: HypothesesSettings) -> None:
        if not scene.dataset:
            raise SettingsError("scene.dataset is empty; set it to the folder of the frames to label")
        self._scene = scene
        self.bare: UnlabelledFrames = unlabelled_frames(scene)
        self.frames: tuple[str, ...] = self.bare.frames
        self.notes: tuple[str, ...] = ()
        self.is_sequence = scene.sequence
        self._read: tuple[str, Observation, tuple[str, ...]] | None = None
        """The frame that was read last: it stays while its labels change."""

    def check_initial_poses(self) -> tuple[str, ...]:
        """See :class:`SceneSource`; labels are the initial poses."""
        return ()

    def all_left_out(self, frame: str, why: str) -> tuple[LeftOut, ...]:
        """See :class:`SceneSource`."""
        return ()

    def labels(self, frame: str) -> tuple[Label, ...]:
        """The labels of a frame.

        Raises:
            InputError: the file is damaged.
        """
        return read_labels(Path(self._scene.labels)).get(frame, ()) if self._scene.labels else ()

    def observation(self, frame: str) -> Observation:
        """A frame without objects.

        Raises:
            VerefineError: it does not exist, or its images are missing or damaged.
        """
        if frame not in self.frames:
            raise InputError(unknown("frame", frame, self.frames))
        if self._read is None or self._read[0] != frame:
            self._read = (frame, *self.bare.observation(frame))
        return self._read[1]

    def problem(self, frame: str, progress: ProgressToken = NEVER_CANCELLED) -> Problem:
        """See :class:`SceneSource`; of a frame without labels there is nothing to solve."""
        progress.checkpoint(f"Reading the pictures of frame {frame}.")
        observation = self.observation(frame)
        progress.seen(observation.rgb)
        placed, left_out = list[Placed](), list[LeftOut]()
        with progress.preparing():
            for label in self.labels(frame):
                try:
                    placed.append(Placed(label.instance, self.bare.models.get(label.obj_id), label.pose))
                except VerefineError as error:
                    why = str(error)
                    left_out.append(LeftOut(label.instance, label.obj_id, label.name, why, False, is_unreadable=True))
        instances: list[Instance] = []
        for one in placed:
            others = [other for other in placed if other is not one]
            mask = own_pixels(observation, one.model, one.T_cam_obj, others, fit_reach_m(one.model))
            cloud = segment_cloud(
                observation.depth_m, observation.camera, mask, self._scene.cloud_points, self._scene.seed
            )
            start = Hypothesis(one.T_cam_obj, 1.0, SOURCE)
            instances.append(Instance(one.instance_id, one.model.obj_id, mask, cloud, (start,)))
        return Problem(
            *parse_frame(frame),
            observation=observation,
            models={one.model.obj_id: one.model for one in placed},
            instances=tuple(instances),
            title=self.bare.title,
            notes=() if self._read is None else self._read[2],
            left_out=tuple(left_out),
        )
