"""Which score ranks real poses best: score against pose error on real frames with ground truth.

    python -m bench.rank_real_poses ../shared/data/ycbv

For every instance: disturbed ground truth (several sizes), its half turns and the model's flips and, where there are
any, poses of published estimators. A score is good if it orders them as their ADD(-S) error does. The rows of "refined"
are about the same poses after ``CALLS`` calls of ICP, ground truth too: what a method has to choose from.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.stats import spearmanr

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance, Placed, Problem, Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.core.settings import HypothesesSettings, IcpSettings, PhysicsSettings, SceneSettings, ScoreSettings
from verefine_viz.evaluation.near_symmetry import flips, near_symmetries
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.physics.plausibility import centre_of_mass, plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.refiners.icp import Icp
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.scenes.hypothesis_pool import perturbed
from verefine_viz.scenes.source import open_scene

SIZES = (2.0, 5.0, 10.0, 20.0, 30.0)
"""Disturbances: so many degrees, and as many millimetres."""
PER_SIZE = 12
TAU_M = 0.02
MASK_PX = 4
APART_MM = 2.0
"""Pairs of poses count whose errors differ by more."""
CLOSE_MM = 15.0
"""``close_pairs``: both errors are below this."""
CALLS = 3
CLOSE_TURN = 0.05
"""``turns``: those whose score of depth and normals is that near to ground truth's."""


@dataclass(frozen=True)
class Variant:
    """One way to turn a picture of the model into a score."""

    name: str
    pixels: str = "classes"
    alpha: float = 0.707
    tau_m: float = TAU_M
    no_normal: str = "depth"
    """Where no normal was observed: "depth" lets f_d stand for f_n, "zero" gives 0."""
    outside: str = "wrong"
    """A rendered pixel outside the mask on a surface within τ: explained, neutral or wrong."""
    in_front: str = "wrong"
    """A pixel of the mask that is nearer than the model by more than τ: wrong or neutral."""
    unknown: str = "neutral"
    missed: str = "wrong"
    colour: float = 0.0
    """w of the colour term; needs models with colours."""
    plausibility: float = 0.0
    """w of plausibility, each object alone on the support plane."""


VARIANTS = (
    Variant("published", "published", no_normal="zero"),
    Variant("published, α .293", "published", 0.293, no_normal="zero"),
    Variant("observed", "observed"),
    Variant("observed, α .293", "observed", 0.293),
    Variant("classes (default)"),
    Variant("classes, α .293", alpha=0.293),
    Variant("classes, no normal = 0", no_normal="zero"),
    Variant("classes, outside neutral", outside="neutral"),
    Variant("classes, outside explained", outside="explained"),
    Variant("classes, in front neutral", in_front="neutral"),
    Variant("classes, unknown wrong", unknown="wrong"),
    Variant("classes, missed neutral", missed="neutral"),
    Variant("classes, τ 10 mm", tau_m=0.01),
    Variant("classes, τ 40 mm", tau_m=0.04),
    *(Variant(f"classes, colour {w}", colour=w) for w in (0.05, 0.1, 0.2, 0.3, 0.5)),
    *(Variant(f"classes, plausibility {w}", plausibility=w) for w in (0.1, 0.3)),
)


@dataclass(frozen=True, eq=False)
class Picture:
    """One pose's rendering beside what was observed, the pixels of both only."""

    observed_m: NDArray
    rendered_m: NDArray
    cosine: NDArray
    has_normal: NDArray
    own: NDArray
    objects: NDArray
    n_objects_elsewhere: int
    f_c: float | None
    """By the mask as annotated; None where the object has no colour term."""
    p: float
    """Plausibility; 0 where the frame has no support plane."""


def score(p: Picture, v: Variant) -> float:
    """The score of a picture in one variant."""
    if v.plausibility:
        return (1 - v.plausibility) * score(p, replace(v, plausibility=0.0)) + v.plausibility * p.p
    if v.colour and p.f_c is not None:
        return (1 - v.colour) * score(p, replace(v, colour=0.0)) + v.colour * max(p.f_c, 0.0)
    drawn, measured = p.rendered_m > 0, p.observed_m > 0
    difference = p.observed_m - p.rendered_m
    near = drawn & measured & (np.abs(difference) < v.tau_m)
    n_elsewhere = 0
    if v.pixels == "published":
        fits, counted = drawn & p.objects, drawn | p.objects
        n_elsewhere = p.n_objects_elsewhere
    elif v.pixels == "observed":
        fits, counted = drawn & p.own, p.own
    else:
        fits = near & (p.own | (v.outside == "explained"))
        counted = fits | (drawn & measured & (difference >= v.tau_m))
        if v.outside == "wrong":
            counted |= near
        if v.in_front == "wrong":
            counted |= drawn & p.own & (difference <= -v.tau_m)
        if v.missed == "wrong":
            counted |= p.own & ~drawn
        if v.unknown == "wrong":
            counted |= drawn & ~measured
    n = counted.sum() + n_elsewhere
    if n == 0:
        return 0.0
    f_d = np.maximum(0, 1 - np.abs(difference[fits]) / v.tau_m)
    f_n = np.maximum(0, 1 - (1 - np.clip(p.cosine[fits], 0, 1)) / v.alpha)
    if v.no_normal == "depth":
        f_n = np.where(p.has_normal[fits], f_n, f_d)
    total = 0.5 * (f_d.sum() + f_n.sum()) / n
    if v.pixels != "classes" or not drawn.any():
        return float(total)
    judged = (drawn & measured & ((difference > -v.tau_m) | p.own)).sum() / drawn.sum()
    return float(total * min(1.0, judged / 0.1))


