"""Runs the two networks of DenseFusion: a pose from each point of an object, and a step from a pose.

docs/methods.md 5.3. Poses are those of the frame's models. The official YCB-Video weights were trained on other models,
shifted against those of BOP; their poses are converted on the way in and out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.geometry import nearest_rotation, rotation_of_quat_wxyz, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.learned.densefusion_input import ObjectCrop, crop_of
from verefine_viz.learned.onnx_network import OnnxNetwork

POSE_NET, REFINE_NET = "densefusion_pose", "densefusion_refine"
"""Names of the networks in model cards."""
FORMAT = 1
"""Format of inputs and outputs; weights of another format are refused."""
SMALLEST_NORM = 1e-12
"""Length below which a quaternion has no direction."""

# BOP moved the YCB-Video models by these (bop_toolkit, dataset_info.md of YCB-V) [mm].
YCBV_SHIFTS_MM = (
    (1.3360, -0.5000, 3.5105), (0.5575, 1.7005, 4.8050), (-0.9520, 1.4670, 4.3645), (-0.0240, -1.5270, 8.4035),
    (1.2995, 2.4870, -11.8290), (-0.1565, 0.1150, 4.2625), (1.1645, -4.2015, 3.1190), (1.4460, -0.5915, 3.6085),
    (2.4195, 0.3075, 8.0715), (-18.6730, 12.1915, -1.4635), (5.3370, 5.8855, 25.6115), (4.9290, -2.4800, -13.2920),
    (-0.2270, 0.7950, -2.9675), (-8.4675, -0.6995, -1.6145), (9.0710, 20.9360, -2.1190), (1.4265, -2.5305, 17.1890),
    (7.0535, -28.1320, 0.0420), (0.0460, -2.1040, 0.3500), (10.5180, -1.9640, -0.4745), (-0.3950, -10.4130, 0.1620),
    (-0.0805, 0.0805, -8.2435),
)  # fmt: skip


@dataclass(frozen=True)
class Classes:
    """The objects that a network knows, by class."""

    obj_ids: tuple[int, ...]
    """Object ids in the order of the classes."""
    n_points: int
    """Number of points that it was trained with."""
    shifts_mm: Mapping[int, tuple[float, float, float]]
    """Shift of the frame's model against that of the training, by obj_id [mm]; missing = none."""
    extents_mm: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)
    """Size of the training's model along its axes, by obj_id [mm]; missing = unknown."""


YCBV = Classes(tuple(range(1, 22)), 1000, dict(enumerate(YCBV_SHIFTS_MM, 1)))
"""Classes of the official YCB-Video weights."""
LINEMOD = Classes((1, 2, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15), 500, {})
"""Classes of the official LINEMOD weights."""
OFFICIAL_CLASSES = {len(known.obj_ids): known for known in (YCBV, LINEMOD)}
"""Official classes by their number, which tells the official weights apart."""
POINTS = 500
"""Points per object, of a network whose card states no number."""


def _classes_of(network: OnnxNetwork, settings: DenseFusionSettings) -> Classes:
    """The network's classes: from the settings, else from its model card.

    Raises:
        InputError: the settings name another number of classes than it has, or none, and its own are unknown.
    """
    card = network.card
    n, n_points = card.n_classes, settings.points or card.points or POINTS
    if settings.classes:
        if len(settings.classes) != n:
            raise InputError(
                f"weights {network.path} have {n} classes, densefusion.classes names {len(settings.classes)} objects"
            )
        return Classes(settings.classes, n_points, {})
    if card.classes:
        extents = {
            i: (float(x), float(y), float(z)) for i, (x, y, z) in zip(card.classes, card.extents_mm, strict=False)
        }
        return Classes(card.classes, n_points, {}, extents)
    if n not in OFFICIAL_CLASSES:
        raise InputError(
            f"weights {network.path} have {n} classes, neither the 21 of YCB-Video nor the 13 of LINEMOD; "
            "name the ids of their objects in densefusion.classes"
        )
    known = OFFICIAL_CLASSES[n]
    return Classes(known.obj_ids, settings.points or known.n_points, known.shifts_mm)


@dataclass(frozen=True, eq=False)
class Colours:
    """Output of PoseNet for PoseRefineNet."""

    points: Float
    """(1, N, 3) [m], in the camera's frame."""
    described: Float
    """(1, E, N) the colours around them."""


@dataclass(frozen=True, eq=False)
class PixelPoses:
    """A pose from each point."""

    Ts_cam_obj: Float
    """(N, 4, 4) [m]."""
    confidences: Float
    """(N,) in (0, 1)."""
    colours: Colours
    n_distinct: int
    """Number of poses from distinct points, which come first."""


