"""The two combinations of poses that are compared where the whole scene is shown, scored as a scene."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Instance, Problem, Target
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.settings import Session
from verefine_viz.viewer.judge import Judge, together
from verefine_viz.viewer.look import Look
from verefine_viz.viewer.maps import probe
from verefine_viz.viewer.scene_now import SceneNow
from verefine_viz.viewer.view import Judged, Side

FIRST = "first poses"
"""What the scene before the run is called."""


def frame_score(judge: Judge, scene: SceneNow, session: Session) -> PoseScore | None:
    """The score of all answers so far, rendered together; None for a single object."""
    known = [(o.target, o.answer.T_cam_obj) for o in scene.objects if o.answer is not None]
    if len(known) < 2:
        return None
    return together(judge, [target for target, _ in known], np.array([T for _, T in known]), session)


@lru_cache(maxsize=4)
def scene_target(problem: Problem) -> Target:
    """All objects as if they were one: what score maps are cut to and coloured by."""
    mask = np.any([i.mask for i in problem.instances], axis=0)
    model = max(problem.models.values(), key=lambda model: model.diameter_m)
    return Target(problem.observation, Instance(-1, model.obj_id, mask, np.zeros((0, 3)), ()), model)


def scene_sides(
    judge: Judge,
    scene: SceneNow,
    look: Look,
    session: Session,
    deep: bool,
    first: Mapping[int, Float] | None = None,
) -> tuple[Side | None, Side | None]:
    """A: the objects as they stand now, or at their ``first`` poses (4, 4) by instance_id. B: the answers so far."""
    known = [o for o in scene.objects if o.T_cam_obj is not None and o.answer is not None]
    if not known:
        return None, None
    now = np.array([first[o.instance_id] if first else o.T_cam_obj for o in known])
    best = np.array([o.answer.T_cam_obj for o in known if o.answer is not None])
    closed = scene.closes_pass
    name = FIRST if first else f"pass {closed.number}" if closed else "now"
    targets = [o.target for o in known]

    def side(name: str, Ts: Float) -> Side:
        score = together(judge, targets, Ts, session) if deep else None
        pose = Judged(name, Ts, score, None)
        if not deep:
            return Side(pose, None)
        maps = judge.scene_maps(targets, Ts)
        return Side(pose, maps, probe(maps, targets[0], *look.pixel) if look.pixel else None)

    return side(name, now), side("best", best)
