"""How the scores of results files are printed: tables with remarks, or JSON."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.index import is_batch_folder
from verefine_viz.batch.progress import counted_bar
from verefine_viz.batch.terminal import Terminal
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.files import reading
from verefine_viz.core.text_format import say
from verefine_viz.evaluation.averages import Precision, Recalls
from verefine_viz.evaluation.bop_scores import BopScores
from verefine_viz.evaluation.matched_estimates import correct_share, mean_errors
from verefine_viz.evaluation.pose_table import Coverage, Covered, OwnPart
from verefine_viz.evaluation.results_scores import Evaluation, evaluate_files
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.annotations import Task

SHORTEST = 12
"""What is left of a name at least [characters]."""
OWN = {"run": "only the images that each run covered", "file": "only the images that each file names"}
"""Which images a score is about that is not about all targets, by how these are known."""
OWN_OBJECTS = "only the images and objects that each run was to solve"
"""Heading where a run was to solve some objects only."""


def print_scores(
    files: Sequence[Path],
    dataset: Path,
    split: str,
    targets: Path | None,
    task: Task | None,
    workers: int,
    as_json: bool,
    per_object: bool,
    sensor: str = "",
) -> None:
    """Scores the files and prints the result.

    Raises:
        VerefineError: a file or the data set cannot be used.
    """
    with counted_bar("images") as report:
        evaluation = evaluate_files(
            files,
            dataset,
            split,
            targets,
            task,
            workers,
            lambda done, total: report("images", done, total),
            covered_by,
            sensor,
        )
    if as_json:
        say(json.dumps(_evaluation_json(evaluation), indent=2, ensure_ascii=False, allow_nan=False))
        return
    console = Terminal(highlight=False)
    for title, table in _overviews(evaluation):
        _print_uncut(title, table, "method")
    if per_object:
        for title, table in _by_object(evaluation):
            _print_uncut(title, table, "object")
    for line in (*_remarks(evaluation), *evaluation.notes):
        console.print(escape(line), soft_wrap=True)
    console.print(f"measured in {evaluation.seconds:.1f} s")


def covered_by(results: Path) -> Covered | None:
    """The frames of the batch that wrote a results.csv, failed ones too, and the objects that its session names.

    None where the file does not lie in a batch's folder, or where its frames.csv cannot be read.
    """
    folder = results.absolute().parent
    if results.name != "results.csv" or not is_batch_folder(folder):
        return None
    try:
        # Two columns of many: the rows are not checked as they are for the page.
        with reading(folder / "frames.csv") as raw, TextIOWrapper(raw, encoding="utf-8", newline="") as file:
            images = frozenset((int(row["scene_id"]), int(row["im_id"])) for row in csv.DictReader(file))
    except VerefineError:
        return None
    return Covered(images, _covered_objects(folder / SESSION_FILE))


def _covered_objects(session: Path) -> frozenset[int] | None:
    """What the session asks for; None = all, also where it cannot be read."""
    try:
        return frozenset(load_session(session).scene.objects) or None
    except VerefineError:
        return None


def _narrow_table(names: Sequence[str], numbers: Sequence[str]) -> Table:
    """A table without lines: ``names`` are the columns of texts, ``numbers`` those behind them."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in names:
        table.add_column(name, overflow="ellipsis", no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _print_uncut(title: str, table: Table, cut: str) -> None:
    """Prints a table; where the terminal is too narrow the column ``cut`` is shortened, never numbers: by what all
    its names begin and end with, and only then by what differs.

    Where even that is not enough, lines are longer than the terminal is wide.
    """
    console = Terminal(highlight=False)
    console.print(f"[italic]{escape(title)}[/]", soft_wrap=True)
    column = next(c for c in table.columns if c.header == cut)
    if cut == "method" and _width(console, table) > console.width:
        column._cells[:] = without_common_ends([str(cell) for cell in column.cells])
    too_wide = _width(console, table) - console.width
    if too_wide > 0:
        longest = max(cell_len(str(cell)) for cell in (column.header, *column.cells))
        column.max_width = max(longest - too_wide, min(longest, SHORTEST))
    Terminal(highlight=False, width=max(console.width, _width(console, table))).print(table)


def without_common_ends(names: Sequence[str]) -> list[str]:
    """Names without the words that all begin and end with, as in: …recommended…; unchanged where there is one name."""
    if len(set(names)) < 2:
        return list(names)
    words = [re.findall(r"[^-_/. ]+[-_/. ]*", name) for name in names]
    most = min(map(len, words)) - 1
    n_first = next((k for k in range(most) if len({w[k] for w in words}) > 1), most)
    n_last = next((k for k in range(most - n_first) if len({w[-1 - k] for w in words}) > 1), most - n_first)
    return [f"{'…' * bool(n_first)}{''.join(w[n_first : len(w) - n_last])}{'…' * bool(n_last)}" for w in words]


def _width(console: Terminal, table: Table) -> int:
    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum


def _overviews(evaluation: Evaluation) -> Iterator[tuple[str, Table]]:
    """Titles and tables: the official score, runs over fewer images before it, files that name fewer after it."""
    runs, files = (list(_own(evaluation, how)) for how in OWN)
    if runs:
        few = any(own and own.objects for own in evaluation.own)
        yield (
            _title(evaluation, OWN_OBJECTS if few else OWN["run"]),
            _overview(runs, ("images", "objects") if few else ("images",)),
        )
    n_targets, is_all = evaluation.scores[0].counts.targets, not runs and not files
    official = " (official score)" if evaluation.is_official else ""
    asked = f"{n_targets} targets" if is_all else f"all {n_targets} targets{official}"
    yield _title(evaluation, f"{evaluation.targets}, {asked}"), _overview([(score, ()) for score in evaluation.scores])
    if files:
        yield _title(evaluation, OWN["file"]), _overview(files, ("images",))


def _own(evaluation: Evaluation, how: str) -> Iterator[tuple[BopScores, tuple[str, ...]]]:
    """Scores over the part that is a file's own, and how many of all images and objects this holds."""
    for score, own, covered in zip(evaluation.scores, evaluation.own, evaluation.coverage, strict=True):
        if own is not None and score.own is not None and own.known_from == how:
            of = f"/{covered.objects_asked}" if covered.objects_asked else ""
            objects = "all" if own.objects is None else f"{len(own.objects)}{of}"
            yield score.own, (f"{len(own.images)}/{covered.images_asked}", objects)


def _title(evaluation: Evaluation, what: str) -> str:
    return f"{evaluation.dataset}/{evaluation.split}, {what}: {_measure(evaluation.scores[0])} [%]"


def _overview(shown: Sequence[tuple[BopScores, tuple[str, ...]]], about: tuple[str, ...] = ()) -> Table:
    """A row for each score; ``about`` names those of the cells beside it that are shown."""
    is_timed = any(score.mean_time_s >= 0 for score, _ in shown)
    heads = (*about, *_heads(shown[0][0]), "missing", *(["s/image"] if is_timed else []))
    table = _narrow_table(["method"], heads)
    for score, covered in shown:
        seconds = [f"{score.mean_time_s:.3g}" if score.mean_time_s >= 0 else "-"] if is_timed else []
        table.add_row(escape(score.name), *covered[: len(about)], *_numbers(score), str(score.counts.missing), *seconds)
    return table


def _measure(score: BopScores) -> str:
    return "average recall" if score.precision is None else "mean average precision"


def _heads(score: BopScores) -> tuple[str, ...]:
    if score.precision is not None:
        return "mAP", "MSSD", "MSPD", "MSSD 2-20 mm"
    return "AR", "VSD", "MSSD", "MSPD", "ADD(-S)", "r̄ °", "t̄ mm"


def _numbers(score: BopScores) -> list[str]:
    if score.precision is not None:
        return _precisions(score.precision)
    assert score.recalls is not None
    return [*_recalls(score.recalls), *_means(score)]


def _precisions(p: Precision) -> list[str]:
    return [_percent(x) for x in (p.map, p.mssd, p.mspd, p.mssd_mm)]


def _recalls(r: Recalls) -> list[str]:
    return [_percent(x) for x in (r.ar, r.ar_vsd, r.ar_mssd, r.ar_mspd)]


def _means(score: BopScores, obj_id: int | None = None) -> list[str]:
    answers = [a for a in score.answers if obj_id in (None, a.obj_id)]
    return [_percent(correct_share(answers)), *("-" if math.isnan(x) else f"{x:.1f}" for x in mean_errors(answers))]


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.1f}"


