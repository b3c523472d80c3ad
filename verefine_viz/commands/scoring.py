"""How scores are printed: a table for people, JSON for machines."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.bar import counted_bar
from verefine_viz.evaluation.answers import correct_share, mean_errors
from verefine_viz.evaluation.bop_scores import Scores
from verefine_viz.evaluation.coverage import Coverage
from verefine_viz.evaluation.files import Evaluation, evaluate_files
from verefine_viz.evaluation.precision import Precision
from verefine_viz.evaluation.recalls import Recalls
from verefine_viz.evaluation.targets import Task


def print_scores(
    files: Sequence[Path],
    dataset: Path,
    split: str,
    targets: Path | None,
    task: Task | None,
    workers: int,
    as_json: bool,
    per_object: bool,
) -> None:
    """Scores the files and prints what was found.

    Raises:
        VerefineError: a file or the data set cannot be used.
    """
    with counted_bar("images") as tell:
        found = evaluate_files(
            files, dataset, split, targets, task, workers, lambda done, total: tell("images", done, total)
        )
    if as_json:
        print(json.dumps(evaluation_json(found), indent=2, ensure_ascii=False, allow_nan=False))
        return
    console = Console(highlight=False)
    console.print(_overview(found))
    if per_object:
        for score in found.scores:
            console.print(_by_object(score, found.names))
    for line in (*_remarks(found), *found.notes):
        console.print(escape(line), soft_wrap=True)
    console.print(f"measured in {found.seconds:.1f} s")


def evaluation_json(found: Evaluation) -> dict[str, Any]:
    """All numbers of an evaluation; what is infinite or unknown is null."""
    return {
        "dataset": found.dataset,
        "split": found.split,
        "targets": found.targets,
        "notes": list(found.notes),
        "seconds": found.seconds,
        "results": [
            {"file": str(path), **scores_json(score, found.names), "coverage": asdict(covered)}
            for path, score, covered in zip(found.files, found.scores, found.coverage, strict=True)
        ],
    }


def scores_json(score: Scores, names: dict[int, str]) -> dict[str, Any]:
    """All numbers of one method."""
    head: dict[str, Any] = {"method": score.name, "task": score.task}
    if score.precision is not None:
        head |= _precision_json(score.precision)
        head["objects"] = {
            str(i): {"name": names.get(i, ""), **_precision_json(p)} for i, p in score.precision_by_object.items()
        }
    if score.recalls is not None:
        turn_deg, shift_mm = mean_errors(score.answers)
        head |= _recalls_json(score.recalls)
        head |= {"mean_rotation_deg": _known(turn_deg), "mean_translation_mm": _known(shift_mm)}
        head["add_s_below_10_percent"] = _known(correct_share(score.answers))
        head["recalls"] = {
            "VSD": score.recalls.vsd.tolist(),
            "MSSD": score.recalls.mssd.tolist(),
            "MSPD": score.recalls.mspd.tolist(),
        }
        head["objects"] = {str(i): _object_json(score, i, names) for i in score.recalls_by_object}
        head["scenes"] = {str(i): _recalls_json(r) for i, r in score.recalls_by_scene.items()}
    seconds = score.mean_time_s if score.mean_time_s >= 0 else None
    return head | {"average_time_per_image_s": seconds, "counts": asdict(score.counts)}


def _recalls_json(recalls: Recalls) -> dict[str, Any]:
    return {
        "AR": recalls.ar,
        "AR_VSD": recalls.ar_vsd,
        "AR_MSSD": recalls.ar_mssd,
        "AR_MSPD": recalls.ar_mspd,
        "targets": recalls.n_targets,
    }


def _precision_json(precision: Precision) -> dict[str, Any]:
    return {
        "mAP": precision.map,
        "mAP_MSSD": precision.mssd,
        "mAP_MSPD": precision.mspd,
        "mAP_MSSD_mm": precision.mssd_mm,
        "targets": precision.n_targets,
    }


def _object_json(score: Scores, obj_id: int, names: dict[int, str]) -> dict[str, Any]:
    mine = [a for a in score.answers if a.obj_id == obj_id]
    turn_deg, shift_mm = mean_errors(mine)
    return {
        "name": names.get(obj_id, ""),
        **_recalls_json(score.recalls_by_object[obj_id]),
        "mean_rotation_deg": _known(turn_deg),
        "mean_translation_mm": _known(shift_mm),
        "add_s_below_10_percent": _known(correct_share(mine)),
        "missing": sum(a.row is None for a in mine),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _overview(found: Evaluation) -> Table:
    first = found.scores[0]
    what = f"{found.dataset}/{found.split}, {found.targets}, {first.counts.targets} targets"
    is_timed = any(score.mean_time_s >= 0 for score in found.scores)
    table = _table(f"{what}: {_measure(first)} [%]", "method")
    for head in (*_heads(first), "missing", *(["s/image"] if is_timed else [])):
        table.add_column(head, justify="right")
    for score in found.scores:
        seconds = f"{score.mean_time_s:.3g}" if score.mean_time_s >= 0 else "-"
        missing = str(score.counts.missing)
        table.add_row(escape(score.name), *_numbers(score), missing, *([seconds] if is_timed else []))
    return table


def _table(title: str, *names: str) -> Table:
    # Narrow: ten columns are to fit a terminal of 80 characters.
    table = Table(title=escape(title), title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in names:
        table.add_column(name, overflow="ellipsis", no_wrap=True)
    return table


def _measure(score: Scores) -> str:
    return "average recall" if score.precision is None else "mean average precision"


def _heads(score: Scores) -> tuple[str, ...]:
    if score.precision is not None:
        return "mAP", "MSSD", "MSPD", "MSSD 2-20 mm"
    return "AR", "VSD", "MSSD", "MSPD", "ADD(-S)", "r̄ °", "t̄ mm"


def _numbers(score: Scores) -> list[str]:
    if score.precision is not None:
        return _precisions(score.precision)
    assert score.recalls is not None
    return [*_recalls(score.recalls), *_means(score)]


def _precisions(p: Precision) -> list[str]:
    return [_percent(x) for x in (p.map, p.mssd, p.mspd, p.mssd_mm)]


def _recalls(r: Recalls) -> list[str]:
    return [_percent(x) for x in (r.ar, r.ar_vsd, r.ar_mssd, r.ar_mspd)]


def _means(score: Scores, obj_id: int | None = None) -> list[str]:
    mine = [a for a in score.answers if obj_id in (None, a.obj_id)]
    return [_percent(correct_share(mine)), *("-" if math.isnan(x) else f"{x:.1f}" for x in mean_errors(mine))]


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.1f}"


def _by_object(score: Scores, names: dict[int, str]) -> Table:
    table = _table(f"{score.name}: {_measure(score)} [%]", "#", "object")
    for head in (*_heads(score), "targets", *(["missing"] if score.precision is None else [])):
        table.add_column(head, justify="right")
    for obj_id, precision in score.precision_by_object.items():
        numbers = *_precisions(precision), str(precision.n_targets)
        table.add_row(str(obj_id), escape(names.get(obj_id, "")), *numbers)
    for obj_id, recalls in score.recalls_by_object.items():
        missing = sum(a.row is None for a in score.answers if a.obj_id == obj_id)
        numbers = *_recalls(recalls), *_means(score, obj_id), str(recalls.n_targets), str(missing)
        table.add_row(str(obj_id), escape(names.get(obj_id, "")), *numbers)
    return table


def _remarks(found: Evaluation) -> list[str]:
    """What a person should know about each results file, a sentence each, and what the columns mean."""
    lines = []
    for score, covered in zip(found.scores, found.coverage, strict=True):
        lines += [f"{score.name}: {what}" for what in (*_covered(covered), *_rows(score))]
    if found.scores[0].task == "localization":
        lines.append("ADD(-S): targets with less than 10 % of the diameter; r̄, t̄: mean errors of those with a pose")
    return lines


def _covered(covered: Coverage) -> list[str]:
    """What a file says nothing about, and which of its rows are no poses."""
    lines = []
    if not covered.is_whole:
        objects = f" and {covered.objects} of {covered.objects_asked} objects" if covered.objects_asked else ""
        lines.append(
            f"has estimates for {covered.images} of {covered.images_asked} images{objects} that the targets ask for; "
            "the others count as not found"
        )
    if covered.not_finite:
        lines.append(f"{covered.not_finite} rows hold NaN or infinity for a pose, and count as wrong")
    if covered.not_ranked:
        lines.append(
            f"{covered.not_ranked} rows have no number as score, so which of several rows come first is chance"
        )
    if covered.not_rigid:
        lines.append(f"in {covered.not_rigid} rows R is no rotation; errors are measured with R as it is written")
    return lines


def _rows(score: Scores) -> list[str]:
    """What became of rows that were not scored."""
    counts, lines = score.counts, []
    if counts.unasked:
        ids = "scenes, images or objects that the targets do not name"
        lines.append(f"{counts.unasked} of {counts.rows} rows are about {ids}, and were ignored")
    if counts.surplus:
        limit = "the instances asked for" if score.task == "localization" else "the limit of an image"
        lines.append(f"{counts.surplus} rows beyond {limit} were left out, the lowest scores")
    return lines
