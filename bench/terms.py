"""What colour, flips and the observed support add on real frames, or what the authors' code has, or plausibility as a
term of the score, and what it costs.

    python -m bench.terms DATASET_FOLDER [--rows terms] [--method rir] [--refiner icp] [--seeds 5] [--pool FILE.csv]

DATASET_FOLDER is a BOP data set; for colour its models have some. Ground truth is disturbed by 30° and 30 mm, and by
60° and 30 mm, five hypotheses an object, or they are those of results files; each frame is solved as recommended but
without colour and flips, with each change, and with all of them, with the same calls of the refiner. An answer is right
if its error is below 10 % of the diameter, over the same points in every row: ADD(-S) as the data set declares
symmetries, and ADD of the object as it looks, without any, which a turned label fails. Differences to another row are
in points, with 95 % intervals over frames and objects, each with all its seeds; each answer that changed sides is
listed.
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
from verefine_viz.evaluation.answer_recalls import answer_recalls
from verefine_viz.evaluation.bootstrap import CellSums, draws
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

DISTURBED_DEG = (30.0, 60.0)


@dataclass(frozen=True)
class Answer:
    """Answer for one object in one frame."""

    name: str
    frame: str
    seed: int
    add_s_mm: float
    add_mm: float
    ar: float
    """BOP's average recall of this answer alone."""
    is_right: bool
    looks_right: bool
    n_flipped: int
    """Iterations whose flip was accepted."""

    @property
    def auc(self) -> float:
        """What it adds to the area under the curve of right answers over the tolerance, 0 to 20 mm."""
        return max(1 - self.add_s_mm / 20, 0.0)


def answers(run: Run, problem: Problem, seed: int) -> list[Answer]:
    """Those of a finished run, measured on the models of ``problem``; objects without answer or ground truth are
    passed over.
    """
    out: list[Answer] = []
    for target, best in zip(problem.targets, run.finish().best, strict=True):
        T_gt, instance_id = target.instance.T_cam_obj_gt, target.instance.instance_id
        if best is None or T_gt is None:
            continue
        errors = pose_errors(target.model, best.T_cam_obj, T_gt)
        as_it_looks = pose_errors(replace(target.model, symmetries=np.eye(4)[None]), best.T_cam_obj, T_gt)
        n_flipped = sum(i.accepted == "flipped" for i in run.iterations if i.instance_id == instance_id)
        of = target.model.name, f"{problem.scene_id}/{problem.im_id}", seed
        right = errors.is_correct, as_it_looks.is_correct
        ar = answer_recalls(target, best.T_cam_obj, problem.observation).ar
        out.append(Answer(*of, errors.add_s_mm, as_it_looks.add_s_mm, ar, *right, n_flipped))
    return out


@dataclass(frozen=True)
class Row:
    """A row of the table: sections of a session, and the row that it is compared with."""

    extra: dict[str, dict[str, Any]]
    against: str = "plain"


def rows(weight: float) -> dict[str, dict[str, Row]]:
    """Those of each table, by the name of what they change; the first changes nothing."""
    colour, flips, observed = {"colour_weight": weight}, {"flips": True}, {"support": "observed"}
    box, even, split = {"inertia": "box"}, {"model_sampling": "even"}, {"clusters": "cuthill_mckee"}
    return {
        "terms": {
            "plain": Row({}),
            "colour": Row({"score": colour}),
            "colour and flips": Row({"score": colour, "hypotheses": flips}, "colour"),
            "observed support": Row({"physics": observed}),
            "all": Row({"score": colour, "hypotheses": flips, "physics": observed}),
        },
        "plausibility": {
            "plain": Row({}),
            "w = 0.1": Row({"score": {"plausibility_weight": 0.1}}),
            "w = 0.3": Row({"score": {"plausibility_weight": 0.3}}),
        },
        "authors": {
            "plain": Row({}),
            "inertia of the box": Row({"physics": box}),
            "even model clouds": Row({"scene": even}),
            "Cuthill-McKee": Row({"dependency": split}),
            "all": Row({"physics": box, "scene": even, "dependency": split}),
        },
    }


