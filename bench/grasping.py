"""Whether the simulated gripper can be believed: free grasps at ground truth, without the object, and other settings.

    python -m bench.grasping sessions/graspa.toml

takes the session's first frame, as it is and with its objects turned. A row per object: of all grasps that are free at
the ground-truth pose, how many lift it, and how many lift anything with the object taken away. Then a row per change of
a setting, over all objects: how often the chosen grasp lifts its object at the ground-truth pose, and at poses 10 mm
off.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from msgspec import structs
from rich.console import Console

from bench.__main__ import table
from verefine_viz.core.algorithm_settings import GraspSettings
from verefine_viz.core.problem import Problem
from verefine_viz.grasping.grasp_answer import GraspScene
from verefine_viz.grasping.grasp_check import are_free
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.studies.disturbance import disturbed
from verefine_viz.studies.study_command import scenes

OFF_MM, SEEDS = 10.0, 5
"""Error of the poses that are off, and how many there are per object and frame."""
CHANGES: tuple[tuple[str, float], ...] = (
    ("friction", 0.25),
    ("friction", 1.0),
    ("mass_kg", 0.25),
    ("mass_kg", 1.0),
    ("mass_kg", 2.0),
    ("force_n", 20.0),
    ("force_n", 80.0),
)
"""One at a time; the defaults besides."""


def frames(path: Path) -> list[Problem]:
    """The first frame as it is, and turned where that can be."""
    boxes = [Toolbox(one) for one in scenes("grasping", path, {}, quick=False).values()]
    return [box.problem(box.frames[0]) for box in boxes]


def free_grasps(problems: Sequence[Problem], settings: GraspSettings) -> list[dict[str, object]]:
    """A row per object."""
    rows: dict[str, dict[str, int]] = {}
    for problem in problems:
        scene = GraspScene(problem, settings)
        for target in problem.targets:
            T_gt = target.instance.T_cam_obj_gt
            assert T_gt is not None
            Ts = T_gt @ scene.grasps(target.instance.instance_id).T_obj_gripper
            free = Ts[are_free(Ts, scene.around, settings)]
            ends = Counter(scene.carry_out(target.instance.instance_id, T).verdict for T in free)
            gone = [scene.carry_out(target.instance.instance_id, T, without_target=True).verdict for T in free]
            row = rows.setdefault(target.model.name, {})
            counts = {"grasps": len(Ts), "free": len(free), "success": ends["success"]}
            counts |= {end: n for end, n in ends.items() if end != "success"}
            counts["success without the object"] = gone.count("success")
            for key, n in counts.items():
                row[key] = row.get(key, 0) + n
    columns = dict.fromkeys(key for row in rows.values() for key in row)
    return [{"object": name, **{key: row.get(key, 0) for key in columns}} for name, row in rows.items()]


def sensitivity(problems: Sequence[Problem], settings: GraspSettings) -> list[dict[str, object]]:
    """A row per change."""
    rows: list[dict[str, object]] = []
    for field, value in (("defaults", 0.0), *CHANGES):
        changed = settings if field == "defaults" else structs.replace(settings, **{field: value})
        at_gt: list[bool] = []
        off: list[bool] = []
        for problem in problems:
            scene = GraspScene(problem, changed)
            for instance in problem.instances:
                assert instance.T_cam_obj_gt is not None
                verdict = scene.attempt(instance.instance_id, instance.T_cam_obj_gt).verdict
                at_gt.append(verdict == "success")
            for seed in range(SEEDS):
                for instance in disturbed(problem, 1, 0.0, OFF_MM, seed).instances:
                    pose = instance.hypotheses[0].T_cam_obj
                    off.append(scene.attempt(instance.instance_id, pose).verdict == "success")
        label = field if field == "defaults" else f"{field} = {value:g}"
        rows.append(
            {
                "setting": label,
                "success at ground truth": f"{sum(at_gt)} of {len(at_gt)}",
                f"success {OFF_MM:g} mm off": f"{sum(off)} of {len(off)} ({100 * np.mean(off):.0f} %)",
            }
        )
    return rows


def main() -> None:
    """Prints both tables of each session."""
    parser = argparse.ArgumentParser(prog="python -m bench.grasping")
    parser.add_argument("sessions", nargs="+", type=Path)
    console = Console()
    for path in parser.parse_args().sessions:
        settings, problems = load_session(path).grasp, frames(path)
        for what, measured in (("free grasps at ground truth", free_grasps), ("other settings", sensitivity)):
            began = perf_counter()
            rows = measured(problems, settings)
            console.print(table(f"{path.stem}: {what}", rows, perf_counter() - began))


if __name__ == "__main__":
    main()