def masks(mask: NDArray, all_masks: NDArray) -> Iterator[tuple[str, NDArray, NDArray]]:
    """The mask and all masks together: as annotated, cut back and grown by ``MASK_PX``, as detectors deliver them."""
    yield "exact", mask, all_masks
    yield "small", binary_erosion(mask, iterations=MASK_PX), binary_erosion(all_masks, iterations=MASK_PX)
    yield "large", binary_dilation(mask, iterations=MASK_PX), binary_dilation(all_masks, iterations=MASK_PX)


def pictures(
    target: Target, all_maps: Sequence[ScoreMaps], shares: NDArray, mask: NDArray, all_masks: NDArray
) -> Iterator[Picture]:
    """The picture of each pose, with its plausibility."""
    observation = target.observation
    measured = observation.depth_m > 0
    own, objects = mask & measured, all_masks & measured
    for maps, share in zip(all_maps, shares, strict=True):
        used = (maps.rendered_m > 0) | own
        cosine = np.einsum("ij,ij->i", observation.normals_cam[used], maps.rendered_normals[used])
        yield Picture(
            observed_m=observation.depth_m[used].astype(float),
            rendered_m=maps.rendered_m[used].astype(float),
            cosine=cosine.astype(float),
            has_normal=(observation.normals_cam[used] != 0).any(axis=1),
            own=own[used],
            objects=objects[used],
            n_objects_elsewhere=int((objects & ~used).sum()),
            f_c=None
            if maps.correlation is None
            else float(np.nan_to_num(maps.correlation[maps.classes == 1]).sum())
            / max(int((maps.classes == 1).sum()), 1),
            p=float(share),
        )


def shares(target: Target, Ts: NDArray, surfaces: Surfaces) -> NDArray:
    """(N,) plausibility of poses (N, 4, 4)."""
    support = target.observation.support
    if support is None:
        return np.zeros(len(Ts))
    com_obj = centre_of_mass(target.model, PhysicsSettings())
    poses = (Placed(target.instance.instance_id, target.model, T) for T in Ts)
    checked = (plausibility(pose, (), support, surface_of=surfaces, com_obj=com_obj) for pose in poses)
    return np.array([one.share(TAU_M) for one in checked])


def candidates(instance: Instance, model: ObjectModel, results: Problem | None) -> tuple[NDArray, NDArray, NDArray]:
    """Poses (N, 4, 4), ground truth first, whether each comes from an estimator (N,), and whether it is a half turn."""
    T_gt = instance.T_cam_obj_gt
    assert T_gt is not None
    poses, real = [T_gt], [False]
    for size in SIZES:
        made = perturbed(T_gt, PER_SIZE, size, size, (7, int(size), instance.instance_id, instance.obj_id))
        poses += [h.T_cam_obj for h in made]
        real += [False] * PER_SIZE
    # Upside down and back to front, about the middle of the model: the turns that symmetric shapes invite.
    middle = (model.vertices.min(axis=0) + model.vertices.max(axis=0)) / 2
    n_disturbed = len(poses)
    for axis in np.eye(3):
        R = axis_angle(axis, np.pi)
        poses.append(T_gt @ transform(R, middle - R @ middle))
        real.append(False)
    poses += [T_gt @ T for T in flips(near_symmetries(model))]
    real += [False] * (len(poses) - len(real))
    if results is not None:
        there = next((i for i in results.instances if i.instance_id == instance.instance_id), None)
        estimated = [h.T_cam_obj for h in there.hypotheses] if there else []
        poses += estimated
        real += [True] * len(estimated)
    is_turn = np.zeros(len(poses), bool)
    is_turn[n_disturbed : n_disturbed + 3] = True
    return np.stack(poses), np.array(real), is_turn


