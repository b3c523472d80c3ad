"""What flips of promising poses mend and break on real frames, with colour in the score.

    python -m bench.flips DATASET_FOLDER [--seeds 5] [--weight 0.1] [--frames 0/1 50/1]

DATASET_FOLDER is a BOP data set whose models have colours. Ground truth is disturbed by 30° and 30 mm, and by 60° and
30 mm, five hypotheses an object; each frame is solved with depth and normals, with colour, and with colour and flips,
with the same calls of the refiner. An answer is right if its error is below 10 % of the diameter: ADD(-S) as the data
set declares symmetries, and ADD of the object as it looks, without any, which a turned label fails.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

RIGHT = 0.1
DISTURBED_DEG = (30.0, 60.0)


@dataclass(frozen=True)
class Answer:
    """Of one object in one frame."""

    name: str
    add_s_mm: float
    is_right: bool
    looks_right: bool
    n_flipped: int
    """Iterations whose flip was accepted."""


def answers(box: Toolbox, problem: Problem) -> list[Answer]:
    """Those of a run; objects without an answer or ground truth are passed over."""
    run = box.run(problem)
    out: list[Answer] = []
    for target, best in zip(problem.targets, run.finish().best, strict=True):
        T_gt, instance_id = target.instance.T_cam_obj_gt, target.instance.instance_id
        if best is None or T_gt is None:
            continue
        errors = pose_errors(target.model, best.T_cam_obj, T_gt)
        as_it_looks = pose_errors(replace(target.model, symmetries=np.eye(4)[None]), best.T_cam_obj, T_gt)
        n_flipped = sum(i.accepted == "flipped" for i in run.iterations if i.instance_id == instance_id)
        right = errors.relative < RIGHT, as_it_looks.relative < RIGHT
        out.append(Answer(target.model.name, errors.add_s_mm, *right, n_flipped))
    return out


def variants(weight: float) -> dict[str, dict[str, Any]]:
    """Sections of a session by the name of what they add."""
    colour = {"colour_weight": weight}
    return {
        "depth and normals": {"score": {}, "hypotheses": {}},
        "colour": {"score": colour, "hypotheses": {}},
        "colour and flips": {"score": colour, "hypotheses": {"flips": True}},
    }


def main() -> None:
    """Measures, and prints a table for each disturbance."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--weight", type=float, default=0.1)
    parser.add_argument("--frames", nargs="*", default=[])
    parser.add_argument("--method", default="rir")
    given = parser.parse_args()
    for deg in DISTURBED_DEG:
        by_variant: dict[str, list[Answer]] = {}
        seconds: dict[str, float] = {}
        n_frames = 0
        for seed in range(given.seeds):
            scene = {"source": "bop", "dataset": str(given.dataset.resolve()), "frames": given.frames}
            pool = {"source": "perturb", "rotation_deg": deg, "translation_mm": 30.0, "seed": seed}
            for name, extra in variants(given.weight).items():
                raw = {"scene": scene, "method": {"name": given.method}, "score": extra["score"]}
                box = Toolbox(resolve({**raw, "hypotheses": {**pool, **extra["hypotheses"]}}))
                problems = [box.problem(frame) for frame in box.frames]
                answers(box, problems[0])  # Compiled, and read what is cached.
                began = process_time()
                by_variant.setdefault(name, []).extend(a for p in problems for a in answers(box, p))
                seconds[name] = seconds.get(name, 0.0) + process_time() - began
            n_frames += len(problems)
        show(f"{given.method}, ground truth disturbed by {deg:g}° and 30 mm", by_variant, seconds, n_frames)


def show(title: str, by_variant: dict[str, list[Answer]], seconds: dict[str, float], n_frames: int) -> None:
    """One table, and the objects whose answer flips mended or broke."""
    table = Table(title=title)
    for heading in ("", "n", "right %", "looks right %", "AUC 20 mm", "mean mm", "CPU ms/frame", "mended", "broken"):
        table.add_column(heading, justify="left" if not heading else "right")
    before: list[Answer] | None = None
    changed: list[str] = []
    for name, now in by_variant.items():
        mm = np.array([a.add_s_mm for a in now])
        mended = [b.name for a, b in zip(before or now, now, strict=True) if b.looks_right and not a.looks_right]
        broken = [b.name for a, b in zip(before or now, now, strict=True) if a.looks_right and not b.looks_right]
        shares = (100 * np.mean([getattr(a, f) for a in now]) for f in ("is_right", "looks_right"))
        auc = 100 * np.mean(np.maximum(1 - mm / 20, 0))
        cells = (*(f"{s:.1f}" for s in shares), f"{auc:.1f}", f"{mm.mean():.1f}")
        cost = f"{1e3 * seconds[name] / n_frames:.0f}"
        table.add_row(name, str(len(now)), *cells, cost, str(len(mended)), str(len(broken)))
        changed.append(f"{name}: mended {', '.join(mended) or '–'}; broken {', '.join(broken) or '–'}")
        before = now
    console = Console(width=120)
    console.print(table)
    console.print("\n".join(changed[1:]), highlight=False)


if __name__ == "__main__":
    main()
