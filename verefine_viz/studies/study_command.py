"""What ``verefine-viz study`` does: runs a study, writes CSV and figures, and prints which claims hold."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.progress import counted_bar
from verefine_viz.batch.terminal import Terminal
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic, clear_parts
from verefine_viz.run.session_file import load_session
from verefine_viz.studies.figure import Points, draw, points_of, rows, save, verdicts
from verefine_viz.studies.grasp_table import report_grasps
from verefine_viz.studies.paper_tables import PAPER_AR, missing_rows
from verefine_viz.studies.run_study import StudyRequest, run_study, saved_outcomes
from verefine_viz.studies.solve_unit import Outcome
from verefine_viz.studies.study_plan import Study

SCENES = ("mug", "duck", "bracket", "bowl", "clutter")
QUICK_SCENES = ("mug", "duck", "bracket")
"""Built-in scenes that are used where no session is given."""
TABLE_SCENES = (*SCENES, "stack")
QUICK_TABLE_SCENES = ("duck", "bowl", "stack")
"""The same for tables, whose methods of whole scenes differ only where objects touch."""
GRASP_SCENE = "clutter"
"""Of grasping: its objects stand close together, and the gripper can hold five of the six."""
PRESET = "published"
"""With them. With the recommended settings every method finds nearly every pose in these scenes: the refiner's wider
gate and ten inner iterations leave little difference between methods."""
SEEDS, QUICK_SEEDS = 5, 3
GRASP_SEEDS = 5, 1
"""Trials of each object as it lies, and turned: ten in the paper's Table IV."""
RENDERED = ("demo", "layout")
"""Sources of scenes whose objects can be turned."""
TURNED = "turned"
"""Follows the name of a scene whose objects are turned."""


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
    """Runs a study into ``out``; the exit code. Stopped by Ctrl-C, it writes what it has before it ends.

    Raises:
        VerefineError: the session, a frame or ``out`` cannot be used.
    """
    sessions = scenes(name, session, overrides, quick)
    first = next(iter(sessions.values()))
    own_initial_poses = first.hypotheses.source != "perturb"
    request = StudyRequest(name, quick, own_initial_poses, first.method.refiner)
    of_study = GRASP_SEEDS if name == "grasping" else (SEEDS, QUICK_SEEDS)
    n_seeds = seeds if seeds is not None else of_study[quick]
    if request.own_initial_poses and name == "tables":
        n_seeds = 1  # nothing is drawn
    journal, n_done, n_all = out / f"{name}.journal", 0, 0
    try:
        with counted_bar(f"study {name}") as report:

            def progress(done: int, total: int) -> None:
                nonlocal n_done, n_all
                n_done, n_all = done, total
                report(f"study {name}", done, total)

            outcomes = run_study(request, sessions, n_seeds, workers, journal, progress)
    except KeyboardInterrupt:
        if n_done:
            part = f"stopped after {n_done} of {n_all} runs"
            stderr = Terminal(stderr=True, highlight=False, soft_wrap=True)
            stderr.print(f"study {name}: {part}; writing them, the same command goes on")
            _write_results(request, sessions, n_seeds, saved_outcomes(request, sessions, n_seeds, journal), out, part)
        raise
    _write_results(request, sessions, n_seeds, outcomes, out)
    return 0


def _write_results(
    request: StudyRequest,
    sessions: Mapping[str, Session],
    seeds: int,
    outcomes: Sequence[Outcome],
    out: Path,
    part: str = "",
) -> None:
    """Writes and prints the outcomes; ``part`` says which these are, where it is not all of them."""
    name, study = request.name, request.study().only({(o.panel, o.x) for o in outcomes})
    about = ", ".join(text for text in (_about(sessions, outcomes, seeds), part) if text)
    clear_parts(out, name)
    write_objects(outcomes, out / f"{name}_objects.csv")
    if name == "grasping":
        report_grasps(study, outcomes, out, about)
        return
    points = points_of(outcomes)
    missing = missing_rows(sessions.values()) if name == "tables" else ()
    notes = ("Rows of the paper that are not here:", *missing) if missing else ()
    write_csv(study, points, out / f"{name}.csv")
    png, svg = save(draw(study, points, about, notes), out, name)
    _print_results(study, points, notes, (png, svg))