def main() -> None:
    """Measures, and prints a table for each pool of hypotheses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rows", choices=tuple(rows(0)), default="terms")
    parser.add_argument("--weight", type=float, default=0.1)
    parser.add_argument("--frames", nargs="*", default=[])
    parser.add_argument("--method", default="rir")
    parser.add_argument("--refiner", default="icp")
    parser.add_argument("--pool", type=Path, nargs="*", default=[], help="results files, instead of ground truth")
    given = parser.parse_args()
    pools: dict[str, dict[str, Any]] = {
        f"ground truth disturbed by {deg:g}° and 30 mm": {
            "source": "perturb", "rotation_deg": deg, "translation_mm": 30.0
        }
        for deg in DISTURBED_DEG
    }  # fmt: skip
    if given.pool:
        pools = {"results files": {"source": "results", "files": [str(path.resolve()) for path in given.pool]}}
    table = rows(given.weight)[given.rows]
    for title, pool in pools.items():
        by_row: dict[str, list[Answer]] = {}
        seconds: dict[str, float] = {}
        n_frames = n_problems = 0
        for seed in range(given.seeds):
            scene = {"source": "bop", "dataset": str(given.dataset.resolve()), "frames": given.frames, "seed": seed}
            method = {"name": given.method, "refiner": given.refiner}
            measured: list[Problem] = []
            for name, row in table.items():
                base = {"scene": scene, "score": {"colour_weight": 0.0}, "method": method}
                base["hypotheses"] = {**pool, "seed": seed, "flips": False}
                changed = {section: {**base.get(section, {}), **fields} for section, fields in row.extra.items()}
                box = Toolbox(resolve({**base, **changed}))
                problems = [box.problem(frame) for frame in box.frames]
                measured, n_problems = measured or problems, len(problems)
                box.run(problems[0]).finish()  # Compiled, and read what is cached.
                for problem, models in zip(problems, measured, strict=True):
                    began = process_time()
                    run = box.run(problem)
                    run.finish()
                    seconds[name] = seconds.get(name, 0.0) + process_time() - began
                    by_row.setdefault(name, []).extend(answers(run, models, seed))
            n_frames += n_problems
        show(f"{given.method}, {title}", by_row, seconds, n_frames, table)


def cells(of: list[Answer], field: str) -> CellSums:
    """A field's sums by frame and object."""
    frames, names = sorted({a.frame for a in of}), sorted({a.name for a in of})
    total, n = np.zeros((2, len(frames), len(names)))
    for a in of:
        at = frames.index(a.frame), names.index(a.name)
        total[at] += getattr(a, field)
        n[at] += 1
    return CellSums(total, n)


def share(now: list[Answer], before: list[Answer], field: str) -> str:
    """In percent; how far it is above ``before``, if that is not empty."""
    ours = cells(now, field)
    text = f"{100 * (ours.mean or 0):.1f}"
    gain = draws(*ours.n.shape).difference(ours, cells(before, field)) if before else None
    if gain is None or gain.low is None or gain.high is None:
        return text
    return f"{text} ({100 * gain.low:+.1f} to {100 * gain.high:+.1f})"


def show(
    title: str, by_row: dict[str, list[Answer]], seconds: dict[str, float], n_frames: int, rows: dict[str, Row]
) -> None:
    """One table, and each answer that is right in one row and wrong in the row that this is compared with."""
    table = Table(
        "", "n", "right %", "looks right %", "AUC 20 mm", "AR", "mean mm", "CPU ms/frame", "turned", title=title
    )
    changed: list[str] = []
    for name, now in by_row.items():
        mm = np.array([a.add_s_mm for a in now])
        before = by_row[rows[name].against] if name != rows[name].against else []
        shares = (share(now, before, field) for field in ("is_right", "looks_right", "auc", "ar"))
        cost, n_turned = 1e3 * seconds[name] / n_frames, sum(a.n_flipped > 0 for a in now)
        table.add_row(name, str(len(now)), *shares, f"{mm.mean():.1f}", f"{cost:.0f}", str(n_turned))
        for a, b in zip(before or now, now, strict=True):
            if a.looks_right != b.looks_right:
                verb = "mended" if b.looks_right else "broken"
                changed.append(f"{name}: {verb} {b.name} {b.frame} seed {b.seed}, {a.add_mm:.0f} → {b.add_mm:.0f} mm")
    console = Console(width=180)
    console.print(table)
    console.print("\n".join(changed), highlight=False)


if __name__ == "__main__":
    main()
