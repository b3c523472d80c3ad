"""How well objects of frames without ground truth are labelled, measured on frames whose ground truth is hidden.

    python -m bench.labelling find DATASET_FOLDER [--seeds 4] [--marks scribble]
    python -m bench.labelling find --demo clutter

``find``: a box around each object (that of its mask, each side up to 20 % of the object further out, at random), or a
scribble on it, and the model; which share has the right pose among the five that are offered, and what it takes, by
what proposes poses. "Right" is ADD(-S) below 10 % of the diameter, "looks right" ADD-S below 5 %.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from rich.console import Console

from bench.__main__ import table
from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Estimator
from verefine_viz.estimators.registry import make_estimator
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.labels.marked_region import region_of_box, region_of_scribble
from verefine_viz.labels.object_search import N_ESTIMATED, N_OFFERED, best, views
from verefine_viz.labels.placing import target_of
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.unlabelled_frames import unlabelled_frames

LOOKS_RIGHT = 0.05
MOSTLY_HIDDEN = 0.5
LARGER = 0.2
"""By how much of the object's size a box is too large on each side, at most."""

Proposed = list[tuple[Float, str]]
Propose = Callable[[Target], Proposed]


@dataclass(frozen=True, eq=False)
class Known:
    """An object whose truth is known, in a frame as it is without."""

    name: str
    observation: Observation
    truth: Target


def toolbox(dataset: Path | None, demo: str) -> Toolbox:
    """The tools of a data set's session, or of a built-in scene's."""
    scene = (
        {"source": "demo", "demo": demo} if dataset is None else {"source": "bop", "dataset": str(dataset.resolve())}
    )
    return Toolbox(resolve({"scene": scene, "hypotheses": {"source": "perturb", "max_per_object": 1}}))


def known_objects(tools: Toolbox) -> Iterator[Known]:
    """All objects with truth; the frames of a data set are opened as those without objects are."""
    scene = tools.session.scene
    bare = unlabelled_frames(scene) if scene.source == "bop" else None
    for frame in tools.frames:
        problem = tools.source.problem(frame)
        observation = problem.observation if bare is None else bare.observation(frame)[0]
        for target in problem.targets:
            if target.instance.T_cam_obj_gt is not None:
                yield Known(f"{frame} {target.model.name}", observation, target)


# find ----------------------------------------------------------------------------------------------------------------