def scenes(study: str, session: Path | None, overrides: Mapping[str, Any], quick: bool) -> dict[str, Session]:
    """The session's scene, or built-in ones that suit this study, by name; of grasping also with its objects turned."""
    if session is not None or "scene" in overrides:
        one = load_session(session, dict(overrides))
        name = session.stem if session is not None else (Path(one.scene.layout).stem or one.scene.demo or "scene")
        return _with_turned(name, one) if study == "grasping" else {name: one}
    if study == "grasping":
        scene = {"demo": GRASP_SCENE, "frames": ("0/0",)}
        return _with_turned(GRASP_SCENE, load_session(None, {"preset": PRESET, **overrides, "scene": scene}))
    every, few = (TABLE_SCENES, QUICK_TABLE_SCENES) if study == "tables" else (SCENES, QUICK_SCENES)
    names = few if quick else every
    return {name: load_session(None, {"preset": PRESET, **overrides, "scene": {"demo": name}}) for name in names}


def _with_turned(name: str, session: Session) -> dict[str, Session]:
    """The scene as it is and with its objects turned; objects of a photo lie as they lie."""
    if session.scene.source not in RENDERED or session.scene.turned:
        return {name: session}
    scene = structs.replace(session.scene, turned=True)
    return {name: session, f"{name} {TURNED}": structs.replace(session, scene=scene)}


def write_csv(study: Study, points: Points, path: Path) -> None:
    """The curves: a row per panel, curve and x."""
    _write(path, [{k: f"{v:.6g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows(study, points)])


def write_objects(outcomes: Sequence[Outcome], path: Path) -> None:
    """Everything: a row per curve, x, seed, frame and object."""
    _write(path, [_row(outcome) for outcome in outcomes])


def _row(outcome: Outcome) -> dict[str, object]:
    row = msgspec.to_builtins(outcome)
    return {**row, **row.pop("quality"), "ar": outcome.quality.ar}


def _write(path: Path, table: Sequence[Mapping[str, object]]) -> None:
    with atomic(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(table[0]) if table else [])
        writer.writeheader()
        writer.writerows(table)


def _about(sessions: Mapping[str, Session], outcomes: Sequence[Outcome], seeds: int) -> str:
    frames = {(o.scene, o.frame) for o in outcomes}
    objects = {(o.scene, o.frame, o.instance_id) for o in outcomes}
    return f"{', '.join(sessions)}: {len(frames)} frames, {len(objects)} objects, {seeds} seeds"


def _print_results(study: Study, points: Points, notes: Sequence[str], figures: tuple[Path, Path]) -> None:
    console = Terminal(highlight=False, soft_wrap=True)
    if len(study.panels) == 1:
        console.print(_table(study, points))
    for panel in study.panels:
        console.print(f"[bold]{escape(panel.name)}[/bold]  paper: {escape(panel.trend)}")
        for verdict in verdicts(panel, points):
            console.print(escape(f"  {verdict}"))
    for note in notes:
        console.print(escape(note))
    console.print(escape(f"Figures: {figures[0]}, {figures[1].name}; numbers: {study.name}.csv beside them"))


def _table(study: Study, points: Points) -> Table:
    about = "AR in %; median ADD(-S) in mm; share below 10 % of the diameter; ms and refiner calls per object"
    table = Table(title=study.title, caption=about)
    table.add_column("", no_wrap=True)
    # VSD, MSSD and MSPD are in the CSV file: 80 columns hold no more than this.
    for heading in ("AR", "paper", "mm", "< 10 %", "ms", "calls"):
        table.add_column(heading, justify="right", no_wrap=True)
    for r in rows(study, points):
        table.add_row(
            str(r["curve"]),
            f"{100 * float(r['ar']):.1f}",
            PAPER_AR.get(str(r["curve"]), ""),
            f"{float(r['median_add_s_mm']):.1f}",
            f"{100 * float(r['below_10_percent']):.0f}",
            f"{float(r['ms_per_object']):.0f}",
            f"{float(r['refiner_calls_per_object']):.0f}",
        )
    return table
