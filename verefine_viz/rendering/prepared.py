"""What is made once per frame, per instance and per model, and cached as long as those live."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.mesh import RenderMesh, RenderMeshes, render_meshes
from verefine_viz.rendering.score_kernels import OBJECTS, OWN
from verefine_viz.rendering.simplify import scoring_mesh

PUBLISHED_FAR_M = 5.0
"""Farthest surface that the authors' renderer draws [m]."""

CACHED_SCENES = 16
"""How many choices of targets are cached for a frame."""


@dataclass(frozen=True, eq=False)
class PreparedTarget:
    """One instance, or several that are scored together, in one frame, as the renderers read it."""

    observed: NDArray[np.float32]
    """(H, W, 4) unit normal and z [m]; 0 where missing."""
    flags: NDArray[np.uint8]
    """(H, W) bits ``OWN`` and ``OBJECTS``, set only where depth is valid."""
    n_own: int
    """Pixels with ``OWN``."""
    n_objects: int
    """Pixels with ``OBJECTS``."""
    own: NDArray[np.uint8]
    """(m, H, W) the flags of each instance by itself."""

    def arrays(self, placed_m: NDArray[np.float32]) -> tuple[NDArray, NDArray, NDArray, NDArray, int, int]:
        """What the kernels take; ``placed_m`` is z of the objects placed before, (H, W), or (0, 0) for none [m]."""
        return self.observed, self.flags, self.own, placed_m, self.n_objects, self.n_own


_Scene = tuple[tuple[PreparedTarget, ...], PreparedTarget]


class TargetStore:
    """Prepared targets, cached as long as the frame and instance they belong to."""

    def __init__(self) -> None:
        self._frames: WeakKeyDictionary[Observation, NDArray[np.float32]] = WeakKeyDictionary()
        self._targets: WeakKeyDictionary[Instance, WeakKeyDictionary[Observation, PreparedTarget]]
        self._targets = WeakKeyDictionary()
        self._scenes: WeakKeyDictionary[Observation, dict[tuple[int, ...], _Scene]] = WeakKeyDictionary()

    def get(self, target: Target) -> PreparedTarget:
        """The arrays of a target, made at the first call.

        Raises:
            ShapeError: the instance's mask and the frame differ in size.
        """
        per_frame = self._targets.setdefault(target.instance, WeakKeyDictionary())
        prepared = per_frame.get(target.observation)
        if prepared is None:
            prepared = per_frame[target.observation] = self._prepare(target)
        return prepared

    def scene(self, targets: Sequence[Target], whole_frame: bool) -> PreparedTarget:
        """The arrays of m ≥ 1 targets that are scored together.

        Args:
            targets: of one frame.
            whole_frame: whether ``OBJECTS`` stands for all masks of the frame, or for those of the targets.

        Raises:
            ShapeError: an instance's mask and the frame differ in size, or the targets are not of one frame.
        """
        frame = targets[0].observation
        if any(target.observation is not frame for target in targets):
            raise ShapeError("the targets of a scene are of different frames, expected one frame")
        parts = tuple(self.get(target) for target in targets)
        if len(parts) == 1 and whole_frame:
            return parts[0]
        scenes = self._scenes.setdefault(frame, {})
        key = (whole_frame, *(id(part) for part in parts))
        if key not in scenes:
            if len(scenes) >= CACHED_SCENES:
                del scenes[next(iter(scenes))]
            # The parts are held so that their ids stay theirs.
            scenes[key] = parts, _together(parts, whole_frame)
        return scenes[key][1]

    def _prepare(self, target: Target) -> PreparedTarget:
        observation, mask = target.observation, target.instance.mask
        if mask.shape != observation.camera.shape:
            raise ShapeError(
                f"the mask of instance {target.instance.instance_id} is {mask.shape[1]}×{mask.shape[0]}, "
                f"but the frame is {observation.camera.width}×{observation.camera.height}"
            )
        observed = self._frames.get(observation)
        if observed is None:
            depth = np.where(np.isfinite(observation.depth_m) & (observation.depth_m > 0), observation.depth_m, 0)
            normals = np.where(np.isfinite(observation.normals_cam), observation.normals_cam, 0)
            observed = np.dstack([normals, depth]).astype(np.float32)
            self._frames[observation] = observed
        measured = observed[:, :, 3] > 0
        own, objects = mask & measured, observation.object_mask & measured
        return _prepared(observed, (own * OWN | objects * OBJECTS).astype(np.uint8))


def _prepared(
    observed: NDArray[np.float32], flags: NDArray[np.uint8], own: NDArray[np.uint8] | None = None
) -> PreparedTarget:
    n_own, n_objects = (int(np.count_nonzero(flags & bit)) for bit in (OWN, OBJECTS))
    return PreparedTarget(observed, flags, n_own, n_objects, flags[None] if own is None else own)


def _together(parts: tuple[PreparedTarget, ...], whole_frame: bool) -> PreparedTarget:
    own = np.stack([part.flags for part in parts])
    any_own = np.bitwise_or.reduce(own) & OWN
    counted = parts[0].flags & OBJECTS if whole_frame else any_own * np.uint8(OBJECTS // OWN)
    return _prepared(parts[0].observed, any_own | counted, own)


class MeshStore:
    """Scoring meshes by the model's mesh hash; ``progress`` is asked where one has to be made."""

    def __init__(
        self, simplify_mm: float, folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        self._simplify_mm = simplify_mm
        self._progress = progress
        self._folder = folder
        self._meshes: dict[str, RenderMesh] = {}
        self._joined: dict[tuple[str, ...], RenderMeshes] = {}

    def get(self, model: ObjectModel) -> RenderMesh:
        mesh = self._meshes.get(model.mesh_hash)
        if mesh is None:
            mesh = scoring_mesh(model, self._simplify_mm, self._folder, self._progress)
            self._meshes[model.mesh_hash] = mesh
        return mesh

    def together(self, models: Sequence[ObjectModel]) -> RenderMeshes:
        """Several models as one; cached like the meshes themselves."""
        key = tuple(model.mesh_hash for model in models)
        if key not in self._joined:
            self._joined[key] = render_meshes(tuple(self.get(model) for model in models))
        return self._joined[key]


def intrinsics(camera: Camera, settings: ScoreSettings) -> tuple[float, float, float, float]:
    """(fx, fy, cx, cy) [px] with which models are drawn."""
    shift = 0.5 if settings.pixel_centre == "half" else 0.0
    return camera.fx, camera.fy, camera.cx - shift, camera.cy - shift


def far_m(settings: ScoreSettings) -> float:
    """The farthest surface that is drawn [m]."""
    return PUBLISHED_FAR_M if settings.pixels == "published" else np.inf
