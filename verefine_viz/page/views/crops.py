"""What a learned refiner saw and answered in an iteration: answer to the want ``crops``."""

from __future__ import annotations

import io
from typing import Any

from PIL import Image

from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.moment import moment_of
from verefine_viz.page.words import refiner_name
from verefine_viz.page.workspace import Workspace


def crops(space: Workspace, want: p.CropsWanted, blobs: Blobs) -> dict[str, Any]:
    """Return the refiner's steps in the latest iteration up to k that worked on the object: a picture and words each.

    Of a finished run's answer it is the iteration that made it. ``empty`` says why there are no steps.
    """
    from verefine_viz.pictures.refiner_crops import start_words, step_picture, step_words

    branch = space.branch(want.branch)
    is_answer = branch.run.is_done and want.k == branch.run.length > 0
    moment = moment_of(branch, p.Look(branch=want.branch, k=want.k, obj=want.obj, answer=is_answer))
    iteration = moment.iteration
    if is_answer and (answer := moment.object(want.obj).answer) is not None and answer.iteration:
        iteration = branch.run.iterations[answer.iteration - 1]
    if iteration is None:
        return {"k": None, "empty": "Nothing was refined yet.", "steps": []}
    refiner, start = branch.refiner_of(iteration.index), iteration.before_refined
    none = {"k": iteration.index, "refiner": refiner_name(branch.settings.method.refiner), "steps": []}
    if not isinstance(refiner, LearnedRefiner):
        return none | {"empty": f"{none['refiner']} is not learned: it sees points, no pictures."}
    if start is None:
        return none | {"empty": f"Iteration {iteration.index} did not refine."}
    steps = moment.evaluator.refiner_steps(refiner, moment.target, start.T_cam_obj)
    return none | {
        "empty": "" if steps else "The object does not show in the picture: the refiner saw nothing.",
        "start": start_words(refiner, moment.target, start.T_cam_obj),
        "steps": [
            {"url": f"/blob/{blobs.put(_png(step_picture(step)), 'image/png')}", "words": step_words(step)}
            for step in steps
        ],
    }


def _png(picture: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "png", compress_level=1)
    return out.getvalue()
