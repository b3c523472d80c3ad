"""How a pose changes from frame to frame of a sequence: how far, and where it flips or jumps.

Relative to the data set's world where the camera's pose is known, so that what the camera does is no motion of the
object; relative to the support plane where one was detected, which leaves height and tilt; else to the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between

FLIP_DEG, NEAR_DEG = 30.0, 20.0
"""A flip turns by more than the first, and a near-symmetry of the shape explains it to less than the second."""
JUMP_DEG, JUMP_MM = 30.0, 50.0
"""A larger turn or shift between two frames that no near-symmetry explains is a jump."""

Kind = Literal["flip", "jump", "moved", "no pose"]
Reference = Literal["world", "camera"]


@dataclass(frozen=True, eq=False)
class PosedFrame:
    """The pose of one object in a frame, and what it is relative to."""

    frame: str
    T_cam_obj: Float | None
    """(4, 4) [m]; None where it has none."""
    T_map_cam: Float | None = None
    """(4, 4) camera to the data set's world [m]; None = unknown."""
    T_table_cam: Float | None = None
    """(4, 4) camera to a frame on the support plane whose z is up [m]; None = unknown."""


@dataclass(frozen=True)
class Motion:
    """What happened to the pose on the way to a frame, since the last one with a pose."""

    frame: str
    kind: Kind
    """no pose: of this frame. The first frame with a pose has moved by 0."""
    reference: Reference = "camera"
    """What ``moved_mm`` and ``turned_deg`` are relative to."""
    moved_mm: float = 0.0
    """Way of the object's middle."""
    turned_deg: float = 0.0
    lifted_mm: float | None = None
    """Way of the object's middle, away from the support plane; None where the plane of one of the frames is unknown."""
    tilted_deg: float | None = None
    """Change of the angle at which the object stands on the support plane; a turn on it is none."""
    drift_mm: float | None = None
    """How far the middle is from where the first pose had it, in the world; None where that is unknown."""


NO_SYMMETRY = np.eye(4)[None]
"""Symmetries of an object that has none declared."""


def motions(
    poses: Sequence[PosedFrame], middle_m: Float, turns: Float, symmetries: Float = NO_SYMMETRY
) -> tuple[Motion, ...]:
    """One per frame.

    Args:
        poses: of one object, in order.
        middle_m: (3,) the object's middle in its own frame [m].
        turns: (N, 4, 4) turns of the object's frame after which its shape nearly looks the same; may be empty.
        symmetries: (S, 4, 4) those that are declared, the identity first: what they do is no motion.
    """
    changes: list[Motion] = []
    first: PosedFrame | None = None
    before: PosedFrame | None = None
    for now in poses:
        if now.T_cam_obj is None:
            changes.append(Motion(now.frame, "no pose"))
            continue
        first = first or now
        changes.append(_motion(first, _nearest(before or now, now, symmetries), now, middle_m, turns))
        before = now
    return tuple(changes)


def _nearest(before: PosedFrame, now: PosedFrame, symmetries: Float) -> PosedFrame:
    """The pose before as the symmetry has it that is nearest to the pose now."""
    if len(symmetries) == 1 or before.T_cam_obj is None or now.T_cam_obj is None:
        return before
    T_before, T_now = _world_poses(before, now)
    R_rest = T_now[:3, :3].T @ T_before[:3, :3]
    best = int(np.argmax(np.einsum("ij,sji->s", R_rest, symmetries[:, :3, :3])))  # The largest trace turns least.
    return replace(before, T_cam_obj=before.T_cam_obj @ symmetries[best])


