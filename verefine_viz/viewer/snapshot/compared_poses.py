"""The two poses that are compared, or the two combinations of poses where the whole scene is shown.

While two runs are compared, those of the runs, both by the rule of the open one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import PIXEL_CLASSES, ScoreMaps
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot
from verefine_viz.viewer.snapshot.scene_state import SceneState
from verefine_viz.viewer.snapshot.snapshot import ComparedPose, EvaluatedPose, Probe
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator, together
from verefine_viz.viewer.state.view_options import ViewOptions

INITIAL_POSES = "initial poses"
"""What the scene before the run is called."""
FALLBACK_A = ("current", "initial", "best", "ground truth")
FALLBACK_B = ("accepted", "best", "initial", "ground truth")
"""What is shown instead of a stage that does not exist at the cursor."""


def compared_poses(
    evaluator: CachedEvaluator,
    target: Target,
    poses: dict[str, EvaluatedPose],
    options: ViewOptions,
    deep: bool,
    runs: ComparisonSnapshot | None,
) -> tuple[ComparedPose | None, ComparedPose | None]:
    """A and B of the object in focus: poses of two runs, or the stages chosen, or what comes nearest to them;
    ``deep``: with score maps.
    """

    def side(pose: EvaluatedPose | None) -> ComparedPose | None:
        if pose is None:
            return None
        maps = evaluator.maps(target, pose.T_cam_obj) if deep else None
        return _with_probe(pose, maps, target, options)

    def of_run(name: str, T_cam_obj: Float, letter: c.Side) -> ComparedPose | None:
        score, errors = evaluator.score(target, T_cam_obj), evaluator.errors(target, T_cam_obj)
        return side(EvaluatedPose(name, T_cam_obj, score, errors, side=letter))

    T_a, T_b = runs.poses.get(target.instance.instance_id, (None, None)) if runs is not None else (None, None)
    if runs is not None and T_a is not None and T_b is not None:
        return of_run(runs.name_a, T_a, "A"), of_run(runs.name_b, T_b, "B")
    a = next((poses[name] for name in (options.a, *FALLBACK_A) if name in poses), None)
    # Before the first iteration, say, the ground truth shows more beside a pose than the same pose once more.
    unlike = [n for n in FALLBACK_B if a and n in poses and not np.array_equal(poses[n].T_cam_obj, a.T_cam_obj)]
    b = next((poses[name] for name in (options.b, *unlike, *FALLBACK_B) if name in poses), None)
    return side(a), side(b)


def compared_scenes(
    evaluator: CachedEvaluator,
    scene: SceneState,
    options: ViewOptions,
    branch: Branch,
    deep: bool,
    runs: ComparisonSnapshot | None,
) -> tuple[ComparedPose | None, ComparedPose | None]:
    """A: the objects as they stand now, or where the answer is shown, as they began. B: the answers so far."""
    known = [(o, o.T_cam_obj, o.answer) for o in scene.objects if o.T_cam_obj is not None and o.answer is not None]
    if not known:
        return None, None
    targets = [o.target for o, _, _ in known]
    name_a = f"pass {scene.closes_pass.number}" if scene.closes_pass else "now"
    Ts_a = [T for _, T, _ in known]
    if scene.is_answer:
        begun = branch.run.state_at(0)
        ids = [t.instance.instance_id for t in begun.problem.targets]
        name_a, Ts_a = INITIAL_POSES, [begun.best[ids.index(o.instance_id)].T_cam_obj for o, _, _ in known]

    def side(name: str, Ts_cam_obj: Sequence[Float], letter: c.Side | None = None) -> ComparedPose:
        Ts = np.array(Ts_cam_obj)
        score = together(evaluator, targets, Ts, branch.settings) if deep else None
        maps = evaluator.scene_maps(targets, Ts) if deep else None
        return _with_probe(EvaluatedPose(name, Ts, score, None, side=letter), maps, targets[0], options)

    if runs is not None:
        both = [runs.poses.get(o.instance_id, (None, None)) for o, _, _ in known]
        of_a, of_b = ([T for pair in both if (T := pair[k]) is not None] for k in (0, 1))
        if len(of_a) == len(of_b) == len(known):
            return side(runs.name_a, of_a, "A"), side(runs.name_b, of_b, "B")
    return side(name_a, Ts_a), side("best", [answer.T_cam_obj for _, _, answer in known])


def _with_probe(pose: EvaluatedPose, maps: ScoreMaps | None, target: Target, options: ViewOptions) -> ComparedPose:
    if maps is None or options.pixel is None:
        return ComparedPose(pose, maps)
    weight = pose.score.colour_weight if pose.score is not None else 0.0
    return ComparedPose(pose, maps, probe(maps, target, *options.pixel, weight))


def probe(maps: ScoreMaps, target: Target, u: int, v: int, colour_weight: float = 0.0) -> Probe:
    """The numbers of pixel (row v, column u); ``colour_weight`` is that of the pose's score."""
    observed, rendered = float(target.observation.depth_m[v, u]), float(maps.rendered_m[v, u])
    angle = float(np.rad2deg(maps.angle_rad[v, u]))
    counted = bool(maps.counted[v, u])
    f_d, f_n = float(maps.f_d[v, u]), float(maps.f_n[v, u])
    value = int(maps.classes[v, u])
    both = observed > 0 and rendered > 0
    return Probe(
        u=u,
        v=v,
        observed_m=observed if observed > 0 else None,
        rendered_m=rendered if rendered > 0 else None,
        difference_mm=(observed - rendered) * 1000 if both else None,
        angle_deg=angle if rendered > 0 and np.isfinite(angle) else None,
        f_d=f_d,
        f_n=f_n,
        pixel_class=PIXEL_CLASSES[value - 1] if value else "not scored",
        contribution=(1 - colour_weight) * (f_d + f_n) / 2 / int(maps.counted.sum()) if counted else 0.0,
        counted=counted,
        correlation=_number(maps.correlation, u, v),
        rendered_rgb=_rgb(maps.rendered_rgb, u, v) if rendered > 0 else None,
        observed_rgb=_rgb(maps.observed_rgb, u, v),
    )


def _number(image: NDArray[np.float32] | None, u: int, v: int) -> float | None:
    return None if image is None or not np.isfinite(image[v, u]) else float(image[v, u])


def _rgb(image: NDArray[np.uint8] | None, u: int, v: int) -> tuple[int, int, int] | None:
    return None if image is None else (int(image[v, u, 0]), int(image[v, u, 1]), int(image[v, u, 2]))
