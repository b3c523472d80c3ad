"""Rows as columns that are not drawn: float64 poses and scores bit by bit, for reading back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from operator import attrgetter
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.row import Row
from verefine_viz.recording.scene_parts import ALONE, Flat, SceneParts, flat_of, parts_of

INTEGERS = ("instance_id", "obj_id", "arm", "arm_iteration", "best_arm", "best_iteration")
"""Kept together in the column ``ids``, in this order."""
ARRAYS: Mapping[str, tuple[Any, tuple[int, ...]]] = {
    "scores": (np.float64, (-1, 3)),
    "pixels": (np.int64, (-1, 7)),
    "best_score": (np.float64, (3,)),
    "best_pixels": (np.int64, (7,)),
    "contacts": (np.float32, (-1, 9)),
    "choice": (np.float64, (4, -1)),
    "errors": (np.float64, (3,)),
    "ms": (np.float32, (-1,)),
}
POSES: Mapping[str, Any] = {"Ts_cam_obj": np.float64, "T_best": np.float64, "path": np.float32}
"""Kept as the upper three rows of each matrix."""
TEXTS = ("stages", "event_kinds", "event_texts")
WORDS = ("accepted", "best_stage", "reason")
"""Kept together in the column ``words``, in this order."""


def exact(rows: Sequence[Row]) -> Piece:
    """Rows as one chunk of :data:`entities.EXACT`."""
    sent = [columns.numbers(_named("ids"), np.array([_integers(r) for r in rows]), np.int64)]
    sent += [columns.numbers(_named(n), _upper([getattr(r, n) for r in rows]), t) for n, t in POSES.items()]
    sent += [columns.numbers(_named(n), [getattr(r, n) for r in rows], t) for n, (t, _) in ARRAYS.items()]
    sent += [columns.texts(_named(n), [getattr(r, n) for r in rows]) for n in TEXTS]
    sent.append(columns.texts(_named("words"), [[getattr(r, n) for n in WORDS] for r in rows]))
    if any(r.parts is not ALONE for r in rows):
        flat = [flat_of(r.parts) for r in rows]
        sent.append(columns.numbers(_named("scene_ids"), [f.ids for f in flat], np.int64))
        sent.append(columns.numbers(_named("scene_poses"), _upper([np.array(f.poses) for f in flat]), np.float64))
        sent.append(columns.numbers(_named("scene_numbers"), [f.numbers for f in flat], np.float64))
        sent.append(columns.texts(_named("scene_texts"), [f.texts for f in flat]))
    return chunks.rows_of(entities.EXACT, [r.index for r in rows], sent)


_integers = attrgetter(*INTEGERS)


def _upper(poses: Sequence[NDArray[Any]]) -> columns.Ragged:
    """Rows of poses (…, 4, 4) each, without the last row of any."""
    full = np.concatenate(poses, axis=None).reshape(-1, 4, 4)
    return columns.Ragged([12 * (T.size // 16) for T in poses], full[:, :3])


def row_from(index: int, values: Mapping[str, Any]) -> Row:
    """The row that :func:`exact` wrote.

    Raises:
        KeyError, ValueError, IndexError, TypeError: a column is missing or holds something else.
    """
    got: dict[str, Any] = {"index": index}
    got |= {n: int(v) for n, v in zip(INTEGERS, values["ids"], strict=True)}
    got |= {n: np.asarray(values[n], t).reshape(shape) for n, (t, shape) in ARRAYS.items() if n != "choice"}
    choice = np.asarray(values["choice"], np.float64)
    got["choice"] = choice.reshape(4, len(choice) // 4)
    got |= {name: _full(values[name], dtype) for name, dtype in POSES.items()}
    got["T_best"] = got["T_best"][0]
    got |= {n: tuple(str(t) for t in values[n]) for n in TEXTS}
    got |= {n: str(v) for n, v in zip(WORDS, values["words"], strict=True)}
    got["parts"] = _parts(values)
    return Row(**{f.name: got[f.name] for f in fields(Row)})


def _parts(values: Mapping[str, Any]) -> SceneParts:
    """Nothing where the columns are missing: recordings of single objects do not have them."""
    ids = [int(i) for i in _given(values, "scene_ids")]
    poses = list(_full(_given(values, "scene_poses"), np.float64))
    numbers = [float(x) for x in _given(values, "scene_numbers")]
    return parts_of(Flat(ids, poses, numbers, [str(t) for t in _given(values, "scene_texts")]))


def _given(values: Mapping[str, Any], name: str) -> Any:
    found = values.get(name)
    return () if found is None else found


def _full(upper: Any, dtype: Any) -> NDArray[Any]:
    """Poses (n, 4, 4) of the upper rows of each, one after another."""
    rows = np.asarray(upper, dtype).reshape(-1, 3, 4)
    full = np.zeros((len(rows), 4, 4), dtype)
    full[:, :3], full[:, 3, 3] = rows, 1
    return full


def _named(name: str) -> rr.ComponentDescriptor:
    return rr.ComponentDescriptor(f"{entities.PROPERTY}:{name}")
