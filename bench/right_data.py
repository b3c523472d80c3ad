"""How often right data are doubted, and meshes are accused in close views with a poor initial pose.

    python -m bench.right_data [--data ../shared/data] [--frames 15] [--held-out 12] [--say]

prints, for each variant of right frames, how many are doubted with ground truth and without, in whose place come poses
of an estimator that is 5° and 5 mm off; then, of close views, how many accuse the mesh, or anything. Aims: at most 2 %
doubts, no accused mesh. Both are printed again for frames that no threshold was set on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bench.data_faults import held_out
from tests.calibration.right_variants import POOR, RIGHT, close_views, estimated, has_truth, off
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.doubt import DoubtKind
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.scenes.source import open_scene

MADE = ("clutter", "stack", "mug", "duck", "bracket")


def frames(data: Path, n: int) -> list[Problem]:
    """Real frames, and built-in ones."""
    found: list[Problem] = []
    for folder in ("ycbv", "lm"):
        if (data / folder).is_dir():
            scene = SceneSettings(source="bop", dataset=str((data / folder).resolve()))
            source = open_scene(scene, HypothesesSettings())
            found += map(source.problem, source.frames)
    made = [demo_problem(name, SceneSettings(), HypothesesSettings(), "0/0") for name in MADE]
    return ([*found, *made] if found else made)[:n]


def print_doubts(of: list[Problem], say: bool) -> None:
    """Prints a row per variant of these frames, and per kind of poor poses in close views of their objects."""

    def doubts(p: Problem, name: str) -> bool:
        found = data_doubts(p) if p.instances else ()
        for doubt in found if say else ():
            print(f"  {name}: {doubt.text[:200]}", flush=True)
        return bool(found)

    n_doubts = n_blind_doubts = n = 0
    print("| right data | doubted with ground truth | without |\n|---|---|---|")
    for name, variant in RIGHT.items():
        rng = np.random.default_rng(0)
        made = [variant(p, rng) for p in of]
        with_truth = sum(doubts(p, name) for p in made if has_truth(p))
        blind = [estimated(p, off(rng, 5, 5)) if has_truth(p) else p for p in made]
        without = sum(doubts(p, f"{name}, no truth") for p in blind)
        n, n_doubts, n_blind_doubts = n + len(of), n_doubts + with_truth, n_blind_doubts + without
        print(f"| {name} | {with_truth}/{len(of)} | {without}/{len(of)} |", flush=True)
    print(f"| all | {n_doubts}/{n} = {n_doubts / n:.1%} | {n_blind_doubts}/{n} = {n_blind_doubts / n:.1%} |")
    print("\n| close views, initial pose off by | accuse the mesh | any doubt |\n|---|---|---|")
    views = [*close_views(of)]
    for name, poor in POOR.items():
        rng = np.random.default_rng(1)
        found = [data_doubts(estimated(p, poor(rng))) for _, p in views]
        for text in {d.text for of_one in found for d in of_one} if say else ():
            print(f"  {name}: {text[:200]}", flush=True)
        meshes = sum(any(d.kind == DoubtKind.MODEL_SCALE for d in of_one) for of_one in found)
        print(f"| {name} | {meshes}/{len(views)} | {sum(map(bool, found))}/{len(views)} |", flush=True)


def main() -> int:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--frames", type=int, default=15)
    parser.add_argument("--held-out", type=int, default=12, help="frames")
    parser.add_argument("--say", action="store_true", help="print each doubt")
    arguments = parser.parse_args()
    print_doubts(frames(arguments.data, arguments.frames), arguments.say)
    print("\nFrames that no threshold was set on:\n")
    print_doubts([*map(held_out, range(arguments.held_out))], arguments.say)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
