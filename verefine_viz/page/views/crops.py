"""What a learned refiner saw and answered in an iteration: answer to the want ``crops``."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from PIL import Image

from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import CropsAnswer, RefinerStepShown
from verefine_viz.page.blobs import Blobs
from verefine_viz.run.iteration_words import refiner_name

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Workspace


def crops(space: Workspace, want: p.CropsWanted, blobs: Blobs) -> CropsAnswer:
    """Return the refiner's steps in an iteration: a picture and words each; ``empty`` says why there are none.

    Raises:
        InputError: there is no such iteration.
    """
    from verefine_viz.pictures.refiner_crops import start_words, step_picture, step_words

    branch = space.branch(want.branch)
    iteration = branch.iteration(want.k)
    target = branch.run.problem.target(iteration.instance_id)
    k, name = iteration.index, refiner_name(branch.settings.method.refiner)
    refiner, start = branch.refiner_of(k), iteration.before_refined
    if not isinstance(refiner, LearnedRefiner):
        return CropsAnswer(k, f"{name} is not learned: it sees points, no pictures.", refiner=name)
    if start is None:
        return CropsAnswer(k, f"Iteration {k} did not refine.", refiner=name)
    steps = branch.evaluator_of(k).refiner_steps(refiner, target, start.T_cam_obj)
    return CropsAnswer(
        k,
        "" if steps else "The object does not show in the picture: the refiner saw nothing.",
        [
            RefinerStepShown(f"/blob/{blobs.put(_png(step_picture(step)), 'image/png')}", step_words(step))
            for step in steps
        ],
        name,
        start_words(refiner, target, start.T_cam_obj),
    )


def _png(picture: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "png", compress_level=1)
    return out.getvalue()
