"""Why objects of a frame came out wrong, written into their rows."""

from __future__ import annotations

from verefine_viz.batch.rows import FrameResult
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.session.engine import Run
from verefine_viz.session.toolbox import Toolbox


def with_causes(result: FrameResult, run: Run, toolbox: Toolbox) -> FrameResult:
    """``result`` with ``cause`` and ``evidence`` in the rows of objects that failed and whose true pose is known.

    Where the data of such a frame do not fit together, that is said as well.
    """
    doubts = result.doubts
    try:
        diagnoses = diagnose(run, toolbox)
        found: dict[int | None, tuple[str, str]] = {d.instance_id: (str(d.cause), d.sentence) for d in diagnoses}
        # Those of the frame stand in each.
        doubts = diagnoses[0].doubts if diagnoses else doubts
    except Exception as error:
        # The answers are there all the same.
        why = f"no diagnosis: {type(error).__name__}: {error}"
        found = {row.instance_id: ("", why) for row in result.objects if row.has_truth and row.is_correct is not True}
    rows = []
    for row in result.objects:
        cause, sentence = found.get(row.instance_id, ("", ""))
        rows.append(row.model_copy(update={"cause": cause, "evidence": " ".join(sentence.split())}))
    return result.model_copy(update={"objects": tuple(rows), "doubts": doubts})
