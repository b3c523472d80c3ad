"""Checks of ``doctor``: one function per row of its table."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs

from verefine_viz.batch.machine import machine
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.settings import PhysicsSettings, ScoreSettings
from verefine_viz.run.versions import package_versions

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
BOX_M = np.array([0.10, 0.08, 0.06])
BOX_DISTANCE_M = 0.5
FALL_MM = 13.28
"""Free fall over 12 sub-steps of 1/240 s: g·dt²·(1 + 2 + … + 12)."""

SCORES = np.array([1.0, 0.5 * (0.5 + 1) * (33 * 27) / (35 * 27)])
"""Scores of the box where it was observed, and half of τ behind: depth fits half, normals fit, and of the 35×27 px of
its face 33×27 are covered."""


@dataclass(frozen=True)
class Check:
    """One row: what was checked, with which result, and what to do about it."""

    name: str
    result: str
    ok: bool = True
    needed: bool = True
    """Whether the program needs it; if not, some part works less well without it."""
    advice: str = ""

    @property
    def cells(self) -> tuple[str, str, str]:
        """The row as it is printed."""
        mark = "ok" if self.ok else "fails" if self.needed else "missing"
        return self.name, mark, self.result + (f"\n→ {self.advice}" if self.advice and not self.ok else "")


def all_checks() -> list[Callable[[], Check]]:
    """The rows in the order in which they are shown."""
    installed = [python, packages, opengl, bullet, chromium, rerun_viewer, cache_folder, working_folder]
    return [*installed, renderer_self_check, score_self_check, simulator_self_check]


def run(check: Callable[[], Check]) -> Check:
    """The row of a check; a check that cannot even be made has failed."""
    try:
        return check()
    except Exception as error:
        name = check.__name__.replace("_", " ")
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Check(name, text, ok=False, advice="make app installs what is missing")


def python() -> Check:
    """The interpreter and the machine."""
    facts = machine()
    text = f"{facts['python']} on {facts['system']}, {facts['cores']} cores, {facts['cpu']}"
    return Check("Python", text, sys.version_info >= (3, 11), advice="Python 3.11 or newer is needed")


def packages() -> Check:
    """Versions of the packages that results depend on."""
    versions = package_versions()
    missing = [name for name, version in versions.items() if version == "missing"]
    text = ", ".join(f"{name} {version}" for name, version in versions.items())
    return Check("packages", text, not missing, advice=f"pip install {' '.join(missing)}" if missing else "")


def opengl() -> Check:
    """The OpenGL that scores poses, if any."""
    from verefine_viz.rendering.auto_renderer import times_on
    from verefine_viz.rendering.gl_context import gl_info, gl_problem

    info = gl_info()
    if info is None:
        # Not needed: the CPU rasteriser gives the same scores.
        return Check("OpenGL", "none; poses are scored by the CPU", ok=False, needed=False, advice=gl_problem() or "")
    choice = "software, so poses are scored by the CPU" if info.is_software else times_on(info).in_words
    return Check("OpenGL", f"{info.renderer}, {info.version} ({choice})", needed=False)


def bullet() -> Check:
    """Whether the simulator can create a world."""
    from verefine_viz.physics.simulator import BulletSimulator

    BulletSimulator(PhysicsSettings())
    return Check("Bullet", f"pybullet {package_versions()['pybullet']} opens a world")


def find_chromium() -> str | None:
    """The program of the browser; None where it is not installed."""
    return next(filter(None, map(shutil.which, CHROMIUM)), None)


def chromium() -> Check:
    """The browser of the browser tests."""
    program = find_chromium()
    if program is None:
        advice = "only the browser tests need it: apt-get install chromium"
        return Check("Chromium", "not found", ok=False, needed=False, advice=advice)
    return Check("Chromium", _first_line([program, "--version"]) or program, needed=False)


def rerun_viewer() -> Check:
    """The viewer of recordings, and the Vulkan it needs."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    program = shutil.which("rerun", path=path)
    if program is None:
        return Check("rerun viewer", "not found", ok=False, needed=False, advice='pip install "rerun-sdk"')
    drivers = [p for d in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d") for p in Path(d).glob("*.json")]
    version = (_first_line([program, "--version"]) or program).partition(" (")[0]
    if not drivers:
        advice = "the viewer needs Vulkan: apt-get install mesa-vulkan-drivers"
        return Check("rerun viewer", f"{version}, no Vulkan driver", ok=False, needed=False, advice=advice)
    return Check("rerun viewer", f"{version}, {len(drivers)} Vulkan drivers", needed=False)


def cache_folder() -> Check:
    """Where colliders and simplified meshes are cached."""
    folder = platformdirs.user_cache_path("verefine-viz")
    folder.mkdir(parents=True, exist_ok=True)
    return _writable("cache folder", folder)


def working_folder() -> Check:
    """Where sessions and runs are written."""
    return _writable("working folder", Path.cwd())


def renderer_self_check() -> Check:
    """A box in front of the camera: its face is at a depth that is known in closed form."""
    from verefine_viz.rendering.rendered_scene import render_scene

    started = time.perf_counter()
    placed = Placed(0, _box(), transform(np.eye(3), [0, 0, BOX_DISTANCE_M]))
    depth_m = render_scene([placed], _camera()).depth_m[60, 80]
    expected_m = BOX_DISTANCE_M - BOX_M[2] / 2
    text = f"box face at {1e3 * depth_m:.2f} mm, expected {1e3 * expected_m:.2f} mm{_took(started)}"
    return Check("renderer self-check", text, abs(depth_m - expected_m) < 1e-4, advice=_REPORT)


def score_self_check() -> Check:
    """Whether both renderers score the observed pose, and one half of τ behind it, as calculated by hand."""
    from verefine_viz.rendering.cpu_verifier import CpuVerifier
    from verefine_viz.rendering.gl_context import gl_info
    from verefine_viz.rendering.gl_verifier import GlVerifier

    started = time.perf_counter()
    target, settings = _seen_box(), ScoreSettings()
    depths_m = BOX_DISTANCE_M, BOX_DISTANCE_M + settings.tau_m / 2
    poses = np.array([transform(np.eye(3), [0, 0, z]) for z in depths_m])
    scores = {"CPU": CpuVerifier(settings).score(target, poses).score}
    if gl_info() is not None:  # Software too: renderer = "gl" asks for it.
        gl = GlVerifier(settings)
        scores["OpenGL"] = gl.score(target, poses).score
        gl.close()
    ok = all(np.abs(pair - SCORES).max() < 1e-3 for pair in scores.values())
    values = "; ".join(f"{name} {right:.4f} and {behind:.4f}" for name, (right, behind) in scores.items())
    expected = f"expected {SCORES[0]:.4f} and {SCORES[1]:.4f}"
    text = f"observed pose and one 10 mm behind: {values}; {expected}{_took(started)}"
    return Check("score self-check", text, ok, advice=_REPORT)


def simulator_self_check() -> Check:
    """Whether a box in the air falls as calculated for three steps."""
    from verefine_viz.physics.simulator import BulletSimulator

    started = time.perf_counter()
    high = transform(np.eye(3), [0, 0, 1.0])
    support = Support(np.eye(4), np.array([0.0, 0.0, 1.0]), "world", 1.0)
    path = BulletSimulator(PhysicsSettings()).settle(Placed(0, _box(), high), (), support, 3)
    fall_mm = 1e3 * float(high[2, 3] - path.T_cam_obj[2, 3])
    text = f"free fall of 3 steps {fall_mm:.2f} mm, expected {FALL_MM:.2f} mm{_took(started)}"
    return Check("simulator self-check", text, abs(fall_mm - FALL_MM) < 0.05, advice=_REPORT)


_REPORT = "this machine computes something else than expected: please report the table above"


def _box() -> ObjectModel:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * BOX_M / 2
    faces = np.array(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ]
    )  # fmt: skip
    normals = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    return ObjectModel(1, "box", corners, faces, corners, normals, float(np.linalg.norm(BOX_M)), np.eye(4)[None])


