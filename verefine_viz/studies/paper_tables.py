"""Refiner × method × budget on the frames as they are: the paper's Tables I-III (Sec. V-C) as far as the data allow.

Rows of these tables that cannot be made from the frames at hand are named, with the reason.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.studies.disturbance import disturbed, with_ground_truth
from verefine_viz.studies.study_plan import Claim, Curve, Panel, Study

REFINERS = {"icp": "ICP", "trimmed_icp": "TrICP"}
DF_R = {"densefusion": "DF-R"}
"""As the paper calls it; other refiners are called by their names."""
SHORT, LONG = 2, 10
"""Refiner calls per hypothesis (Table I)."""
ROTATION_DEG, TRANSLATION_MM, HYPOTHESES = 30.0, 30.0, 5
"""Initial poses where the session brings none."""
SINGLE = (("", "refine"), ("+ PIR", "pir"), ("+ SIR", "sir"))
SEVERAL = (("+ RIR", "rir"), ("+ VF_b", "vf_breadth"), ("+ VF_d", "vf_depth"))
TREND = "PIR < SIR < RIR < VF_b < VF_d where objects touch; PHYSIM-MCTS below VF_b at many times its duration"


def tables(quick: bool = False, own_initial_poses: bool = False, refiner: str = "icp") -> Study:
    """One panel with one x: every row is a curve.

    Args:
        quick: ICP only (and ``refiner``), and the short budget.
        own_initial_poses: the session's own initial poses instead of disturbed ground truth.
        refiner: the session's; it is added where it is none of ``REFINERS``.
    """
    # Disturbed ground truth is off by as much in every pose; an estimator's poses are a row of the table.
    curves = [Curve("first initial pose", None)] if own_initial_poses else []
    refiners = dict(list(REFINERS.items())[:1]) if quick else dict(REFINERS)
    if refiner not in REFINERS:
        refiners[refiner] = DF_R.get(refiner, refiner)
    for key, name in refiners.items():
        for budget in (SHORT,) if quick else (SHORT, LONG):
            for suffix, method in (*SINGLE, *SEVERAL):
                label = f"{name} {suffix}".strip() + f", {budget}"
                curves.append(Curve(label, _settings(method, key, budget)))
    budget = SHORT if quick else LONG
    mcts: Mapping[str, Any] = {"expansions": budget * HYPOTHESES}
    curves.append(Curve(f"PHYSIM-MCTS, {budget}", {"method": {"name": "physim_mcts"}, "mcts": mcts}))
    claims: list[Claim] = []
    for name in refiners.values():
        rows = [f"{name} {suffix}".strip() + f", {budget}" for suffix, _ in (*SINGLE, *SEVERAL)]
        claims += [Claim(rows[3], rows[2]), Claim(rows[4], rows[3]), Claim(rows[5], rows[4])]
        claims.append(Claim(rows[5], f"PHYSIM-MCTS, {budget}"))
    panel = Panel("table", "", (0.0,), tuple(curves), _as_it_is if own_initial_poses else _far, tuple(claims), TREND)
    return Study("tables", "Methods and budgets (paper, Tables I-III)", (panel,))


def _settings(method: str, refiner: str, budget: int) -> dict[str, dict[str, Any]]:
    return {"method": {"name": method, "refiner": refiner, "iterations": budget}}


def _as_it_is(problem: Problem, x: float, seed: int) -> Problem:
    return with_ground_truth(problem)


def _far(problem: Problem, x: float, seed: int) -> Problem:
    return disturbed(problem, HYPOTHESES, ROTATION_DEG, TRANSLATION_MM, seed)


PAPER_AR = {
    "DF-R, 2": "75.0 / 73.9",
    "DF-R + PIR, 2": "77.6 / 74.7",
    "DF-R + SIR, 2": "82.1 / 76.5",
    "DF-R, 10": "80.8 / 71.0",
    "DF-R + RIR, 2": "85.9 / 77.5",
    "DF-R + VF_b, 2": "- / 77.6",
    "DF-R + VF_d, 2": "- / 77.8",
    "ICP, 2": "88.7",
    "ICP + PIR, 2": "87.4",
    "ICP + SIR, 2": "88.9",
    "ICP, 10": "88.9",
    "ICP + RIR, 2": "90.2",
    "TrICP + RIR, 10": "55.6",
    "TrICP + VF_b, 10": "58.5",
    "TrICP + VF_d, 10": "61.2",
    "PHYSIM-MCTS, 10": "56.2",
}
"""The paper's AR by label, on its data: to compare orders. DF-R: Tables I / III; ICP: Table I (from PPF); the others:
Table II, with 150 iterations. Methods with several hypotheses have 10 calls per object in Tables I and III, 2 each."""
SOURCES = {"ppf": "point pair features", "pcs": "congruent point sets", "densefusion": "DenseFusion"}
GIVEN = {"perturb": "disturbed ground truth", "results": "results files"} | SOURCES


@dataclass(frozen=True)
class PaperRows:
    """Rows of one table with the same data, initial poses and refiner."""

    table: str
    dataset: str
    """Folder name of the BOP data set."""
    data: str
    """What the paper calls it."""
    parts: str
    """Initial poses, refiner and methods, in words."""
    source: str
    """``hypotheses.source`` of the initial poses."""


ROWS = (
    PaperRows("I", "lm", "LINEMOD", "DenseFusion alone, + PIR, + SIR (2 calls), + RIR (10 calls)", "densefusion"),
    PaperRows("I", "lm", "LINEMOD", "PPF with ICP alone, + PIR, + SIR, + RIR", "ppf"),
    PaperRows("II", "xapc", "Extended APC", "Super4PCS with TrICP: PHYSIM-MCTS, RIR, VF_b, VF_d", "pcs"),
    PaperRows("III", "ycbv", "YCB-Video", "DenseFusion alone, + PIR, + SIR, + RIR, + VF_b, + VF_d", "densefusion"),
)


def missing_rows(sessions: Collection[Session]) -> tuple[str, ...]:
    """A sentence for each group of the paper's rows that these sessions do not make, with the reason."""
    sentences: list[str] = []
    for rows in ROWS:
        reasons = [_reason(rows, session) for session in sessions]
        if all(reasons):
            sentences.append(f"Table {rows.table}, {rows.data}, {rows.parts}: {reasons[0]}")
    return tuple(sentences)


def _reason(rows: PaperRows, session: Session) -> str:
    """Why a session does not make these rows; empty where it does."""
    reasons: list[str] = []
    here = Path(session.scene.dataset).name if session.scene.source == "bop" else ""
    if here != rows.dataset:
        reasons.append(f"needs the data set {rows.dataset}, these are {here or 'built-in scenes'}")
    if session.hypotheses.source != rows.source:
        given = GIVEN[session.hypotheses.source]
        reasons.append(f'needs initial poses by {SOURCES[rows.source]} (source = "{rows.source}"), these are {given}')
    return "; ".join(reasons)
