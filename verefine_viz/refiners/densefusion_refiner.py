"""DF-R, the refiner of DenseFusion, as in the paper's main experiments (Sec. V). docs/methods.md 4.3."""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.refiner_steps import RefinerStep
from verefine_viz.learned.densefusion_input import MEAN, STD
from verefine_viz.learned.densefusion_steps import Colours
from verefine_viz.networks.densefusion_weights import pose_network, refine_network


class DenseFusionRefiner:
    """Steps of PoseRefineNet, which sees the object's points and what PoseNet makes of their colours.

    Args:
        settings: weights, steps per call, classes, points and seed.

    Raises:
        VerefineError: weights are missing, cannot be used, or do not belong together.
    """

    def __init__(self, settings: DenseFusionSettings) -> None:
        self.settings = settings
        self._pose, self._steps = pose_network(settings), refine_network(settings)
        ours, theirs = self._pose.classes, self._steps.classes
        if ours.obj_ids != theirs.obj_ids:
            raise InputError(
                f"weights {settings.weights} know {len(ours.obj_ids)} objects and {settings.refiner_weights} "
                f"{len(theirs.obj_ids)}, or others; give those of one training"
            )
        self._seen: WeakKeyDictionary[Target, tuple[Colours | None]] = WeakKeyDictionary()
        """For each object, PoseNet's part, which is the same at every pose and takes most of the time."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4); the given one where the mask holds no depth.

        Raises:
            InputError: the frame has no colour, the networks do not know the object, or an answer is not finite.
        """
        T = finite(T_cam_obj, "pose to refine", (4, 4))
        if target not in self._seen:
            poses = self._pose.poses(target)
            self._seen[target] = (poses.colours if poses else None,)
        (colours,) = self._seen[target]
        if colours is None:
            return T_cam_obj
        return self._steps.refined(T, colours, target.model, self.settings.iterations)

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        """The crop of the image with its points, and the pose's change step by step, seen by the camera."""
        crop = self._pose.crop(target)
        if crop is None:
            return []
        poses = self._pose.poses_of(crop, target.model)
        width = crop.image.shape[3]
        rows, columns = np.divmod(crop.chosen, width)
        points_px = np.stack([columns, rows], axis=1).astype(np.float64)
        colours = crop.image[0].transpose(1, 2, 0) * STD + MEAN
        image = np.clip(np.rint(colours), 0, 255).astype(np.uint8)
        steps, T = [], T_cam_obj
        for _ in range(self.settings.iterations):
            before, T = T, self._steps.refined(T, poses.colours, target.model, 1)
            steps.append(
                RefinerStep(
                    crops={"image": image},
                    limits={},
                    turn=Rotation.from_matrix(T[:3, :3] @ before[:3, :3].T).as_rotvec(),
                    shift_m=T[:3, 3] - before[:3, 3],
                    centre_px=points_px.mean(axis=0),
                    px_per_m=target.observation.camera.fx / float(crop.points[0, :, 2].mean()),
                    points_px=points_px,
                    confidence=float(poses.confidences.max()),
                )
            )
        return steps
