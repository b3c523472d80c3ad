"""The command ``verefine-viz study``: runs a study, writes CSV and figures, and prints which claims hold."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import structs

from verefine_viz.core.console import ProgressBar
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import say
from verefine_viz.core.writing import check_no_link, clear_parts
from verefine_viz.run.session_file import load_session
from verefine_viz.studies.grasp_table import report_grasps
from verefine_viz.studies.paper_tables import MOST_HYPOTHESES
from verefine_viz.studies.run_study import StudyOutcome, run_study, saved_outcome
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Study
from verefine_viz.studies.study_report import About, report_curves, report_tables, write_rows
from verefine_viz.studies.study_request import StudyRequest

SCENES = ("mug", "duck", "bracket", "bowl", "clutter")
"""Built-in scenes for studies without a given session."""
TABLE_SCENES = (*SCENES, "stack")
"""Scenes for tables; methods for whole scenes differ only where objects touch."""
QUICK_SCENES, QUICK_FRAMES = ("duck", "bowl", "stack"), ("0/0",)
"""Their six objects are just enough for verdicts."""
GRASP_SCENE = "clutter"
"""Scene of grasping: its objects stand close together, and the gripper can hold five of the six."""
CURVES = ("ablation", "robustness")
PRESET = "published"
"""Settings for built-in scenes. With the recommended ones every method finds nearly every pose in them: the wider gate
of the refiner leaves little difference between methods."""
SEEDS, QUICK_SEEDS = 5, 3
GRASP_SEEDS = 5, 1
"""Trials of each object as it lies, and as many turned: ten in the paper's Table IV."""
RENDERED = ("demo", "layout")
"""Sources of scenes whose objects can be turned."""
MOST_FAILURES = 5
"""Most failed runs that are printed; the others are counted."""
TURNED = "turned"
"""Suffix of the name of a scene whose objects are turned."""


def run_one(
    name: str,
    session: Path | None,
    out: Path,
    overrides: Mapping[str, Any],
    *,
    quick: bool = False,
    seeds: int | None = None,
    workers: int = 1,
) -> int:
    """Runs a study into ``out``. Stopped by Ctrl-C, it first writes the results so far.

    Returns:
        The exit code: 0, or 1 where a run failed.

    Raises:
        VerefineError: the session, a frame or ``out`` cannot be used.
    """
    sessions = scenes(name, session, overrides, quick)
    first = next(iter(sessions.values()))
    own_initial_poses = first.hypotheses.source != "perturb"
    request = StudyRequest(name, quick, own_initial_poses, first.method.refiner)
    _check_options(request.study(), overrides)
    of_study = GRASP_SEEDS if name == "grasping" else (SEEDS, QUICK_SEEDS)
    n_seeds = seeds if seeds is not None else of_study[quick]
    if request.own_initial_poses and name == "tables":
        n_seeds = 1  # Nothing is drawn.
    folder, n_done, n_all = out / f"{name}.journal", 0, 0
    check_no_link(folder)
    try:
        with ProgressBar(f"study {name}") as bar:

            def progress(done: int, total: int) -> None:
                nonlocal n_done, n_all
                n_done, n_all = done, total
                bar.show(f"study {name}", done, total)

            outcome = run_study(request, sessions, n_seeds, workers, folder, progress, bar.say)
    except KeyboardInterrupt:
        if n_done:
            part = f"stopped after {n_done} of {n_all} runs"
            say(f"study {name}: {part}; writing them, the same command goes on", sys.stderr)
            _write_results(request, sessions, n_seeds, saved_outcome(request, sessions, n_seeds, folder), out, part)
        raise
    n_failed = len(outcome.failures)
    _write_results(
        request, sessions, n_seeds, outcome, out, f"without {n_failed} of {n_all} runs, which failed" * bool(n_failed)
    )
    for failed in outcome.failures[:MOST_FAILURES]:
        say(f"{failed.unit.stem}: {failed.failure}", sys.stderr)
    if n_failed:
        say(f"study {name}: {n_failed} of {n_all} runs failed; the same command tries them again", sys.stderr)
    return 1 if n_failed else 0


