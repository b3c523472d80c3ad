"""Writes the golden traces anew: ``python -m tests.golden.regenerate``. Review the difference as you review code."""

from __future__ import annotations

import json
from pathlib import Path

from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox

FOLDER = Path(__file__).parent


def trace(name: str) -> list[dict[str, object]]:
    """What a method does on the built-in duck, in numbers that can be read."""
    raw = {"scene": {"demo": "duck"}, "hypotheses": {"max_per_object": 3}, "method": {"name": name, "iterations": 2}}
    toolbox = Toolbox(resolve({**raw, "score": {"renderer": "cpu"}}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    return [
        {
            "arm": it.arm,
            "accepted": it.accepted,
            "scores": {s.name: s.score.score for s in it.stages if s.score},
            "T_cam_obj": it.accepted_stage.T_cam_obj.round(9).tolist(),
        }
        for it in run.iterations
    ]


def main() -> None:
    """Writes one file per method."""
    for name in METHOD_NAMES:
        (FOLDER / f"duck_{name}.json").write_text(json.dumps(trace(name), indent=1) + "\n")


if __name__ == "__main__":
    main()