def _by_object(evaluation: Evaluation) -> Iterator[tuple[str, Table]]:
    """Titles and tables, one for each file; of a run over fewer images or objects, only over these."""
    for score, own, covered in zip(evaluation.scores, evaluation.own, evaluation.coverage, strict=True):
        if own is not None and score.own is not None and own.known_from == "run":
            only = "" if own.objects is None else f"object {', '.join(map(str, sorted(own.objects)))} in "
            what = f"{only}the {len(own.images)} of {covered.images_asked} images that the run covered"
            yield f"{score.name}, {what}: {_measure(score)} [%]", _objects(score.own, evaluation.names)
        else:
            yield f"{score.name}: {_measure(score)} [%]", _objects(score, evaluation.names)


def _objects(score: BopScores, names: dict[int, str]) -> Table:
    table = _narrow_table(["#", "object"], [*_heads(score), "targets" if score.precision else "missing"])
    for obj_id, precision in score.precision_by_object.items():
        numbers = *_precisions(precision), str(precision.n_targets)
        table.add_row(str(obj_id), escape(names.get(obj_id, "")), *numbers)
    for obj_id, recalls in score.recalls_by_object.items():
        missing = sum(a.row is None for a in score.answers if a.obj_id == obj_id)
        numbers = *_recalls(recalls), *_means(score, obj_id), f"{missing}/{recalls.n_targets}"
        table.add_row(str(obj_id), escape(names.get(obj_id, "")), *numbers)
    return table