def _write_results(
    request: StudyRequest,
    sessions: Mapping[str, Session],
    seeds: int,
    outcome: StudyOutcome,
    out: Path,
    part: str = "",
) -> None:
    """Writes and prints the outcome; ``part`` says which runs it is of, where it is not all of them."""
    name, answers = request.name, outcome.answers
    study = request.study().only({(o.panel, o.x) for o in answers})
    quick = "quick run" if request.quick else ""
    about = About(_about(sessions, answers, seeds), ", ".join(text for text in (quick, part) if text))
    clear_parts(out, name)
    _write_objects(answers, out / f"{name}_objects.csv")
    if name == "grasping":
        report_grasps(study, answers, out, about)
    elif name == "tables":
        report_tables(study, answers, sessions.values(), out, about)
    else:
        report_curves(study, answers, out, about)


def scenes(study: str, session: Path | None, overrides: Mapping[str, Any], quick: bool) -> dict[str, Session]:
    """The session's scene, or built-in ones that suit this study, by name; for grasping also with its objects
    turned.
    """
    if study == "tables":
        overrides = _with(overrides, "hypotheses", {"max_per_object": MOST_HYPOTHESES})
    scene = overrides.get("scene", {})
    if study in CURVES and session is None and scene.get("source", "demo") == "demo":
        # The paper's refiner, whose weights in the package know the built-in objects.
        overrides = _with(overrides, "method", {"refiner": "densefusion", **overrides.get("method", {})})
    if session is not None or scene:
        one = load_session(session, dict(overrides))
        name = session.stem if session is not None else (Path(one.scene.layout).stem or one.scene.demo or "scene")
        return _with_turned(name, one) if study == "grasping" else {name: one}
    if study == "grasping":
        scene = {"demo": GRASP_SCENE, "frames": ("0/0",)}
        return _with_turned(GRASP_SCENE, load_session(None, {"preset": PRESET, **overrides, "scene": scene}))
    names = QUICK_SCENES if quick else TABLE_SCENES if study == "tables" else SCENES
    frames = QUICK_FRAMES if quick else ()
    built_in = {name: {"preset": PRESET, **overrides, "scene": {"demo": name, "frames": frames}} for name in names}
    return {name: load_session(None, fields) for name, fields in built_in.items()}


def _with(overrides: Mapping[str, Any], section: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    return {**overrides, section: {**overrides.get(section, {}), **fields}}


def _check_options(study: Study, overrides: Mapping[str, Any]) -> None:
    """Raises SettingsError where an option is given that the study sets itself: it would be ignored."""
    given = [f"{section}.{name}" for section, of in overrides.items() if isinstance(of, Mapping) for name in of]
    for name in given:
        if {name, name.partition(".")[0]} & study.fixed:
            raise SettingsError(f"study {study.name} sets {name} itself (docs/methods.md 8); leave the option out")


def _with_turned(name: str, session: Session) -> dict[str, Session]:
    """The scene as it is and with its objects turned; objects of a photo lie as they lie."""
    if session.scene.source not in RENDERED or session.scene.turned:
        return {name: session}
    scene = structs.replace(session.scene, turned=True)
    return {name: session, f"{name} {TURNED}": structs.replace(session, scene=scene)}


def _write_objects(outcomes: Sequence[UnitAnswer], path: Path) -> None:
    """All outcomes: a row per curve, x, seed, frame and object."""
    write_rows(path, [_row(outcome) for outcome in outcomes])


def _row(outcome: UnitAnswer) -> dict[str, object]:
    answer = outcome.answer
    return {
        "panel": outcome.panel,
        "x": outcome.x,
        "seed": answer.seed,
        "scene": outcome.scene,
        "frame": answer.frame,
        "curve": outcome.curve,
        "instance_id": answer.instance_id,
        "obj_id": answer.obj_id,
        "ms": outcome.ms,
        "refiner_calls": outcome.refiner_calls,
        "name": answer.name,
        "grasp": outcome.grasp,
        "missing": outcome.missing,
        "ar_vsd": outcome.recall("ar_vsd"),
        "ar_mssd": outcome.recall("ar_mssd"),
        "ar_mspd": outcome.recall("ar_mspd"),
        "add_s_mm": answer.add_s_mm,
        "relative": answer.relative_error,
        "rotation_deg": answer.rotation_deg,
        "translation_mm": answer.translation_mm,
        "ar": outcome.recall("ar"),
    }


def _about(sessions: Mapping[str, Session], outcomes: Sequence[UnitAnswer], seeds: int) -> str:
    frames = {(o.scene, o.answer.frame) for o in outcomes}
    objects = {(o.scene, o.answer.frame, o.answer.instance_id) for o in outcomes}
    counts = {"frame": len(frames), "object": len(objects), "seed": seeds}
    return f"{', '.join(sessions)}: " + ", ".join(f"{n} {what}" + "s" * (n != 1) for what, n in counts.items())