def _motion(first: PosedFrame, before: PosedFrame, now: PosedFrame, middle_m: Float, turns: Float) -> Motion:
    is_in_world = before.T_map_cam is not None and now.T_map_cam is not None
    T_before, T_now = _world_poses(before, now)
    moved_mm = _apart_mm(T_before, T_now, middle_m)
    turned_deg = _degrees(T_before, T_now)
    kind: Kind = "jump" if turned_deg > JUMP_DEG or moved_mm > JUMP_MM else "moved"
    if turned_deg > FLIP_DEG and moved_mm <= JUMP_MM:
        left_deg = min((_degrees(T_before @ turn, T_now) for turn in turns), default=180.0)
        kind = "flip" if left_deg < NEAR_DEG else "jump"
    lifted_mm, tilted_deg, drift_mm = None, None, None
    if before.T_table_cam is not None and now.T_table_cam is not None:
        on_before, on_now = (_object_in_frame(pose.T_table_cam, pose) for pose in (before, now))
        lifted_mm = 1e3 * float((on_now[2, :3] - on_before[2, :3]) @ middle_m + on_now[2, 3] - on_before[2, 3])
        up_before, up_now = on_before[2, :3], on_now[2, :3]  # The plane's normal as the object has it.
        tilted_deg = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(up_before, up_now)), up_before @ up_now)))
    if first.T_map_cam is not None and now.T_map_cam is not None:
        drift_mm = _apart_mm(_object_in_frame(first.T_map_cam, first), _object_in_frame(now.T_map_cam, now), middle_m)
    return Motion(
        now.frame, kind, "world" if is_in_world else "camera", moved_mm, turned_deg, lifted_mm, tilted_deg, drift_mm
    )


def _world_poses(before: PosedFrame, now: PosedFrame) -> tuple[Float, Float]:
    """Both poses in the world where both cameras are known, else in the cameras' frames."""
    if before.T_map_cam is None or now.T_map_cam is None:
        return _object_in_frame(None, before), _object_in_frame(None, now)
    return _object_in_frame(before.T_map_cam, before), _object_in_frame(now.T_map_cam, now)


def _object_in_frame(T_frame_cam: Float | None, pose: PosedFrame) -> Float:
    assert pose.T_cam_obj is not None
    return pose.T_cam_obj if T_frame_cam is None else T_frame_cam @ pose.T_cam_obj


def _apart_mm(T_a: Float, T_b: Float, point_m: Float) -> float:
    return 1e3 * float(np.linalg.norm((T_b - T_a)[:3, :3] @ point_m + (T_b - T_a)[:3, 3]))


def _degrees(T_a: Float, T_b: Float) -> float:
    return float(np.degrees(angle_between(T_a[:3, :3], T_b[:3, :3])))


@dataclass(frozen=True)
class MotionCounts:
    """What the changes of a pose over a sequence come to."""

    n_frames: int
    flips: int
    jumps: int
    no_pose: int
    """Frames without a pose."""
    median_mm: float | None
    """Median over the frames that neither flip nor jump; None of none."""
    median_deg: float | None
    drift_mm: float | None
    """How far the last pose is from the first, in the world; None where that is unknown."""
    is_in_world: bool
    """Whether the medians are relative to the world in all frames."""

    @property
    def flips_per_100(self) -> float:
        """Flips in 100 frames."""
        return 100 * self.flips / max(self.n_frames, 1)

    @property
    def text(self) -> str:
        """A line: "5 frames, 2 flips (40 per 100), 0 jumps; median 1.2 mm and 0.3° a frame"."""
        parts = [f"{self.n_frames} frames", f"{_n(self.flips, 'flip')} ({self.flips_per_100:.3g} per 100)"]
        parts += [_n(self.jumps, "jump")]
        parts += [f"{self.no_pose} without a pose"] if self.no_pose else []
        words = ", ".join(parts)
        if self.median_mm is not None and self.median_deg is not None:
            relative = " in the world" if self.is_in_world else ""
            words += f"; median {self.median_mm:.2g} mm and {self.median_deg:.2g}° a frame{relative}"
        if self.drift_mm is not None:
            words += f"; {self.drift_mm:.1f} mm from where it began"
        return f"{words}."


def counted(changes: Sequence[Motion]) -> MotionCounts:
    """The changes of one object, summed up."""
    of_kind = {kind: sum(motion.kind == kind for motion in changes) for kind in ("flip", "jump", "no pose")}
    posed = [motion for motion in changes if motion.kind != "no pose"]
    plain = [motion for motion in posed[1:] if motion.kind == "moved"]
    return MotionCounts(
        len(changes),
        of_kind["flip"],
        of_kind["jump"],
        of_kind["no pose"],
        float(np.median([motion.moved_mm for motion in plain])) if plain else None,
        float(np.median([motion.turned_deg for motion in plain])) if plain else None,
        posed[-1].drift_mm if posed else None,
        bool(plain) and all(motion.reference == "world" for motion in plain),
    )


def _n(n: int, one: str) -> str:
    return f"{n} {one}{'' if n == 1 else 's'}"
