"""How often a diagnosis of a real failure is true, by brute force on real frames.

    python -m bench.oracle DATASET_FOLDER [--seeds 5] [--first 0] [--frames 0/1 …] [--rotation 40] [--translation 20]

Each frame is solved by a method for one object from disturbed ground truth. Of each wrong answer the oracle works out,
far more costly than a diagnosis may be: whether any scored pose of the run was correct; the highest score of a correct
pose, of the run or near the ground truth; by how much of its noise the highest score in reach of these is above the
highest in reach of the answer, both scored in full in forty resampled images; to which poses the refiner alone takes
every hypothesis; and how often ten re-runs on other samples of the observed points come out right, with nothing changed
and with what the diagnosis put right. A verdict is confirmed if all of that agrees with it.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.optimize import minimize

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import apply, axis_angle, random_unit_vector, transform
from verefine_viz.diagnosis.case import ALONE, TOGETHER, Case
from verefine_viz.diagnosis.diagnose import Diagnosis, diagnosed, failed_cases
from verefine_viz.diagnosis.score_causes import scored
from verefine_viz.evaluation.allowed_poses import CANNOT_TELL
from verefine_viz.evaluation.depth_noise import depth_noise, resampled
from verefine_viz.evaluation.pose_errors import adds_mm
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

SAMPLES = range(100, 110)
"""Samples of the observed points that no diagnosis has used."""
CALLS = 40
"""Calls of the refiner for each hypothesis."""
NEAR_GT = 20
"""Poses near ground truth, refined, of which the correct ones show what the score can reach there."""
RARELY, MOSTLY = 3, 7
"""Right ones of ten re-runs."""
N_IMAGES = 40
"""Resampled depth images."""
TOPS = 3
"""Correct poses near which the highest score is sought."""


@dataclass(frozen=True)
class Facts:
    """What the oracle found out about a wrong answer."""

    n_correct_seen: int
    """Scored poses of the run that are correct."""
    best_correct_score: float
    """Score of the best of those; −1 without any."""
    score: float
    """Score of the answer."""
    score_at_gt: float
    """The highest of correct poses: of the run, near ground truth, and that the refiner takes hypotheses to."""
    sigmas: float
    """By how many standard deviations the highest score near them is above the highest near the answer."""
    best_leading_score: float
    """Best score of correct poses that the refiner alone takes hypotheses to; −1 without any."""
    n_leading: int
    """Hypotheses that the refiner alone takes to a correct pose."""
    n_by_chance: int
    """Re-runs that come out right with nothing changed."""
    n_repaired: int | None
    """And with what the diagnosis put right; None where that was nothing."""
    surface_error: float
    """ADD-S, as a share of the diameter."""


def facts_of(case: Case, diagnosis: Diagnosis) -> Facts:
    """Everything, by brute force."""
    assert case.answer is not None
    T_answer, stages = case.answer.T_cam_obj, [s for i in case.own for s in i.stages if s.score is not None]
    seen = [s for s in stages if case.error_of(s.T_cam_obj) < case.threshold]
    ends = [_refined(case, h.T_cam_obj, CALLS) for h in case.target.instance.hypotheses]
    leading = [[T for T in way if case.error_of(T) < case.threshold] for way in ends]
    correct = [*(s.T_cam_obj for s in seen), *(T for way in leading for T in way), *_near_gt(case)]
    score, *scores = (one.score for one in scored(case, np.array([T_answer, *correct])))
    best = int(np.argmax(scores))
    return Facts(
        len(seen),
        max((s.score.score for s in seen if s.score), default=-1.0),
        score,
        scores[best],
        _sigmas(case, [correct[k] for k in np.argsort(scores)[: -1 - TOPS : -1]], T_answer),
        max((one.score for way in leading if way for one in scored(case, np.array(way))), default=-1.0),
        sum(map(bool, leading)),
        case.n_right(TOGETHER + ALONE if case.group else ALONE, SAMPLES),
        case.n_right(diagnosis.main.rests_on, SAMPLES) if diagnosis.main.rests_on else None,
        adds_mm(case.target.model, T_answer, case.T_gt) / (1e3 * case.target.model.diameter_m),
    )


def _refined(case: Case, T: Float, calls: int) -> list[Float]:
    way = [T]
    for _ in range(calls):
        way.append(case.lab.refiner.refine(case.target, way[-1], case.placed))
        if np.abs(way[-1] - way[-2]).max() < 1e-7:
            break
    return way


def _near_gt(case: Case) -> list[Float]:
    """Correct poses (4, 4) that the refiner makes of ground truth and of poses near it."""
    rng = np.random.default_rng(0)
    poses = _refined(case, case.T_gt, CALLS)
    for _ in range(NEAR_GT):
        turn = axis_angle(random_unit_vector(rng), np.deg2rad(rng.uniform(0, 5)))
        near = transform(turn @ case.T_gt[:3, :3], case.T_gt[:3, 3] + rng.uniform(0, 0.004) * random_unit_vector(rng))
        poses += _refined(case, near, 10)
    return [T for T in poses if case.error_of(T) < case.threshold]


def _sigmas(case: Case, correct: list[Float], T_answer: Float) -> float:
    """By how many standard deviations the highest score near correct poses is above the highest near the answer."""
    right = max((_highest_near(case, T) for T in correct), key=lambda top: top[1])
    wrong = _highest_near(case, T_answer)
    return (right[1] - wrong[1]) / _noise_of_difference(case, right[0], wrong[0])


def _highest_near(case: Case, T_start: Float) -> tuple[Float, float]:
    """The pose with the highest score that simplexes of two sizes come to from a pose, and the score."""

    def moved(x: Float) -> Float:
        angle = float(np.linalg.norm(x[:3]))
        R = axis_angle(x[:3] / angle, np.deg2rad(angle)) if angle else np.eye(3)
        centre = apply(T_start, case.target.model.points.mean(axis=0)[None])[0]
        return transform(R @ T_start[:3, :3], R @ (T_start[:3, 3] - centre) + centre + 1e-3 * x[3:])

    x = np.zeros(6)
    for size in (2.0, 0.3):
        simplex = np.vstack([x, x + size * np.eye(6)])
        options = {"initial_simplex": simplex, "maxfev": 600, "xatol": 0.005, "fatol": 1e-6}
        x = minimize(lambda x: -scored(case, moved(x)[None])[0].score, x, method="Nelder-Mead", options=options).x
    return moved(x), scored(case, moved(x)[None])[0].score


def _noise_of_difference(case: Case, T_one: Float, T_other: Float) -> float:
    """Standard deviation of the difference between the scores of two poses, each resampled image scored in full."""
    observation, rng = case.target.observation, np.random.default_rng(0)
    noise, differences = depth_noise(observation), []
    for _ in range(N_IMAGES):
        depth_m = resampled(observation.depth_m, noise, rng)
        again = replace(observation, depth_m=depth_m, normals_cam=estimate_normals(depth_m, observation.camera))
        one, other = scored(replace(case, target=replace(case.target, observation=again)), np.array([T_one, T_other]))
        differences.append(one.score - other.score)
    return float(np.std(differences))


def objection(diagnosis: Diagnosis, facts: Facts) -> str:
    """Why a verdict is wrong; empty where nothing speaks against it."""
    cause = diagnosis.main.cause
    if cause == Cause.SCORE:
        return "" if facts.score >= facts.score_at_gt else f"a correct pose scores {facts.score_at_gt:.3f}"
    if cause == Cause.SYMMETRIC:
        return "" if facts.surface_error < 0.1 else "the surface is elsewhere"
    if cause == Cause.AMBIGUOUS:
        return "" if abs(facts.sigmas) <= CANNOT_TELL else f"a correct pose scores {facts.sigmas:+.1f} σ more"
    if facts.score >= facts.score_at_gt:
        return f"no correct pose scores as much: {facts.score_at_gt:.3f}"
    if cause == Cause.DISCARDED:
        if not facts.n_correct_seen and facts.best_leading_score > facts.score:
            return f"refined on, a hypothesis scores {facts.best_leading_score:.3f}"
        return "" if facts.n_correct_seen or facts.n_leading else "no correct pose was reached"
    if facts.n_correct_seen and not diagnosis.main.rests_on:
        return f"a correct pose was reached, with {facts.best_correct_score:.3f}"
    if cause == Cause.UNDECIDED:
        return "" if 0 < facts.n_by_chance < len(SAMPLES) else f"right in {facts.n_by_chance} of {len(SAMPLES)} re-runs"
    if facts.n_by_chance > RARELY:
        return f"right by chance in {facts.n_by_chance} of {len(SAMPLES)} re-runs"
    if facts.n_repaired is not None and facts.n_repaired < MOSTLY:
        return f"repaired in only {facts.n_repaired} of {len(SAMPLES)} re-runs"
    if cause == Cause.POOL and facts.n_leading:
        return f"{facts.n_leading} hypotheses lead there"
    return ""


def main() -> int:
    """Prints each verdict with what the oracle has to say, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--frames", nargs="*", default=[])
    parser.add_argument("--method", default="rir")
    parser.add_argument("--rotation", type=float, default=40.0)
    parser.add_argument("--translation", type=float, default=20.0)
    args = parser.parse_args()
    named: Counter[str] = Counter()
    confirmed: Counter[str] = Counter()
    n_objects = 0
    ms: list[float] = []
    for seed in range(args.first, args.first + args.seeds):
        hypotheses = {"source": "perturb", "rotation_deg": args.rotation, "translation_mm": args.translation}
        toolbox = Toolbox(
            resolve(
                {
                    "scene": {"source": "bop", "dataset": str(args.dataset.resolve()), "frames": args.frames},
                    "hypotheses": {**hypotheses, "max_per_object": 5, "seed": seed},
                    "method": {"name": args.method, "refiner": "icp", "seed": seed},
                }
            )
        )
        for frame in toolbox.frames:
            run = toolbox.run(toolbox.problem(frame))
            run.finish()
            n_objects += len(run.problem.targets)
            for case in failed_cases(run, toolbox):
                began = perf_counter()
                verdict = diagnosed(case)
                ms.append(1e3 * (perf_counter() - began))
                facts = facts_of(case, verdict)
                why_not = objection(verdict, facts)
                named[verdict.main.cause] += 1
                confirmed[verdict.main.cause] += not why_not
                mark = f"WRONG ({why_not})" if why_not else "confirmed"
                print(f"seed {seed} {frame} {case.name} {verdict.main.cause} {mark}: {verdict.main.text}", flush=True)
                print(f"    {facts}", flush=True)
                for one in verdict.findings:
                    if "reruns" in one.numbers:
                        print(f"    {one.cause}, confirmed: {one.is_confirmed}; {dict(one.numbers)}", flush=True)
    for cause, n in named.most_common():
        print(f"{cause}: {confirmed[cause]} of {n} confirmed")
    share = confirmed.total() / max(named.total(), 1)
    print(f"{confirmed.total()} of {named.total()} verdicts confirmed ({share:.0%}) on {n_objects} objects")
    print(f"a diagnosis took {np.median(ms or [0]):.0f} ms in the median, {max(ms, default=0):.0f} ms at most")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
