"""Writes golden traces, of some methods or of all: ``python -m tests.golden.regenerate rir``. Review the difference."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

FOLDER = Path(__file__).parent
SCENES = {"vf_breadth": "stack", "vf_depth": "stack", "physim_mcts": "clutter"}
"""Of methods that need company; the others are traced on the duck. No tree is grown on the stack: there 60 steps of
simulation make 3e-5 of the last digit, which differs between processors."""


def trace_file(name: str) -> Path:
    """Where the trace of a method is kept."""
    return FOLDER / f"{SCENES.get(name, 'duck')}_{name}.json"


def trace(name: str) -> list[dict[str, object]]:
    """What a method does on a built-in scene, in numbers that can be read."""
    raw = {
        "scene": {"demo": SCENES.get(name, "duck")},
        "hypotheses": {"max_per_object": 3},
        "method": {"name": name, "refiner": "icp", "iterations": 2},
        "mcts": {"expansions": 3},
    }
    toolbox = Toolbox(resolve({**raw, "score": {"renderer": "cpu"}}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    return [
        {
            "instance": it.instance_id,
            "arm": it.arm,
            "accepted": it.accepted,
            "scores": {s.name: s.score.score for s in it.stages if s.score},
            "T_cam_obj": it.accepted_stage.T_cam_obj.round(9).tolist(),
        }
        for it in run.iterations
    ]


def main() -> None:
    """Writes one file per method."""
    for name in sys.argv[1:] or ALL_METHOD_NAMES:
        trace_file(name).write_text(json.dumps(trace(name), indent=1) + "\n")


if __name__ == "__main__":
    main()
