"""Whole methods with the learned depth refiner on real frames, against ICP, with the same calls of the refiner.

    python -m bench.learned_methods DATASET_FOLDER… --out RESULTS.jsonl [--seeds 10]
    python -m bench.learned_methods --out RESULTS.jsonl --table

Every instance starts from its ground truth, disturbed by a turn and a shift, five hypotheses an object; those of the
key frames with ``pose_estimates/*.csv`` also from estimators' poses. A cell (data set, start, seed, method, refiner) is
a line of the results; those that are there are not measured again, so that the command can be stopped and started. The
table has everything that was measured for all refiners. Times are of the processor.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from time import process_time, thread_time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.protocols import Refiner
from verefine_viz.evaluation.answer_recalls import answer_recalls
from verefine_viz.evaluation.bootstrap import CellSums, draws
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

STARTS = ((10, 10), (20, 20), (30, 30), (45, 40), (60, 40))
"""Turn [deg] and shift [mm], as in bench/learned.py."""
POOLS = {
    "3 estimators": ("cosypose", "posecnn-rss2018", "sundermeyer"),
    "4 estimators": ("cosypose", "posecnn-icp-rss2018", "posecnn-rss2018", "sundermeyer"),
}
KEY_FRAMES = ("49/2365", "50/1")
"""That the estimators' poses are of."""
METHODS = ("refine", "sir", "rir", "vf_depth")
REFINERS = ("icp", "depth_net", "depth_net_icp")
AUC_MM = 20.0


class Timed:
    """A refiner that counts its calls and their time of the processor."""

    def __init__(self, inner: Refiner) -> None:
        self._inner = inner
        self.n_calls, self.seconds = 0, 0.0

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The inner refiner's result."""
        began = thread_time()
        T = self._inner.refine(target, T_cam_obj, fixed)
        self.seconds += thread_time() - began
        self.n_calls += 1
        return T


@dataclass(frozen=True)
class Answer:
    """Answer for one object in one frame."""

    frame: str
    name: str
    add_s_mm: float
    relative: float
    ar: float
    """BOP's average recall of this answer alone."""


@dataclass(frozen=True)
class Cell:
    """All frames of a data set from one start with one seed, by one method with one refiner."""

    dataset: str
    start: str
    seed: int
    method: str
    refiner: str
    n_frames: int
    ms_per_frame: float
    ms_per_call: float
    answers: tuple[Answer, ...]

    @property
    def key(self) -> tuple[str, str, int, str, str]:
        return self.dataset, self.start, self.seed, self.method, self.refiner


def read(path: Path) -> list[Cell]:
    """The cells measured so far; a line that was cut off is measured again."""
    cells: list[Cell] = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            raw = json.loads(line)
        except ValueError:
            continue
        cells.append(Cell(**{**raw, "answers": tuple(Answer(**answer) for answer in raw["answers"])}))
    return cells


