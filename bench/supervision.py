"""When does supervision (SIR) gain over physics between the refiner's calls (PIR), and by what?

``python -m bench.supervision [CONDITION …] [--seeds 3]``. For each condition: AR of both, the paired difference with
its 95 % interval, the share of SIR's iterations in which it kept the simulated pose instead of the refined one, and the
share of answers that are the same to the bit. Built-in scenes, preset published.

Two other methods, of which the second one's iterations are counted, are compared by ``--methods physim_mcts vf_breadth
--refiner trimmed_icp --hypotheses 5``, with the paper's simulation steps for the refiner.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from tests.made_up_frames import leaning, seen_through
from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.answer_recalls import answer_recalls
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES, method_of
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.studies.budgets import budget_of
from verefine_viz.studies.disturbance import disturbed, without_top
from verefine_viz.studies.grasp_table import band

SCENES = ("mug", "duck", "bracket", "clutter")


@dataclass(frozen=True)
class Condition:
    """What is otherwise than in the ablation."""

    name: str
    rotation_deg: float = 20.0
    translation_mm: float = 0.0
    iterations: int = 5
    spoil: Callable[[Problem], Problem] = lambda problem: problem
    scenes: Sequence[str] = SCENES
    sim_candidate: str = "full"
    """What SIR may keep of a simulated pose: all of it, or its rotation only."""


def tilted(problem: Problem) -> Problem:
    """The problem with a support plane that leans by 20°."""
    support = problem.observation.support
    assert support is not None
    wrong = leaning(support, np.array([1.0, 0, 0]), 20.0)
    return replace(problem, observation=replace(problem.observation, support=wrong))


def leaking(problem: Problem) -> Problem:
    """The problem with masks that take in 12 px of what lies around the objects, which draws the refiner away."""
    instances = (
        seen_through(
            np.asarray(binary_dilation(i.mask, iterations=12), bool), i, problem.observation, len(i.points_cam)
        )
        for i in problem.instances
    )
    return replace(problem, instances=tuple(instances))


CONDITIONS = (
    Condition("rotation 20°"),
    Condition("rotation 30°", rotation_deg=30.0),
    Condition("rotation 20°, 2 iterations", iterations=2),
    Condition("rotation 20°, 10 iterations", iterations=10),
    Condition("rotation 45°", rotation_deg=45.0),
    Condition("translation 20 mm", rotation_deg=0.0, translation_mm=20.0),
    Condition("translation 20 mm, rotation only", rotation_deg=0.0, translation_mm=20.0, sim_candidate="rotation_only"),
    Condition("translation 30 mm", rotation_deg=0.0, translation_mm=30.0),
    Condition("translation 30 mm, rotation only", rotation_deg=0.0, translation_mm=30.0, sim_candidate="rotation_only"),
    Condition("rotation 20°, objects on others", scenes=("stack", "bowl")),
    Condition("rotation 20°, plane tilted by 20°", spoil=tilted),
    Condition("rotation 20°, masks 12 px too wide", spoil=leaking),
    Condition("rotation 20°, upper 70 % of depth missing", spoil=lambda problem: without_top(problem, 0.7)),
)


def measured(
    condition: Condition, n_seeds: int, names: Sequence[str], refiner: str, n_hypotheses: int
) -> dict[str, object]:
    """One row of the table, of two methods by name."""
    answers: list[tuple[float, float]] = []
    n_simulated, n_iterations, n_same = 0, 0, 0
    for scene in condition.scenes:
        toolbox = Toolbox(load_session(None, {"preset": "published", "scene": {"demo": scene}}))
        whole = toolbox.problem(toolbox.frames[0])
        settings = {"iterations": condition.iterations, "sim_candidate": condition.sim_candidate, "refiner": refiner}
        physics = {"steps": budget_of(refiner).steps}
        tools = [toolbox.changed({"method": {"name": name, **settings}, "physics": physics}) for name in names]
        for seed in range(n_seeds):
            first = disturbed(whole, n_hypotheses, condition.rotation_deg, condition.translation_mm, seed)
            problem = condition.spoil(first)
            found = [one.run(problem) for one in tools]
            ends = [run.finish().best for run in found]
            for target, a, b in zip(problem.targets, *ends, strict=True):
                assert a is not None
                assert b is not None
                first_ar, second_ar = (
                    answer_recalls(target, T, whole.observation).ar for T in (a.T_cam_obj, b.T_cam_obj)
                )
                answers.append((first_ar, second_ar))
                n_same += bool(np.array_equal(a.T_cam_obj, b.T_cam_obj))
            n_simulated += sum(i.accepted == "simulated" for i in found[1].iterations)
            n_iterations += found[1].length
    ar = 100 * np.array(answers)
    low, high = band(ar[:, 1] - ar[:, 0])
    return {
        "condition": condition.name,
        "objects": len(ar),
        method_of(names[0]).label: f"{ar[:, 0].mean():.1f}",
        method_of(names[1]).label: f"{ar[:, 1].mean():.1f}",
        "gain": f"{(ar[:, 1] - ar[:, 0]).mean():+.1f} ({low:+.1f} to {high:+.1f})",
        "simulated kept": f"{n_simulated / n_iterations:.0%}",
        "same answer": f"{n_same / len(ar):.0%}",
    }


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("conditions", nargs="*", help="words that the names of the wanted ones begin with")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--methods", nargs=2, default=("pir", "sir"), choices=ALL_METHOD_NAMES)
    parser.add_argument("--refiner", default="icp")
    parser.add_argument("--hypotheses", type=int, default=1)
    args = parser.parse_args()
    wanted = [c for c in CONDITIONS if not args.conditions or c.name.startswith(tuple(args.conditions))]
    if not wanted:
        parser.error(f"no condition begins so; there are: {'; '.join(c.name for c in CONDITIONS)}")
    for condition in wanted:
        print(measured(condition, args.seeds, args.methods, args.refiner, args.hypotheses), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