def rank(
    scores: NDArray, errors: NDArray, is_real: NDArray, is_close_turn: NDArray, diameter_mm: float
) -> dict[str, float]:
    """How well one instance's scores order its poses; entry 0 is ground truth, left out of the ranking.

    Returns:
        spearman: rank correlation of score and closeness. pairs, close_pairs: share of pairs in the right order. top1:
        the best-scored pose is the least wrong one within 1 mm. regret_mm: by how much it is not. gt_beaten: a pose
        scored above ground truth; …_by_wrong: one further off than a tenth of the diameter. spread: score of ground
        truth above the median score of the worse half of the poses. real_…: among the estimators' poses only. turns:
        of the half turns that depth and normals score within ``CLOSE_TURN`` of ground truth, the share scored lower.
    """
    s, e = scores[1:], errors[1:]
    best = int(np.argmax(s))
    i, j = np.triu_indices(len(s), 1)
    apart = np.abs(e[i] - e[j]) > APART_MM
    right = (s[i] - s[j]) * (e[i] - e[j]) < 0
    close = apart & (np.maximum(e[i], e[j]) < CLOSE_MM)
    out = {
        "spearman": -float(np.asarray(spearmanr(s, e))[0]) if np.ptp(s) > 0 else 0.0,
        "pairs": float(right[apart].mean()),
        "close_pairs": float(right[close].mean()),
        "top1": float(e[best] <= e.min() + 1.0),
        "regret_mm": float(e[best] - e.min()),
        "gt_beaten": float((s > scores[0]).any()),
        "gt_beaten_by_wrong": float((s[e > CORRECT * diameter_mm] > scores[0]).any()),
    }
    out["spread"] = float(scores[0] - np.median(s[e > np.median(e)]))
    if is_close_turn.any():
        out["turns"] = float((scores[is_close_turn] < scores[0]).mean())
    real = is_real[1:]
    if real.sum() > 1:
        chosen = e[real][int(np.argmax(s[real]))]
        out |= {"real_top1": float(chosen <= e[real].min() + 1.0), "real_regret_mm": float(chosen - e[real].min())}
    return out


def run(dataset: Path, variants: tuple[Variant, ...] = VARIANTS) -> list[dict[str, Any]]:
    """One row per kind of mask and variant: means over all instances of all frames."""
    files = tuple(str(f) for f in sorted((dataset / "pose_estimates").glob("*.csv")))
    scene = SceneSettings(source="bop", dataset=str(dataset))
    source = open_scene(scene, HypothesesSettings(source="perturb"))
    estimates = open_scene(scene, HypothesesSettings(source="results", files=files)) if files else None
    surfaces = Surfaces()
    verifier, refiner = CpuVerifier(ScoreSettings(simplify_mm=0.2, colour_weight=0.5)), Icp(IcpSettings())
    table: dict[tuple[str, str], list[dict[str, float]]] = {}
    for frame in source.frames:
        problem = source.problem(frame)
        results = estimates.problem(frame) if estimates else None
        for target in problem.targets:
            instance, model = target.instance, target.model
            if instance.T_cam_obj_gt is None or not (instance.mask & (problem.observation.depth_m > 0)).any():
                continue
            Ts, is_real, is_turn = candidates(instance, model, results)
            kinds = list(masks(instance.mask, problem.observation.object_mask))
            ranked_poses = [(kind, Ts) for kind in kinds]
            refined = Ts
            for _ in range(CALLS):
                refined = np.stack([refiner.refine(target, T) for T in refined])
            ranked_poses.append((("refined", *kinds[0][1:]), refined))
            for (kind, *both), poses in ranked_poses:
                errors = np.array([pose_errors(model, T, instance.T_cam_obj_gt).add_s_mm for T in poses])
                geometric = CpuVerifier(ScoreSettings()).score(target, poses).score
                close_turn = is_turn & (np.abs(geometric - geometric[0]) < CLOSE_TURN)
                maps = [verifier.maps(target, T) for T in poses]
                seen = list(pictures(target, maps, shares(target, poses, surfaces), *both))
                for v in variants:
                    scores = np.array([score(p, v) for p in seen])
                    ranked = rank(scores, errors, is_real, close_turn, model.diameter_m * 1e3)
                    table.setdefault((kind, v.name), []).append(ranked)
    return [{"mask": kind, "score": name, **_means(rows)} for (kind, name), rows in sorted(table.items())]


def _means(rows: list[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for row in rows for name in row)
    out = {name: float(np.mean([row[name] for row in rows if name in row])) for name in names}
    return {"instances": len(rows), **out}


def main(arguments: list[str]) -> None:
    """Prints the table, and writes it as JSON where a second path is given."""
    rows = run(Path(arguments[0] if arguments else "../shared/data/ycbv"))
    names = [name for name in rows[0] if name not in ("score", "mask")]
    print(" " * 46 + "".join(f"{name:>20}" for name in names))
    for row in rows:
        print(f"{row['mask']:<6}{row['score']:<40}" + "".join(f"{row[name]:>20.3f}" for name in names))
    if len(arguments) > 1:
        Path(arguments[1]).write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
