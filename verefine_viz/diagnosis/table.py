"""Causes of many frames as a table: causes.csv, and how often each was the main one."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from verefine_viz.diagnosis.causes import TITLES, Cause, Diagnosis
from verefine_viz.diagnosis.diagnose import THRESHOLD, diagnose
from verefine_viz.session.toolbox import Toolbox

COLUMNS = (
    "scene_id", "im_id", "instance_id", "cause", "title", "is_confirmed", "sentence", "others", "n_reruns", "evidence",
)  # fmt: skip


def diagnose_frame(toolbox: Toolbox, frame: str, threshold: float = THRESHOLD) -> tuple[Diagnosis, ...]:
    """Why the instances of one frame failed, after running the session's method on it once more.

    Runs depend on the session only, so that this explains a batch that is long over.
    """
    run = toolbox.run(toolbox.problem(frame))
    run.finish()
    return diagnose(run, toolbox, threshold)


def causes_csv(found: Mapping[str, Sequence[Diagnosis]]) -> str:
    """The text of causes.csv: a row per failed instance, frames ("scene/image") in the order given.

    ``others`` are causes with a space between, ``evidence`` is a JSON object.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for frame, diagnoses in found.items():
        scene_id, _, im_id = frame.partition("/")
        for d in diagnoses:
            others = " ".join(str(f.cause) for f in d.others)
            # JSON has no infinity, which is the error of no answer at all.
            known = {name: float(f"{value:.6g}") for name, value in d.evidence.items() if math.isfinite(value)}
            evidence = json.dumps(known)
            facts = (d.cause, TITLES[d.cause], int(d.is_confirmed), d.sentence, others, d.n_reruns, evidence)
            writer.writerow((scene_id, im_id, d.instance_id, *facts))
    return text.getvalue()


def counted(diagnoses: Iterable[Diagnosis]) -> dict[Cause, int]:
    """How often each cause was the main one, the most frequent first; none that never was."""
    counts = Counter(d.cause for d in diagnoses)
    order = list(Cause)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], order.index(item[0]))))
