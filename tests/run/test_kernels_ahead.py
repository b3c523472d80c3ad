"""What is compiled ahead is what a run then calls: kernels for other types would be compiled for nothing."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import sys
from numba.core.dispatcher import Dispatcher
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.run.kernels_ahead import PARTS
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

def compiled():
    modules = [m for name, m in sys.modules.copy().items() if name.startswith("verefine_viz.")]
    kernels = {d for m in modules for d in vars(m).values() if isinstance(d, Dispatcher)}
    return {f"{d.py_func.__module__}.{d.py_func.__name__}": len(d.signatures) for d in kernels if d.signatures}

session = resolve({"preset": "recommended", "scene": {"source": "demo", "demo": "mug"}})
for part in PARTS.values():
    part(session)
ahead = compiled()
tools = Toolbox(session)
run = tools.run(tools.problem(tools.frames[0]))
run.finish()
allowed_poses(tools.verifier, run.problem.targets[0], run.final_state.best[0].T_cam_obj)
print(sorted(name for name, n in compiled().items() if n > ahead.get(name, n)))
print(*sorted(ahead))
"""


def test_a_run_calls_what_was_compiled_ahead_with_the_same_types(processes: None) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    again, ahead = done.stdout.splitlines()
    assert again == "[]"
    assert "verefine_viz.refiners.icp_kernel.refined_pose" in ahead
    assert "verefine_viz.rendering.score_kernels.score_every" in ahead
