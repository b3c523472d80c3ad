"""The scores of results files as JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from verefine_viz.evaluation.averages import Precision, Recalls
from verefine_viz.evaluation.bop_scores import BopScores
from verefine_viz.evaluation.matched_estimates import correct_share, mean_errors
from verefine_viz.evaluation.pose_table import OwnPart
from verefine_viz.evaluation.results_scores import Evaluation


def evaluation_json(evaluation: Evaluation) -> dict[str, Any]:
    """All numbers of an evaluation; infinite and unknown ones are null."""
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
    """The score over the part that the file is about, where that is less than all targets; else None."""
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
