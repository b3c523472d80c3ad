"""What modules need at import stays small, and what only holds, reads or shows data loads no heavy package."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scripts.closure import ImportGraph

BUDGETS = {
    "methods.bandit": 2_000,
    "refiners.icp": 3_000,
    "rendering.cpu_verifier": 5_200,
    "evaluation.pose_landscape": 1_000,
    "run.record": 3_000,
    "run.answers": 3_500,
    "run.run_file": 5_200,
    "run.engine": 6_200,
    "run.session_parts": 6_000,
    "diagnosis.signs": 6_000,
    "page.protocol": 1_150,
    "page.messages": 5_050,
    "page.views": 10_000,
    "report": 15_300,
}
"""Lines of this package that a module, or each module of a package, may need at import: ``python scripts/closure.py``
prints them, and which import brings how many."""
DATA = ("run.record", "run.run_file", "run.answers", "page.protocol", "page.messages", "page.views")
"""What holds, reads or shows data."""
HEAVY = ("numba", "pybullet", "open3d", "trimesh", "onnxruntime")


@pytest.fixture(scope="module")
def graph() -> ImportGraph:
    return ImportGraph.of_package()


def test_modules_need_few_lines_of_others(graph: ImportGraph) -> None:
    sizes = {module: (graph.size(module), most) for name, most in BUDGETS.items() for module in graph.modules_of(name)}
    above = [f"{module}: {n} lines, expected at most {most}" for module, (n, most) in sizes.items() if n > most]
    assert not above, f"{above}; `python scripts/closure.py MODULE` shows which import brings them"


@pytest.mark.usefixtures("processes")
def test_what_holds_reads_or_shows_data_loads_no_heavy_package(graph: ImportGraph) -> None:
    names = [f"verefine_viz.{module}" for name in DATA for module in graph.modules_of(name)]
    report = f"""
import importlib, sys
for name in {names}:
    importlib.import_module(name)
    loaded = [package for package in {HEAVY} if package in sys.modules]
    assert not loaded, f"{{name}} loads {{loaded}}"
"""
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr.splitlines()[-1:]


def test_imports_count_where_they_are_made_at_once(tmp_path: Path) -> None:
    sources = {
        "__init__.py": "",
        "core/__init__.py": "",
        "core/data.py": "\n" * 10,
        "core/loop.py": "from verefine_viz.run import engine\n" + "\n" * 99,
        "run/__init__.py": "\n" * 5,
        "run/engine.py": "import numpy\nfrom verefine_viz.core import data, loop\n",
        "run/later.py": "def f():\n    from verefine_viz.core import loop\n",
        "run/typed.py": "if TYPE_CHECKING:\n    import verefine_viz.core.loop\nimport verefine_viz.core.data\n",
        "run/tried.py": "try:\n    import verefine_viz.core.data\nexcept ImportError:\n    pass\n",
    }
    for name, source in sources.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(source)
    graph = ImportGraph.of_package(tmp_path)
    packages = {"", "run", "core"}
    assert graph.closure("run.engine") == {"run.engine", "core.data", "core.loop", *packages}
    assert graph.closure("run.engine", without="core.loop") == {"run.engine", "core.data", *packages}
    assert graph.closure("run.later") == {"run.later", "", "run"}, "imports within functions are made when they run"
    assert graph.closure("run.typed") == {"run.typed", "core.data", *packages}
    assert graph.closure("run.tried") == {"run.tried", "core.data", *packages}
    assert graph.size("run.tried") == 4 + 10 + 5
    assert graph.modules_of("run") == ["run", "run.engine", "run.later", "run.tried", "run.typed"]
    assert graph.modules_of("core.data") == ["core.data"]
