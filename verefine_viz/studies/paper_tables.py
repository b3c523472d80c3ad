"""Every refiner at the paper's budget on the frames as they are: Tables I to III (Sec. V-C) as far as the data allow.

A panel is a refiner. That of DF-R has the rows of Tables I and III, which differ in their data; that of ICP is in Table
I, and that of trimmed ICP is Table II.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.studies.budgets import BUDGETS, Budget, budget_of
from verefine_viz.studies.disturbance import disturbed, first_poses, with_ground_truth
from verefine_viz.studies.study_plan import Claim, Panel, Prepare, Study, StudyCurve

ROTATION_DEG, TRANSLATION_MM = 30.0, 30.0
"""Initial poses where the session brings none."""
MOST_HYPOTHESES = max(budget.hypotheses for budget in BUDGETS.values())
SEVERAL = (("RIR", "rir"), ("VF_b", "vf_breadth"), ("VF_d", "vf_depth"))
MCTS = "PHYSIM-MCTS"
"""With its expansions counted, as in the paper; "PHYSIM-MCTS, 50" has its roll-outs counted too."""
FIRST = "first initial pose"
POOL = tuple(f"hypotheses.{name}" for name in ("max_per_object", "rotation_deg", "translation_mm", "seed"))
"""How many initial poses there are, and their error where they are disturbed, which the study makes itself."""


def tables(own_initial_poses: bool = False, refiner: str = "icp") -> Study:
    """A panel with one x for each refiner, whose curves are the rows.

    Args:
        own_initial_poses: the session's own initial poses instead of disturbed ground truth.
        refiner: the session's; it is added where the paper does not have it.
    """
    budgets = list(BUDGETS.values())
    if refiner not in BUDGETS:
        budgets.append(budget_of(refiner))
    panels = tuple(_panel(budget, own_initial_poses) for budget in budgets)
    return Study("tables", "Tables I-III", panels, own=(*POOL, "mcts.trim"))


def _panel(budget: Budget, own_initial_poses: bool) -> Panel:
    has_tree = budget.refiner == "trimmed_icp"
    short, long = budget.short, budget.long
    # Disturbed ground truth is off by as much in every pose; an estimator's poses are a row of the table.
    curves = [StudyCurve(FIRST, None)] if own_initial_poses else []
    if has_tree:
        curves += [budget.search(MCTS, long), budget.search(f"{MCTS}, {long}", long, long)]
    else:
        curves += [
            budget.alone(f"{budget.name}, {short}", short),
            budget.curve(f"PIR, {short}", "pir"),
            budget.curve(f"SIR, {short}", "sir"),
            budget.alone(f"{budget.name}, {long}", long),
        ]
    curves += [budget.curve(f"{name}, {long}", method) for name, method in SEVERAL]
    claims = _search_table(long) if has_tree else _refiner_tables(budget)
    prepare = _own_poses(budget.hypotheses) if own_initial_poses else _far(budget.hypotheses)
    return Panel(
        budget.name,
        "",
        (0.0,),
        tuple(curves),
        prepare,
        claims,
        f"H = {budget.hypotheses}; {budget.about}",
        may_lack=True,
    )


def _refiner_tables(budget: Budget) -> tuple[Claim, ...]:
    """Tables I and III."""
    short, long, name = budget.short, budget.long, budget.name
    pir, sir, rir = f"PIR, {short}", f"SIR, {short}", f"RIR, {long}"
    if name == "ICP":
        # From the good poses of PPF physics alone loses.
        first = Claim(f"{name}, {short}", pir, reading="PIR alone diverges from accurate initial poses")
    else:
        first = Claim(pir, f"{name}, {short}")
    vf = () if name == "ICP" else (Claim(f"VF_b, {long}", rir), Claim(f"VF_d, {long}", f"VF_b, {long}"))
    more = (Claim(sir, pir), Claim(sir, f"{name}, {short}"), Claim(rir, sir), Claim(rir, f"{name}, {long}"))
    worse = Claim(f"{name}, {short}", f"{name}, {long}", reading="more iterations make it worse on YCB-V, not on LM")
    return first, *more, *((worse,) if name == "DF-R" else ()), *vf


def _search_table(long: int) -> tuple[Claim, ...]:
    """Table II."""
    rir, vf_b, vf_d = (f"{name}, {long}" for name, _ in SEVERAL)
    return (
        Claim(rir, MCTS, "ar_vsd"),
        Claim(rir, MCTS, "ar_mspd"),
        Claim(vf_b, MCTS),
        Claim(vf_d, MCTS),
        Claim(vf_d, f"{MCTS}, {long}"),
        Claim(vf_b, rir),
        Claim(vf_d, vf_b),
    )


def _own_poses(n: int) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        return first_poses(with_ground_truth(problem), n)

    return prepare


def _far(n: int) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        return disturbed(problem, n, ROTATION_DEG, TRANSLATION_MM, seed)

    return prepare


@dataclass(frozen=True)
class PaperRow:
    """What the paper prints in a row, in percent."""

    label: str
    """Label as in the panel of its refiner."""
    vsd: float
    mspd: float
    mssd: float
    ar: float
    time: float
    """[ms]; of Table II [s]."""
    n_refined: int
    """#ref/obj."""
    rotation_deg: float | None = None
    translation_cm: float | None = None