def _remarks(evaluation: Evaluation) -> list[str]:
    """What should be known about each results file, a sentence each, and what the columns mean."""
    lines = []
    by_file = any(own is not None and own.known_from == "file" for own in evaluation.own)
    for score, covered, own in zip(evaluation.scores, evaluation.coverage, evaluation.own, strict=True):
        lines += [f"{score.name}: {what}" for what in (*_covered(covered, score), *_rows(score))]
        if by_file and own is None and not covered.is_complete:
            lines.append(
                f"{score.name}: has no row in the table about {OWN['file'].removeprefix('only ')}, as its run covered "
                "all images: where it has no estimate, it found nothing"
            )
    if evaluation.scores[0].task == "localization":
        lines.append(
            "ADD(-S): targets with less than 10 % of the diameter, over all vertices of the model (in frames.csv "
            "over points sampled on its surface, which differs by some percent); r̄, t̄: mean errors of those "
            "with a pose; missing: those without"
        )
    return lines


def _covered(covered: Coverage, score: BopScores) -> list[str]:
    """What a file has no estimates for, and which of its rows are no poses."""
    lines, counts = [], score.counts
    if not covered.is_complete or counts.missing:
        objects = f" and {covered.objects} of {covered.objects_asked} objects" if covered.objects_asked else ""
        lines.append(
            f"has estimates for {covered.images} of {covered.images_asked} images{objects} that the targets ask for, "
            f"{counts.answered} of {counts.targets} instances; a score over all of them counts the others as not found"
        )
    if covered.not_finite:
        lines.append(f"rows that hold NaN or infinity for a pose, and count as wrong: {covered.not_finite}")
    if covered.not_ranked:
        lines.append(
            f"rows without a number as score, so that which of several come first is chance: {covered.not_ranked}"
        )
    if covered.rounded:
        lines.append(
            f"rows whose R is a rounded rotation: {covered.rounded}; errors are measured with R as it is written, as "
            "the official ones are"
        )
    if covered.not_rigid:
        lines.append(f"rows whose R is no rotation: {covered.not_rigid}; errors are measured with R as it is written")
    return lines


def _rows(score: BopScores) -> list[str]:
    """What became of rows that were not scored."""
    counts, lines = score.counts, []
    if counts.unasked:
        ids = "scenes, images or objects that the targets do not name"
        lines.append(f"{counts.unasked} of {counts.rows} rows are about {ids}, and were ignored")
    if counts.surplus:
        limit = "the instances asked for" if score.task == "localization" else "the limit of an image"
        lines.append(f"{counts.surplus} rows beyond {limit} were left out, the lowest scores")
    return lines


def _evaluation_json(evaluation: Evaluation) -> dict[str, Any]:
    """All numbers of an evaluation; what is infinite or unknown is null, as is a score over an own part of all."""
    return {
        "dataset": evaluation.dataset,
        "split": evaluation.split,
        "targets": evaluation.targets,
        "notes": list(evaluation.notes),
        "seconds": evaluation.seconds,
        "results": [
            {
                "file": str(path),
                **_scores_json(score, evaluation.names),
                "coverage": asdict(covered),
                "own_images": _own_json(score, own, evaluation.names),
            }
            for path, score, covered, own in zip(
                evaluation.files, evaluation.scores, evaluation.coverage, evaluation.own, strict=True
            )
        ],
    }


def _scores_json(score: BopScores, names: dict[int, str]) -> dict[str, Any]:
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


def _own_json(score: BopScores, own: OwnPart | None, names: dict[int, str]) -> dict[str, Any] | None:
    """The score over what the file is about, where this is not all that is asked for."""
    if own is None or score.own is None:
        return None
    part = {"images": len(own.images), "only_objects": None if own.objects is None else sorted(own.objects)}
    return {"known_from": own.known_from, **part, **_scores_json(score.own, names)}


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


def _object_json(score: BopScores, obj_id: int, names: dict[int, str]) -> dict[str, Any]:
    answers = [a for a in score.answers if a.obj_id == obj_id]
    turn_deg, shift_mm = mean_errors(answers)
    return {
        "name": names.get(obj_id, ""),
        **_recalls_json(score.recalls_by_object[obj_id]),
        "mean_rotation_deg": _known(turn_deg),
        "mean_translation_mm": _known(shift_mm),
        "add_s_below_10_percent": _known(correct_share(answers)),
        "missing": sum(a.row is None for a in answers),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
