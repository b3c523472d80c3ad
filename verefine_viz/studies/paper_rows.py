"""The rows of the paper's Tables I-III, and why some of them cannot be made from the frames at hand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.core.settings import Session

NO_DENSEFUSION = "DenseFusion and its refiner are not part of this package"
SOURCES = {"ppf": "point pair features", "pcs": "congruent point sets"}
GIVEN = {"perturb": "disturbed ground truth", "results": "results files"} | SOURCES


@dataclass(frozen=True)
class PaperRows:
    """Rows of one table with the same data, first poses and refiner."""

    table: str
    dataset: str
    """Folder name of the BOP data set."""
    data: str
    """What the paper calls it."""
    parts: str
    """First poses, refiner and methods, for people."""
    source: str
    """``hypotheses.source`` of the first poses; empty: not here at all."""


ROWS = (
    PaperRows("I", "lm", "LINEMOD", "DenseFusion alone, + PIR, + SIR (2 calls), + RIR (10 calls)", ""),
    PaperRows("I", "lm", "LINEMOD", "PPF with ICP alone, + PIR, + SIR, + RIR", "ppf"),
    PaperRows("II", "xapc", "Extended APC", "Super4PCS with TrICP: PHYSIM-MCTS, RIR, VF_b, VF_d", "pcs"),
    PaperRows("III", "ycbv", "YCB-Video", "DenseFusion alone, + PIR, + SIR, + RIR, + VF_b, + VF_d", ""),
)


def missing_rows(sessions: Iterable[Session]) -> tuple[str, ...]:
    """A sentence for each group of the paper's rows that these sessions do not make, with the reason."""
    every = list(sessions)
    found: list[str] = []
    for rows in ROWS:
        reasons = [_reason(rows, session) for session in every]
        if all(reasons):
            found.append(f"Table {rows.table}, {rows.data}, {rows.parts}: {reasons[0]}")
    return tuple(found)


def _reason(rows: PaperRows, session: Session) -> str:
    """Why a session does not make these rows; empty where it does."""
    reasons: list[str] = []
    here = Path(session.scene.dataset).name if session.scene.source == "bop" else ""
    if here != rows.dataset:
        reasons.append(f"needs the data set {rows.dataset}, these are {here or 'built-in scenes'}")
    if not rows.source:
        reasons.append(NO_DENSEFUSION)
    elif session.hypotheses.source != rows.source:
        first = GIVEN[session.hypotheses.source]
        reasons.append(f'needs first poses by {SOURCES[rows.source]} (source = "{rows.source}"), these are {first}')
    return "; ".join(reasons)