@dataclass(frozen=True)
class PaperTable:
    """Rows of one of the paper's tables with the same data, initial poses and refiner."""

    number: str
    dataset: str
    """Folder name of the BOP data set."""
    data: str
    """What the paper calls it."""
    source: str
    """``hypotheses.source`` of the initial poses."""
    panel: str
    rows: tuple[PaperRow, ...]
    n_frames: int | None = None
    """None: the paper does not say; the whole data set."""


PAPER = (
    PaperTable(
        "I", "lm", "LINEMOD", "densefusion", "DF-R",
        (
            PaperRow("DF-R, 2", 70.6, 76.8, 77.7, 75.0, 2, 2),
            PaperRow("PIR, 2", 73.3, 79.3, 80.1, 77.6, 4, 2),
            PaperRow("SIR, 2", 74.0, 85.9, 86.4, 82.1, 14, 2),
            PaperRow("DF-R, 10", 76.9, 82.6, 82.9, 80.8, 11, 10),
            PaperRow("RIR, 10", 78.3, 89.7, 89.6, 85.9, 48, 10),
        ),
        2219,
    ),
    PaperTable(
        "I", "lm", "LINEMOD", "ppf", "ICP",
        (
            PaperRow("ICP, 50", 79.8, 93.2, 93.0, 88.7, 248, 50),
            PaperRow("PIR, 50", 78.1, 92.1, 92.1, 87.4, 274, 50),
            PaperRow("SIR, 50", 79.9, 93.7, 93.2, 88.9, 302, 50),
            PaperRow("ICP, 150", 80.0, 93.4, 93.2, 88.9, 617, 150),
            PaperRow("RIR, 150", 81.0, 95.1, 94.5, 90.2, 892, 150),
        ),
        2219,
    ),
    PaperTable(
        "II", "xapc", "Extended APC", "pcs", "TrICP",
        (
            PaperRow("PHYSIM-MCTS", 48.5, 51.6, 68.3, 56.2, 29.9, 50, 5.7, 1.3),
            PaperRow("RIR, 50", 51.8, 52.0, 63.0, 55.6, 5.5, 50, 10.5, 1.4),
            PaperRow("VF_b, 50", 54.4, 54.3, 66.7, 58.5, 5.5, 50, 8.0, 1.2),
            PaperRow("VF_d, 50", 56.7, 57.3, 69.6, 61.2, 6.2, 50, 7.5, 1.2),
        ),
    ),
    PaperTable(
        "III", "ycbv", "YCB-Video", "densefusion", "DF-R",
        (
            PaperRow("DF-R, 2", 74.2, 69.9, 77.6, 73.9, 17, 2),
            PaperRow("PIR, 2", 74.9, 70.8, 78.2, 74.7, 20, 2),
            PaperRow("SIR, 2", 76.5, 72.9, 80.2, 76.5, 49, 2),
            PaperRow("DF-R, 10", 71.2, 66.3, 75.6, 71.0, 71, 10),
            PaperRow("RIR, 10", 77.9, 73.9, 80.6, 77.5, 228, 10),
            PaperRow("VF_b, 10", 78.3, 73.8, 80.6, 77.6, 495, 10),
            PaperRow("VF_d, 10", 78.5, 74.1, 80.9, 77.8, 521, 10),
        ),
        900,
    ),
)  # fmt: skip
"""Tables I to III. #ref/obj of Table II: 150 iterations of a scene of three objects."""
SOURCES = {"ppf": "point pair features", "pcs": "congruent point sets", "densefusion": "DenseFusion"}
GIVEN = {"perturb": "disturbed ground truth", "results": "results files", "recorded": "recorded ones"} | SOURCES


def paper_table(panel: str, sessions: Collection[Session], n_frames: int) -> PaperTable | None:
    """The paper's table on as many frames of the same data with the same initial poses; None where they are others."""
    own = (t for t in PAPER if t.panel == panel and not any(_reason(t, session, n_frames) for session in sessions))
    return next(own, None)


def missing_rows(sessions: Collection[Session], n_frames: int) -> tuple[str, ...]:
    """A sentence for each of the paper's tables that these frames do not make, with the reason."""
    sentences: list[str] = []
    for table in PAPER:
        reasons = [_reason(table, session, n_frames) for session in sessions]
        if any(reasons):
            sentences.append(f"Table {table.number}, {table.data}, {table.panel}: {next(filter(None, reasons))}")
    return tuple(sentences)


def _reason(table: PaperTable, session: Session, n_frames: int) -> str:
    """Why a session does not make these rows; empty where it does."""
    reasons: list[str] = []
    here = Path(session.scene.dataset).name if session.scene.source == "bop" else ""
    if here != table.dataset:
        reasons.append(f"needs the data set {table.dataset}, these are {here or 'built-in scenes'}")
    elif table.n_frames not in (None, n_frames):
        reasons.append(f"needs its {table.n_frames} frames, these are {n_frames}")
    if session.hypotheses.source != table.source:
        given = GIVEN.get(session.hypotheses.source, f"those of {session.hypotheses.source}")
        reasons.append(f'needs initial poses by {SOURCES[table.source]} (source = "{table.source}"), these are {given}')
    return "; ".join(reasons)
