"""Prints the scores of results files: tables with remarks, or JSON."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path

from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.index import is_batch_folder
from verefine_viz.commands.score_json import evaluation_json
from verefine_viz.core.console import PrintedTable, ProgressBar, print_table
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.files import reading
from verefine_viz.core.text_format import say
from verefine_viz.evaluation.averages import Precision, Recalls
from verefine_viz.evaluation.bop_scores import BopScores
from verefine_viz.evaluation.matched_estimates import correct_share, mean_errors
from verefine_viz.evaluation.pose_table import Coverage, Covered
from verefine_viz.evaluation.results_scores import Evaluation, evaluate_files
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.annotations import Task

OWN = {"run": "only the images that each run covered", "file": "only the images that each file names"}
"""Words for the images of a score that does not cover all targets, by how these images are known."""
OWN_OBJECTS = "only the images and objects that each run was to solve"
"""Heading where a run was to solve only some objects."""


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
    """Score the files and print the result.

    Raises:
        VerefineError: a file or the data set cannot be used.
    """
    with ProgressBar("images") as bar:
        evaluation = evaluate_files(
            files,
            dataset,
            split,
            targets,
            task,
            workers,
            lambda done, total: bar.show("images", done, total),
            covered_by,
            sensor,
        )
    if as_json:
        say(json.dumps(evaluation_json(evaluation), indent=2, ensure_ascii=False, allow_nan=False))
        return
    for table in (*_overviews(evaluation), *(_by_object(evaluation) if per_object else ())):
        print_table(table)
    for line in (*_remarks(evaluation), *evaluation.notes):
        say(line)
    say(f"measured in {evaluation.seconds:.1f} s")


def covered_by(results: Path) -> Covered | None:
    """The frames, failed ones included, of the batch that wrote a results.csv, and the objects that its session names.

    None where the file does not lie in a batch's folder, or where its frames.csv cannot be read.
    """
    folder = results.absolute().parent
    if results.name != "results.csv" or not is_batch_folder(folder):
        return None
    try:
        # Only two of many columns are read, without the checks that the page makes.
        with reading(folder / "frames.csv") as raw, TextIOWrapper(raw, encoding="utf-8", newline="") as file:
            images = frozenset((int(row["scene_id"]), int(row["im_id"])) for row in csv.DictReader(file))
    except VerefineError:
        return None
    return Covered(images, _covered_objects(folder / SESSION_FILE))


def _covered_objects(session: Path) -> frozenset[int] | None:
    """The objects that a session asks for; None = all, or the session cannot be read."""
    try:
        return frozenset(load_session(session).scene.objects) or None
    except VerefineError:
        return None


def _overviews(evaluation: Evaluation) -> Iterator[PrintedTable]:
    """The tables: runs over fewer images, the official score, then files that name fewer images."""
    runs, files = (list(_own(evaluation, how)) for how in OWN)
    if runs:
        few = any(own and own.objects for own in evaluation.own)
        title = _title(evaluation, OWN_OBJECTS if few else OWN["run"])
        yield _overview(title, runs, ("images", "objects") if few else ("images",))
    n_targets, is_all = evaluation.scores[0].counts.targets, not runs and not files
    official = " (official score)" if evaluation.is_official else ""
    asked = f"{n_targets} targets" if is_all else f"all {n_targets} targets{official}"
    yield _overview(_title(evaluation, f"{evaluation.targets}, {asked}"), [(score, ()) for score in evaluation.scores])
    if files:
        yield _overview(_title(evaluation, OWN["file"]), files, ("images",))


def _own(evaluation: Evaluation, how: str) -> Iterator[tuple[BopScores, tuple[str, ...]]]:
    """Scores over the part that a file covers, and how many of all images and objects that is."""
    for score, own, covered in zip(evaluation.scores, evaluation.own, evaluation.coverage, strict=True):
        if own is not None and score.own is not None and own.known_from == how:
            of = f"/{covered.objects_asked}" if covered.objects_asked else ""
            objects = "all" if own.objects is None else f"{len(own.objects)}{of}"
            yield score.own, (f"{len(own.images)}/{covered.images_asked}", objects)


def _title(evaluation: Evaluation, what: str) -> str:
    return f"{evaluation.dataset}/{evaluation.split}, {what}: {_measure(evaluation.scores[0])} [%]"


def _overview(
    title: str, shown: Sequence[tuple[BopScores, tuple[str, ...]]], about: tuple[str, ...] = ()
) -> PrintedTable:
    """A table with a row for each score; ``about`` names the cells beside a score that are shown."""
    is_timed = any(score.mean_time_s >= 0 for score, _ in shown)
    headings = ("method", *about, *_heads(shown[0][0]), "missing", *(["s/image"] if is_timed else []))
    rows = list[tuple[str, ...]]()
    for score, covered in shown:
        seconds = [f"{score.mean_time_s:.3g}" if score.mean_time_s >= 0 else "-"] if is_timed else []
        numbers = *covered[: len(about)], *_numbers(score), str(score.counts.missing), *seconds
        rows.append((score.name, *numbers))
    return PrintedTable(title, headings, tuple(rows))


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


def _by_object(evaluation: Evaluation) -> Iterator[PrintedTable]:
    """A table by object for each file; a run over fewer images or objects is scored over these only."""
    for score, own, covered in zip(evaluation.scores, evaluation.own, evaluation.coverage, strict=True):
        if own is not None and score.own is not None and own.known_from == "run":
            only = "" if own.objects is None else f"object {', '.join(map(str, sorted(own.objects)))} in "
            what = f"{only}the {len(own.images)} of {covered.images_asked} images that the run covered"
            yield _objects(f"{score.name}, {what}: {_measure(score)} [%]", score.own, evaluation.names)
        else:
            yield _objects(f"{score.name}: {_measure(score)} [%]", score, evaluation.names)


def _objects(title: str, score: BopScores, names: dict[int, str]) -> PrintedTable:
    headings = ("#", "object", *_heads(score), "targets" if score.precision else "missing")
    rows = list[tuple[str, ...]]()
    for obj_id, precision in score.precision_by_object.items():
        numbers = *_precisions(precision), str(precision.n_targets)
        rows.append((str(obj_id), names.get(obj_id, ""), *numbers))
    for obj_id, recalls in score.recalls_by_object.items():
        missing = sum(a.row is None for a in score.answers if a.obj_id == obj_id)
        numbers = *_recalls(recalls), *_means(score, obj_id), f"{missing}/{recalls.n_targets}"
        rows.append((str(obj_id), names.get(obj_id, ""), *numbers))
    return PrintedTable(title, headings, tuple(rows), n_words=2)


def _remarks(evaluation: Evaluation) -> list[str]:
    """Remarks on each results file, a sentence each, and what the columns mean."""
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
    """Remarks on what a file has no estimates for, and on rows that are no poses."""
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
    """Remarks on rows that were not scored."""
    counts, lines = score.counts, []
    if counts.unasked:
        ids = "scenes, images or objects that the targets do not name"
        lines.append(f"{counts.unasked} of {counts.rows} rows are about {ids}, and were ignored")
    if counts.surplus:
        limit = "the instances asked for" if score.task == "localization" else "the limit of an image"
        lines.append(f"{counts.surplus} rows beyond {limit} were left out, the lowest scores")
    return lines
