"""Labels of one frame carried to the frames after it: docs/methods.md 9.3.

Each label moves with the camera and is refined, settled and verified there with the others where they are, most visible
first. So nothing adds up over frames: the camera's motion is a start, depth decides. Only what does not fit there is
snapped as if a person had placed it: trying other turns first would forget what an earlier frame showed, such as where
the handle is. What is hidden or outside of the image is carried along unseen, and labelled again where it appears.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between, apply
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.labels.camera_motion import CameraMotion, UnknownMotion, camera_motion
from verefine_viz.labels.placing import target_at
from verefine_viz.labels.snapping import Snapped, rivals_of
from verefine_viz.labels.verification import labelled
from verefine_viz.run.refined_pose import refined_pose
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.labels import Label, Light, State
from verefine_viz.scenes.own_pixels import fit_reach_m
from verefine_viz.scenes.unlabelled_frames import Models, UnlabelledFrames

LEAST_SEEN = 0.05
"""Share of an object's front that must be inside of the image, with nothing measured before it."""
AGREES_M, AGREES_DEG = 0.005, 3.0
"""How far a snapped pose may lie from where the camera's motion puts it and count as standing still: noise."""
FOLLOWED_DEG = 20.0
"""A larger turn within one step is a flip until a person has seen it, also under a green light."""
LIGHTS: tuple[Light, ...] = ("green", "amber", "red")
"""Traffic lights from best to worst."""


@dataclass(frozen=True, eq=False)
class CarriedFrame:
    """A frame and the labels that were carried to it."""

    frame: str
    labels: tuple[Label, ...]
    """Labels, in the order of the frame before."""
    unseen: tuple[Label, ...]
    """Labels of objects that this frame does not show, where the camera's motion puts them."""
    motion: CameraMotion | UnknownMotion
    notes: tuple[str, ...] = ()
    """Notes on single objects: hidden, outside of the image, moved."""

    @property
    def stops(self) -> bool:
        """Whether a person must look before it goes on."""
        is_red = any(label.light == "red" for label in self.labels)
        return is_red or not self.labels or isinstance(self.motion, UnknownMotion)


def carried(
    tools: Toolbox,
    last: tuple[str, Observation],
    labels: Sequence[Label],
    following: tuple[str, Observation],
    models: Models,
    before: Float | None = None,
) -> CarriedFrame:
    """The labels of a frame carried to the next.

    Args:
        tools: of the session: refiner, simulator and verifier.
        last: name and images of the frame with labels.
        labels: its labels, also of what it does not show.
        following: name and images of the next frame.
        models: of the objects.
        before: (4, 4) the camera's motion before this one [m].

    Raises:
        ShapeError: no solid can be made of a model.
    """
    frame, observation = following
    there = [Placed(label.instance, models.get(label.obj_id), label.pose) for label in labels]
    motion = camera_motion(last[1], observation, there, before)
    T_next_last = motion.T_next_last if isinstance(motion, CameraMotion) else np.eye(4)
    moved = {one.instance_id: replace(one, T_cam_obj=T_next_last @ one.T_cam_obj) for one in there}
    shown = {instance: _shown(observation, one) for instance, one in moved.items()}
    earlier = {label.instance: label for label in labels}
    notes, found, placed = [], dict[int, Label](), {**moved}
    for instance in sorted(moved, key=lambda k: -shown[k].share):
        start, before_it = moved[instance], earlier[instance]
        if shown[instance].how:
            notes.append(f"{before_it.name} is {shown[instance].how}")
            continue
        others = [one for k, one in placed.items() if k != instance]
        label = _labelled_again(tools, observation, start, others, before_it, f"carried from {last[0]}")
        placed[instance], found[instance] = replace(start, T_cam_obj=label.pose), label
        way = _way(start, label.pose)
        if not way.is_none:
            notes.append(f"{label.name} moved by {1e3 * way.moved_m:.0f} mm and {way.turned_deg:.0f}° itself")
    unseen = [_at(label, moved[label.instance].T_cam_obj) for label in labels if label.instance not in found]
    ordered = [found[label.instance] for label in labels if label.instance in found]
    return CarriedFrame(frame, tuple(ordered), tuple(unseen), motion, tuple(notes))


def _labelled_again(
    tools: Toolbox,
    observation: Observation,
    start: Placed,
    others: Sequence[Placed],
    before: Label,
    begun: str,
) -> Label:
    """An object's label in the next frame: refined where it should stand, and snapped where that does not fit."""
    stood = labelled(tools, observation, start, others, begun, _refined_there)
    way = _way(start, stood.pose)
    if way.is_none and LIGHTS.index(stood.light) <= LIGHTS.index(before.light) and stood.light != "red":
        return _decided(before, stood, way)
    sought = labelled(tools, observation, start, others, begun)
    best = stood if way.is_none and LIGHTS.index(stood.light) <= LIGHTS.index(sought.light) else sought
    return _decided(before, best, _way(start, best.pose))