class DenseFusionPose:
    """PoseNet with its classes.

    Args:
        path: the ONNX file.
        settings: classes, number of points and seed.

    Raises:
        InputError: the weights cannot be used, or do not fit the settings.
    """

    def __init__(self, path: Path, settings: DenseFusionSettings) -> None:
        self.network = OnnxNetwork(path, POSE_NET, FORMAT)
        self.classes = _classes_of(self.network, settings)
        self._seed = settings.seed

    def poses(self, target: Target) -> PixelPoses | None:
        """A pose from each point of the object; None where its mask holds no depth.

        Raises:
            InputError: the frame has no colour, the network does not know the object, or its answer is not finite.
        """
        crop = self.crop(target)
        return None if crop is None else self.poses_of(crop, target.model)

    def poses_of(self, crop: ObjectCrop, model: ObjectModel) -> PixelPoses:
        """Poses of a crop."""
        index = index_of(self.classes, model, self.network)
        quats, offsets, confidences, described = self.network.answers(crop.image, crop.points, crop.chosen, index)
        points = crop.points.astype(np.float64)
        Ts = np.tile(np.eye(4), (len(quats), 1, 1))
        Ts[:, :3, :3] = rotations_of(quats, self.network)
        Ts[:, :3, 3] = points[0] + offsets
        Ts = Ts @ _shift_of(self.classes, model.obj_id, -1)
        return PixelPoses(Ts, confidences, Colours(points, described), crop.n_distinct)

    def crop(self, target: Target) -> ObjectCrop | None:
        """The network's input for the object; None where its mask holds no depth."""
        o, mask = target.observation, target.instance.mask
        if o.rgb is None:
            raise InputError("DenseFusion needs a colour image, and this frame has none; choose another refiner")
        return crop_of(o.rgb, o.depth_m, mask, o.camera, self.classes.n_points, self._seed)


class DenseFusionSteps:
    """PoseRefineNet with its classes.

    Args:
        path: the ONNX file.
        settings: as for :class:`DenseFusionPose`.

    Raises:
        InputError: the weights cannot be used, or do not fit the settings.
    """

    def __init__(self, path: Path, settings: DenseFusionSettings) -> None:
        self.network = OnnxNetwork(path, REFINE_NET, FORMAT)
        self.classes = _classes_of(self.network, settings)

    def refined(self, T_cam_obj: Float, colours: Colours, model: ObjectModel, n_steps: int) -> Float:
        """The pose (4, 4) [m] after some steps of the network.

        Raises:
            InputError: the network does not know the object, or its answer is not finite.
        """
        index = index_of(self.classes, model, self.network)
        T = T_cam_obj @ _shift_of(self.classes, model.obj_id, 1)
        described = colours.described.astype(np.float32)
        for _ in range(n_steps):
            # Seen from the object: were the pose right, the points would lie on the model.
            points_obj = (colours.points - T[:3, 3]) @ T[:3, :3]
            quat, shift = self.network.answers(points_obj.astype(np.float32), described, index)
            T = T @ transform(rotations_of(quat[None], self.network)[0], shift)
            T[:3, :3] = nearest_rotation(T[:3, :3])
        return T @ _shift_of(self.classes, model.obj_id, -1)


def index_of(classes: Classes, model: ObjectModel, network: OnnxNetwork) -> np.ndarray:
    """(1,) number of an object's class.

    Raises:
        InputError: it is none of the classes, or another object has its id there.
    """
    if model.obj_id not in classes.obj_ids:
        raise InputError(f"weights {network.path}: {unknown('object', model.obj_id, classes.obj_ids)}")
    trained, given = classes.extents_mm.get(model.obj_id), extents_mm(model)
    if trained and not np.allclose(trained, given, rtol=0.02, atol=1.0):
        sizes = [" × ".join(f"{length:.0f}" for length in lengths) for lengths in (trained, given)]
        raise InputError(
            f"weights {network.path} do not know {model.name}: their object {model.obj_id} measures {sizes[0]} mm, "
            f"the model {sizes[1]} mm; name weights of these objects in densefusion.weights and .refiner_weights, "
            "official ones or of verefine-viz train densefusion --dataset DIR"
        )
    return np.array([classes.obj_ids.index(model.obj_id)], np.int64)


def extents_mm(model: ObjectModel) -> tuple[float, float, float]:
    """Length of a model along each of its axes [mm]."""
    x, y, z = (round(1000 * float(length), 2) for length in np.ptp(model.vertices, axis=0))
    return x, y, z


def _shift_of(classes: Classes, obj_id: int, sign: int) -> Float:
    """Right factor (4, 4) that converts a pose of the frame's model to one of the training's (1), or back (-1)."""
    return transform(np.eye(3), sign * np.array(classes.shifts_mm.get(obj_id, (0.0, 0.0, 0.0))) / 1000)


def rotations_of(quats_wxyz: Float, network: OnnxNetwork) -> Float:
    """The rotations (N, 3, 3) of quaternions (N, 4) of any length.

    Raises:
        InputError: one has no length.
    """
    if np.linalg.norm(quats_wxyz, axis=1).min() < SMALLEST_NORM:
        raise InputError(f"weights {network.path} give a quaternion without length; train them again, or use others")
    return np.stack([rotation_of_quat_wxyz(quat) for quat in quats_wxyz])
