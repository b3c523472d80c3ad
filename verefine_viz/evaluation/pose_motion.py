"""Measures how a pose changes from frame to frame of a sequence, and where it flips or jumps.

Motions are relative to the data set's world where the camera's pose is known, so that motion of the camera does not
count; else to the support plane where one was detected, by which only height and tilt are known; else to the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.records import MarkKind

FLIP_DEG, NEAR_DEG = 30.0, 20.0
"""A flip turns by more than the first, and a near-symmetry of the shape explains it to less than the second."""
JUMP_DEG, JUMP_MM = 30.0, 50.0
"""A larger turn or shift from one frame to the next that no near-symmetry explains is a jump. All limits grow with
the number of frames without a pose between: an object goes on moving while it is lost."""

Kind = Literal["flip", "jump", "moved", "no pose", "not solved"]
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
    is_solved: bool = True
    """Whether it could have a pose; False of a frame that waits."""


@dataclass(frozen=True)
class Motion:
    """Change of a pose up to a frame, since the last frame with a pose."""

    frame: str
    kind: Kind
    """no pose, not solved: of this frame. The first frame with a pose has moved by 0."""
    reference: Reference = "camera"
    """What ``moved_mm`` and ``turned_deg`` are relative to."""
    moved_mm: float = 0.0
    """Motion of the object's middle."""
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
    places = [i for i, pose in enumerate(poses) if pose.T_cam_obj is not None]
    posed = _posed_motions([poses[i] for i in places], np.array(places), middle_m, turns, symmetries) if places else []
    at = dict(zip(places, posed, strict=True))
    return tuple(
        at[i] if i in at else Motion(pose.frame, "no pose" if pose.is_solved else "not solved")
        for i, pose in enumerate(poses)
    )


def _posed_motions(
    posed: Sequence[PosedFrame], places: NDArray[np.int64], middle_m: Float, turns: Float, symmetries: Float
) -> list[Motion]:
    """Motions between frames that have a pose, so many places apart in the sequence."""
    before = np.maximum(np.arange(len(posed)) - 1, 0)
    n_frames = np.maximum(places - places[before], 1)
    T_cam_obj = np.array([pose.T_cam_obj for pose in posed])
    T_map_cam, has_map = _stacked([pose.T_map_cam for pose in posed])
    T_table_cam, has_table = _stacked([pose.T_table_cam for pose in posed])
    in_world = has_map & has_map[before]
    T_now = np.where(in_world[:, None, None], T_map_cam @ T_cam_obj, T_cam_obj)
    T_before = np.where(in_world[:, None, None], (T_map_cam @ T_cam_obj)[before], T_cam_obj[before])
    # The pose before as the symmetry has it that is nearest to the pose now: the largest trace turns least.
    R_rest = np.swapaxes(T_now, 1, 2)[:, :3, :3] @ T_before[:, :3, :3]
    nearest = symmetries[np.argmax(np.einsum("nij,sji->ns", R_rest, symmetries[:, :3, :3]), axis=1)]
    T_before = T_before @ nearest

    moved_mm, turned_deg = _apart_mm(T_before, T_now, middle_m), _degrees(T_before, T_now)
    turns_much, is_far = turned_deg > FLIP_DEG * n_frames, moved_mm > JUMP_MM * n_frames
    is_jump = is_far | (turned_deg > JUMP_DEG * n_frames)
    is_flip = np.zeros(len(posed), np.bool_)
    for i in np.flatnonzero(turns_much & ~is_far) if len(turns) else ():
        is_flip[i] = _degrees(T_before[i] @ turns, T_now[i]).min() < NEAR_DEG

    on_table = has_table & has_table[before]
    on_now, on_before = T_table_cam @ T_cam_obj, T_table_cam[before] @ T_cam_obj[before] @ nearest
    lifted_mm = 1e3 * (_points(on_now, middle_m) - _points(on_before, middle_m))[:, 2]
    up_now, up_before = on_now[:, 2, :3], on_before[:, 2, :3]  # The plane's normal as the object has it.
    tilted_deg = np.degrees(
        np.arctan2(np.linalg.norm(np.cross(up_before, up_now), axis=-1), (up_before * up_now).sum(axis=-1))
    )
    in_map = T_map_cam @ T_cam_obj
    drift_mm, has_drift = _apart_mm(in_map[:1], in_map, middle_m), has_map & has_map[0]
    return [
        Motion(
            pose.frame,
            "flip" if is_flip[i] else "jump" if is_jump[i] else "moved",
            "world" if in_world[i] else "camera",
            float(moved_mm[i]),
            float(turned_deg[i]),
            float(lifted_mm[i]) if on_table[i] else None,
            float(tilted_deg[i]) if on_table[i] else None,
            float(drift_mm[i]) if has_drift[i] else None,
        )
        for i, pose in enumerate(posed)
    ]


def _stacked(transforms: Sequence[Float | None]) -> tuple[Float, Mask]:
    """Transforms (N, 4, 4), the identity where one is unknown, and whether each is known (N,)."""
    known = np.array([T is not None for T in transforms], np.bool_)
    return np.array([np.eye(4) if T is None else T for T in transforms]), known


def _points(T: Float, point_m: Float) -> Float:
    """A point (3,) under transforms (N, 4, 4): (N, 3)."""
    return T[:, :3, :3] @ point_m + T[:, :3, 3]


def _apart_mm(T_a: Float, T_b: Float, point_m: Float) -> Float:
    return 1e3 * np.linalg.norm(_points(T_b - T_a, point_m), axis=-1)


def _degrees(T_a: Float, T_b: Float) -> Float:
    """Angles (N,) between rotations; as ``core.geometry.angle_between`` of each."""
    R = np.swapaxes(T_a[..., :3, :3], -1, -2) @ T_b[..., :3, :3]
    sines = R[..., [2, 0, 1], [1, 2, 0]] - R[..., [1, 2, 0], [2, 0, 1]]
    return np.degrees(np.arctan2(np.linalg.norm(sines, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1))


@dataclass(frozen=True)
class MotionMark:
    """An event that stands out in a sequence."""

    place: int
    """Place of the frame, from 0."""
    kind: MarkKind
    """lost: it had a pose in the last frame that was solved, and has none; recovered: it has one again."""


def marks(kinds: Sequence[Kind]) -> tuple[MotionMark, ...]:
    """What stands out among the motions of an object, given the kind of each frame's; a frame may have two."""
    found: list[MotionMark] = []
    had_pose: bool | None = None
    for place, kind in enumerate(kinds):
        if kind == "not solved":
            continue
        has_pose = kind != "no pose"
        if had_pose is not None and has_pose != had_pose:
            found.append(MotionMark(place, "recovered" if has_pose else "lost"))
        if kind == "flip" or kind == "jump":
            found.append(MotionMark(place, kind))
        had_pose = has_pose if had_pose is not None or has_pose else None
    return tuple(found)


@dataclass(frozen=True)
class MotionCounts:
    """Summary of the changes of a pose over a sequence."""

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
        """Flips per 100 frames."""
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
    posed = [motion for motion in changes if motion.kind not in ("no pose", "not solved")]
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