def _refined_there(tools: Toolbox, observation: Observation, proposed: Placed, others: Sequence[Placed]) -> Snapped:
    """An object refined and settled on the pixels that are its own where it is proposed, without other turns."""
    T, model, own, scene = proposed.T_cam_obj, proposed.model, proposed.instance_id, tools.session.scene
    rested = refined_pose(tools, target_at(observation, model, own, T, others, scene), T, others).T_cam_obj
    target = target_at(observation, model, own, rested, others, scene)
    verified = refined_pose(tools, target, rested, others, with_allowed=True)
    return Snapped(target, T, verified, rivals_of(tools, target, verified.T_cam_obj, others))


def carried_on(
    tools: Toolbox,
    frames: UnlabelledFrames,
    names: Sequence[str],
    labels: Sequence[Label],
    progress: ProgressToken = NEVER_CANCELLED,
) -> Iterator[CarriedFrame]:
    """Carries labels from frame to frame, up to the first at which a person must look, or to the end.

    Args:
        tools: of the session.
        frames: where images and models come from.
        names: the frame with labels, and those after it.
        labels: of the first.
        progress: checked before each frame.

    Raises:
        VerefineError: a frame is missing or damaged, or no solid can be made of a model.
        Cancelled: it is not wanted any more.
    """
    last, before = (names[0], frames.observation(names[0])[0]), None
    for name in names[1:]:
        progress.checkpoint(f"Carrying labels to frame {name}.")
        following = name, frames.observation(name)[0]
        step = carried(tools, last, labels, following, frames.models, before)
        yield step
        if step.stops:
            return
        last, labels = following, (*step.labels, *step.unseen)
        before = step.motion.T_next_last if isinstance(step.motion, CameraMotion) else None


@dataclass(frozen=True)
class _Shown:
    share: float
    """Share of the front, in [0, 1]."""
    how: str = ""
    """Why the object is not to be labelled; empty where it is."""


def _shown(observation: Observation, one: Placed) -> _Shown:
    """How much of an object a frame may show at its pose."""
    camera = observation.camera
    points = apply(one.T_cam_obj, one.model.points)
    front = (points * (one.model.point_normals @ one.T_cam_obj[:3, :3].T)).sum(axis=1) < 0
    points = points[front & (points[:, 2] > 1e-3)]
    u, v = np.rint(camera.project(points)).astype(np.int64).T
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    if inside.sum() < LEAST_SEEN * max(int(front.sum()), 1):
        return _Shown(0.0, "outside of the image")
    depth_m = observation.depth_m[v[inside], u[inside]]
    hidden = (depth_m > 0) & (depth_m < points[inside, 2] - fit_reach_m(one.model))
    if hidden.mean() > 1 - LEAST_SEEN:
        return _Shown(0.0, "hidden")
    return _Shown(float((~hidden).sum() / front.sum()))


@dataclass(frozen=True)
class _Way:
    """Motion of an object that the camera's motion does not explain."""

    moved_m: float
    turned_deg: float

    @property
    def is_none(self) -> bool:
        """Whether the motion is noise."""
        return self.moved_m <= AGREES_M and self.turned_deg <= AGREES_DEG


def _way(start: Placed, T_cam_obj: Float) -> _Way:
    """Shift of an object's middle and its turn, up to its symmetries."""
    middles = [apply(T, start.model.middle_m[None])[0] for T in (start.T_cam_obj, T_cam_obj)]
    turns = (angle_between(T_cam_obj[:3, :3], (start.T_cam_obj @ S)[:3, :3]) for S in start.model.symmetries)
    return _Way(float(np.linalg.norm(middles[1] - middles[0])), float(np.degrees(min(turns))))


def _at(label: Label, T_cam_obj: Float) -> Label:
    return structs.replace(label, T_cam_obj=tuple(T_cam_obj.ravel().tolist()))


def _decided(before: Label, now: Label, way: _Way) -> Label:
    """The label in the state that needs no person: accepted where no look is needed; a person's doubts stay."""
    if before.state == "uncertain" and now.light != "red":
        return structs.replace(now, state="uncertain", note=before.note)
    is_as_good = LIGHTS.index(now.light) <= LIGHTS.index(before.light) and way.is_none
    is_sure = now.light == "green" and way.turned_deg <= FOLLOWED_DEG
    is_accepted = before.state == "accepted" and now.light != "red" and (is_sure or is_as_good)
    state: State = "accepted" if is_accepted else "proposed"
    return structs.replace(now, state=state)