def drawn_box(mask: Mask, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """A box that a person may draw around a mask: (left, top, right, bottom) [px]."""
    v, u = np.nonzero(mask)
    left, top, right, bottom = u.min(), v.min(), u.max() + 1, v.max() + 1
    gaps = rng.uniform(0, LARGER, 4) * np.array([right - left, bottom - top, right - left, bottom - top])
    return left - gaps[0], top - gaps[1], right + gaps[2], bottom + gaps[3]


def drawn_scribble(mask: Mask, rng: np.random.Generator) -> Float:
    """A stroke across the middle of a mask, (20, 2) (u, v) [px]: 60 % of its extent in a random direction."""
    v, u = np.nonzero(mask)
    middle, angle = np.array([np.median(u), np.median(v)]), rng.uniform(0, np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    places = np.stack([u, v], axis=1)
    beside = np.abs((places - middle) @ np.array([-along[1], along[0]])) < 1
    low, high = np.quantile((places[beside] - middle) @ along, (0.2, 0.8))
    return middle + np.linspace(low, high, 20)[:, None] * along


def region(known: Known, marks: str, rng: np.random.Generator) -> Mask:
    """The pixels that a drawn box or scribble gives."""
    mask = known.truth.instance.mask
    if marks == "scribble":
        return region_of_scribble(known.observation, drawn_scribble(mask, rng), known.truth.model.diameter_m)
    return region_of_box(known.observation, drawn_box(mask, rng))


def estimated(estimator: Estimator) -> Propose:
    """What an estimator proposes."""

    def propose(target: Target) -> Proposed:
        return [(h.T_cam_obj, h.source) for h in estimator.hypotheses(target, N_ESTIMATED)]

    return propose


def find(tools: Toolbox, n_seeds: int, marks: str) -> None:
    """Print a row for each way to propose poses, and the objects that are not among those offered."""
    all_known = [*known_objects(tools)]
    ppf, pcs = (estimated(make_estimator(name, tools.session)) for name in ("ppf", "pcs"))
    ways: dict[str, Sequence[Propose]] = {
        "point pair features": (ppf,),
        "congruent sets": (pcs,),
        "views": (views,),
        "point pair features, views": (ppf, views),
        "all": (ppf, pcs, views),
    }
    rows: dict[str, list[tuple[list[PoseErrors], Target, float]]] = {name: [] for name in ways}
    missed: list[str] = []
    seeds = [(k, seed) for k in range(len(all_known)) for seed in range(n_seeds)]
    for k, seed in seeds:
        known, truth = all_known[k], all_known[k].truth
        for name, propose in ways.items():
            if seed == 0:  # Models are prepared before anything is measured.
                _offered(tools, known, region(known, marks, np.random.default_rng([k, seed])), propose)
            began, rng = process_time(), np.random.default_rng([k, seed])
            poses = _offered(tools, known, region(known, marks, rng), propose)
            spent_ms = 1e3 * (process_time() - began)
            T_gt = truth.instance.T_cam_obj_gt
            assert T_gt is not None
            errors = [pose_errors(truth.model, T, T_gt) for T in poses]
            rows[name].append((errors, truth, spent_ms))
            if name == "point pair features, views" and not any(e.is_correct for e in errors):
                missed.append(f"{known.name}, seed {seed}: {'looks right' if _looks_right(errors, truth) else 'wrong'}")
    hidden = sum((known.truth.instance.visib_fract or 1.0) < MOSTLY_HIDDEN for known in all_known)
    title = f"find by a {marks}: {len(all_known)} objects ({hidden} mostly hidden), {n_seeds} seeds"
    console = Console(width=150)
    console.print(table(title, [_row(name, tries) for name, tries in rows.items()], 0))
    console.print("\n".join(missed) or "none missed")


def _offered(tools: Toolbox, known: Known, where: Mask, propose: Sequence[Propose]) -> list[Float]:
    target = target_of(known.observation, known.truth.model, 0, where, tools.session.scene)
    proposed = [pose for one in propose for pose in one(target)]
    return [one.T_cam_obj for one in best(tools, target, proposed, (), N_OFFERED)]


def _looks_right(errors: Sequence[PoseErrors], target: Target) -> bool:
    return any(e.adds_mm < 1e3 * LOOKS_RIGHT * target.model.diameter_m for e in errors)


def _row(name: str, tries: Sequence[tuple[list[PoseErrors], Target, float]]) -> dict[str, object]:
    def share(of: Callable[[list[PoseErrors], Target], bool]) -> float:
        return 100 * float(np.mean([of(errors, target) for errors, target, _ in tries]))

    return {
        "proposed by": name,
        "right among five %": share(lambda errors, _: any(e.is_correct for e in errors)),
        "first %": share(lambda errors, _: any(e.is_correct for e in errors[:1])),
        "looks right among five %": share(_looks_right),
        "looks right first %": share(lambda errors, target: _looks_right(errors[:1], target)),
        "median CPU ms": float(np.median([ms for *_, ms in tries])),
        "worst CPU ms": float(np.max([ms for *_, ms in tries])),
    }


def first_use(tools: Toolbox) -> None:
    """Print how long a model takes when it is looked for the first time."""
    ms = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # Nothing cached by earlier runs.
        for known in {known.truth.model.obj_id: known for known in known_objects(tools)}.values():
            estimator, began = make_estimator("ppf", tools.session), perf_counter()
            estimator.hypotheses(known.truth, 1)
            middle = perf_counter()
            estimator.hypotheses(known.truth, 1)
            ms.append(1e3 * (2 * middle - began - perf_counter()))
    Console().print(f"first use of a model: median {np.median(ms):.0f} ms, worst {np.max(ms):.0f} ms of {len(ms)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="what", required=True)
    finding = commands.add_parser("find")
    finding.add_argument("dataset", type=Path, nargs="?")
    finding.add_argument("--demo", default="clutter")
    finding.add_argument("--seeds", type=int, default=4)
    finding.add_argument("--marks", choices=("box", "scribble"), default="box")
    given = parser.parse_args()
    tools = toolbox(given.dataset, given.demo)
    find(tools, given.seeds, given.marks)
    first_use(tools)