def starts_of(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Sections of a session by the name of a start."""
    disturbed = {
        f"{deg}°, {mm} mm": {"hypotheses": {"source": "perturb", "rotation_deg": deg, "translation_mm": mm}}
        for deg, mm in STARTS
    }
    estimates = folder / "pose_estimates"
    files = {name: [str(estimates / f"{e}_{folder.name}-test.csv") for e in pool] for name, pool in POOLS.items()}
    estimated = {
        name: {"hypotheses": {"source": "results", "files": paths}, "scene": {"frames": KEY_FRAMES}}
        for name, paths in files.items()
        if estimates.is_dir()
    }
    return disturbed | estimated


def measure(folder: Path, seeds: Iterable[int], out: Path) -> None:
    """Appends to ``out`` the cells of a data set that it lacks."""
    done = {cell.key for cell in read(out)}
    for seed in seeds:
        for start, sections in starts_of(folder).items():
            wanted = [(m, r) for m in METHODS for r in REFINERS if (folder.name, start, seed, m, r) not in done]
            if not wanted:
                continue
            scene = {"source": "bop", "dataset": str(folder), "seed": seed, **sections.get("scene", {})}
            toolbox = Toolbox(
                resolve(
                    {
                        "scene": scene,
                        "hypotheses": {**sections["hypotheses"], "seed": seed},
                        "method": {"refiner": REFINERS[0]},
                    }
                )
            )
            problems = [toolbox.problem(frame) for frame in toolbox.frames]
            for method, refiner in wanted:
                box = toolbox.changed({"method": {"name": method, "refiner": refiner}})
                cell = solved(box, problems, (folder.name, start, seed, method, refiner))
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(cell)) + "\n")


def solved(box: Toolbox, problems: list[Problem], key: tuple[str, str, int, str, str]) -> Cell:
    """All frames by the toolbox's method."""
    timed = Timed(box.refiner)
    box = box.refined_by(timed)
    for target in (target for problem in problems for target in problem.targets):
        # What is made once per model, and compiled, is not timed.
        box.refiner.refine(target, target.instance.hypotheses[0].T_cam_obj)
    timed.n_calls, timed.seconds, seconds = 0, 0.0, 0.0
    answers: list[Answer] = []
    for problem in problems:
        began = process_time()
        final = box.run(problem).finish()
        seconds += process_time() - began
        for target, best in zip(problem.targets, final.best, strict=True):
            if best is not None and target.instance.T_cam_obj_gt is not None:
                errors = pose_errors(target.model, best.T_cam_obj, target.instance.T_cam_obj_gt)
                ar = answer_recalls(target, best.T_cam_obj, problem.observation).ar
                answers.append(Answer(problem.frame, target.model.name, errors.add_s_mm, errors.relative, ar))
    n = len(problems)
    return Cell(*key, n, 1e3 * seconds / n, 1e3 * timed.seconds / max(timed.n_calls, 1), tuple(answers))


def complete(cells: list[Cell]) -> list[Cell]:
    """Those of the starts and seeds that every method with every refiner has, so that all are compared on the same."""
    of_start = Counter((cell.dataset, cell.start, cell.seed) for cell in cells)
    n = len(METHODS) * len(REFINERS)
    return [cell for cell in cells if of_start[cell.dataset, cell.start, cell.seed] == n]


def sums(cells: list[Cell], value: str) -> CellSums:
    """A value's sums by frame and object: ``right``, ``auc`` (both as 0 to 1), ``ar``."""
    of = {(f"{c.dataset} {a.frame}", a.name): [] for c in cells for a in c.answers}
    for c in cells:
        for a in c.answers:
            values = {"right": float(a.relative < CORRECT), "auc": max(1 - a.add_s_mm / AUC_MM, 0.0), "ar": a.ar}
            of[f"{c.dataset} {a.frame}", a.name].append(values[value])
    frames, names = sorted({f for f, _ in of}), sorted({name for _, name in of})
    total, n = np.zeros((2, len(frames), len(names)))
    for (frame, name), values in of.items():
        total[frames.index(frame), names.index(name)] = sum(values)
        n[frames.index(frame), names.index(name)] = len(values)
    return CellSums(total, n)


def shown(now: list[Cell], before: list[Cell], value: str) -> str:
    """In percent; the interval of how far it is above ``before``, if that is not empty."""
    ours = sums(now, value)
    text = f"{100 * (ours.mean or 0):.1f}"
    gain = draws(*ours.n.shape).difference(ours, sums(before, value)) if before else None
    if gain is None or gain.low is None or gain.high is None:
        return text
    return f"{text} ({100 * gain.low:+.1f} to {100 * gain.high:+.1f})"


def show(cells: list[Cell]) -> None:
    """The table, and which objects the wrong answers of RIR from the furthest start are of."""
    titles = ("start", "method", "refiner", "n", "right %", "AUC", "AR", "mean mm", "ms/call", "ms/frame")
    table = Table(*titles, title="Whole methods on real frames; intervals of the difference to icp, 95 %")
    order = [f"{deg}°, {mm} mm" for deg, mm in STARTS] + list(POOLS)
    used = sorted(complete(cells), key=lambda c: (order.index(c.start), METHODS.index(c.method)))
    for (start, method), group in groupby(used, key=lambda c: (c.start, c.method)):
        of_all = list(group)
        icp = [c for c in of_all if c.refiner == REFINERS[0]]
        for refiner in REFINERS:
            now = [c for c in of_all if c.refiner == refiner]
            numbers = [shown(now, [] if refiner == REFINERS[0] else icp, value) for value in ("right", "auc", "ar")]
            mm = [a.add_s_mm for c in now for a in c.answers]
            n_frames = sum(c.n_frames for c in now)
            ms_frame = sum(c.ms_per_frame * c.n_frames for c in now) / n_frames
            ms_call = np.mean([c.ms_per_call for c in now])
            more = f"{np.mean(mm):.1f}", f"{ms_call:.2f}", f"{ms_frame:.0f}"
            table.add_row(start, method, refiner, str(len(mm)), *numbers, *more)
    console = Console(width=170, highlight=False)
    console.print(table)
    for refiner in REFINERS:
        furthest = [c for c in used if (c.start, c.method, c.refiner) == (order[len(STARTS) - 1], "rir", refiner)]
        wrong = Counter(a.name for c in furthest for a in c.answers if a.relative >= CORRECT)
        console.print(f"wrong in rir, {refiner}, {order[len(STARTS) - 1]}: {dict(wrong.most_common())}")
    seeds = sorted({c.seed for c in used})
    console.print(f"{len(used)} cells of {len(seeds)} seeds: {seeds}")


def main() -> None:
    """Measures, or prints what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", type=Path, nargs="*")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--table", action="store_true", help="print what was measured")
    given = parser.parse_args()
    for seed in range(given.seeds):  # Seed by seed, so that whatever there was time for can be compared.
        for folder in given.datasets:
            measure(folder.resolve(), [seed], given.out)
    if given.table or given.datasets:
        show(read(given.out))


if __name__ == "__main__":
    main()