def _seen_box() -> Target:
    """The box's face, 35×27 px, as a camera without noise sees it at ``BOX_DISTANCE_M``."""
    camera = _camera()
    mask = np.zeros(camera.shape, bool)
    mask[60 - 13 : 60 + 14, 80 - 17 : 80 + 18] = True
    depth_m = np.where(mask, BOX_DISTANCE_M - BOX_M[2] / 2, 0.0)
    normals = mask[..., None] * np.array([0.0, 0.0, -1.0])
    observation = Observation(camera, depth_m, normals, None, mask, None)
    return Target(observation, Instance(0, 1, mask, camera.back_project(depth_m)[mask], ()), _box())


def _camera() -> Camera:
    return Camera(np.array([[160.0, 0, 80], [0, 160.0, 60], [0, 0, 1]]), 161, 121)


def _writable(name: str, folder: Path) -> Check:
    try:
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Check(name, f"{folder}: {error.strerror}", ok=False, advice=f"make {folder} writable")
    free_gb = shutil.disk_usage(folder).free / 1e9
    return Check(name, f"{folder} is writable, {free_gb:.0f} GB free")


def _first_line(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip().splitlines()[0] if done.stdout.strip() else ""


def _took(started: float) -> str:
    return f" ({time.perf_counter() - started:.1f} s)"
