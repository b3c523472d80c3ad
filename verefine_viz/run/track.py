"""``method.track``: the answers of a frame are initial poses in the next frame of its scene (docs/methods.md 1.13).

The session alone determines these poses: they are the answers of its own runs on the earlier frames. So it does not
matter which process solves which frame, or which answers are read from run files instead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.geometry import inverse
from verefine_viz.core.problem import Hypothesis, Instance, Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session, TrackedPose
from verefine_viz.run.engine import Run


@dataclass(frozen=True, eq=False)
class EarlierPose:
    """The answer of an earlier frame for one object."""

    frame: str
    obj_id: int
    instance_id: int
    T_cam_obj: Float
    """(4, 4) [m]."""
    T_map_cam: Float | None
    """(4, 4) camera of that frame to the data set's world [m]; None = unknown."""


Known = Mapping[tuple[int, int], EarlierPose]
"""The latest answer for each object of a scene, by obj_id and instance_id, those of the latest frame last."""


def answers_of(run: Run) -> tuple[EarlierPose, ...]:
    """The answers of a finished run."""
    problem, best = run.problem, run.final_state.best
    return tuple(
        EarlierPose(problem.frame, i.obj_id, i.instance_id, pose.T_cam_obj, problem.observation.T_map_cam)
        for i, pose in zip((t.instance for t in problem.targets), best, strict=True)
        if pose is not None
    )


class Track:
    """The answers of frames, each worked out once.

    Args:
        frames: of the session, in any order; a scene's frames are taken by number.
        solve: solves one of them; a VerefineError means that it has no answer.
        progress: checked before a frame is solved.
    """

    def __init__(
        self, frames: Sequence[str], solve: Callable[[str], tuple[EarlierPose, ...]], progress: ProgressToken
    ) -> None:
        self._frames, self._solve, self._progress = sorted(frames, key=parse_frame), solve, progress
        self._known: dict[str, Known] = {}
        """Answers after each frame."""
        self.recall: Callable[[str], tuple[EarlierPose, ...] | None] = lambda frame: None
        """Returns the answers of a frame solved elsewhere, which need not be solved again; None = unknown."""

    def before(self, frame: str) -> Known:
        """The answers known when a frame begins; none for the first of a scene, or for a frame that is not listed."""
        scene = parse_frame(frame)[0]
        earlier = [f for f in self._frames if parse_frame(f)[0] == scene]
        earlier = earlier[: earlier.index(frame)] if frame in earlier else []
        first = next((k + 1 for k in reversed(range(len(earlier))) if earlier[k] in self._known), 0)
        known = self._known[earlier[first - 1]] if first else {}
        for k in range(first, len(earlier)):
            new = {(one.obj_id, one.instance_id): one for one in self._answers(earlier[k], frame)}
            known = {key: one for key, one in known.items() if key not in new} | new
            self._known[earlier[k]] = known
        return known

    def _answers(self, earlier: str, frame: str) -> tuple[EarlierPose, ...]:
        recalled = self.recall(earlier)
        if recalled is not None:
            return recalled
        self._progress.checkpoint(f"Tracking: frame {frame} begins with earlier answers; solving {earlier}.")
        try:
            return self._solve(earlier)
        except VerefineError:
            return ()


def tracked_poses(problem: Problem, known: Known) -> tuple[TrackedPose, ...]:
    """The answers that are initial poses of this frame's objects.

    Objects are matched by model; where either frame has several of a model, by number, too.
    """
    here = Counter(instance.obj_id for instance in problem.instances)
    poses = []
    for instance in problem.instances:
        of_model = [answer for answer in known.values() if answer.obj_id == instance.obj_id]
        latest = [answer for answer in of_model if answer.frame == of_model[-1].frame]
        is_alone = here[instance.obj_id] == len(latest) == 1
        answer = latest[0] if is_alone else known.get((instance.obj_id, instance.instance_id))
        if answer is not None:
            T = _moved_with_camera(answer, problem.observation.T_map_cam)
            pose = tuple(T.ravel().tolist())
            poses.append(
                TrackedPose(
                    frame=problem.frame, instance=instance.instance_id, T_cam_obj=pose, answered_in=answer.frame
                )
            )
    return tuple(poses)


def _moved_with_camera(answer: EarlierPose, T_map_cam: Float | None) -> Float:
    if answer.T_map_cam is None or T_map_cam is None:
        return answer.T_cam_obj
    return inverse(T_map_cam) @ answer.T_map_cam @ answer.T_cam_obj


def with_tracked(problem: Problem, poses: Sequence[TrackedPose]) -> Problem:
    """The problem with these initial poses before the others."""
    of = {pose.instance: pose for pose in poses}
    if not of:
        return problem
    instances = tuple(_with_pose(i, of[i.instance_id]) if i.instance_id in of else i for i in problem.instances)
    return replace(problem, instances=instances)


def _with_pose(instance: Instance, pose: TrackedPose) -> Instance:
    confidence = max((h.confidence for h in instance.hypotheses), default=1.0)
    source = f"tracked, the answer of frame {pose.answered_in}"
    first = Hypothesis(np.reshape(pose.T_cam_obj, (4, 4)), confidence, source, pose.answered_in)
    # Recorded steps of another program still refer to its own initial poses.
    recorded = tuple(replace(step, hypothesis=step.hypothesis + 1) for step in instance.recorded)
    scores = (None, *instance.recorded_scores) if instance.recorded_scores else ()
    hypotheses = (first, *instance.hypotheses)
    return replace(instance, hypotheses=hypotheses, recorded=recorded, recorded_scores=scores)


def with_its_tracked(session: Session, problem: Problem) -> Session:
    """A session that states the tracked poses with which one of its frames began."""
    stated = tuple(
        TrackedPose(
            frame=problem.frame,
            instance=i.instance_id,
            T_cam_obj=tuple(h.T_cam_obj.ravel().tolist()),
            answered_in=h.tracked_from,
        )
        for i in problem.instances
        for h in i.hypotheses
        if h.tracked_from
    )
    others = tuple(pose for pose in session.tracked if pose.frame != problem.frame)
    return structs.replace(session, tracked=(*others, *stated)) if stated or session.tracked else session
