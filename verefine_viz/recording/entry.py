"""An iteration as bytes, in the journal and in the recording: msgpack, field by field as in ``core.records``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args, get_origin

import cattrs
import numpy as np
import ormsgpack

from verefine_viz.core.arrays import Float, frozen
from verefine_viz.core.errors import ShapeError, in_one_line
from verefine_viz.core.records import Iteration
from verefine_viz.core.simulated import Contacts, SimulatedPath, Tipping

NO_CONTACTS = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Entry:
    """What is kept of an iteration: nothing that is shown has to be computed again."""

    iteration: Iteration
    """Read back, every number is the run's, bit by bit, but for its simulated path: that is there to be drawn, in
    single precision and with the contacts of the last step alone."""
    errors: Float
    """(3,) against ground truth: rotation [deg] and translation [mm] of the kept pose, ADD(-S) of the best pose [mm];
    NaN where there is no ground truth."""
    packed: bytes
    """Both as msgpack."""

    @staticmethod
    def of(iteration: Iteration, errors: Float) -> Entry:
        """The run waits for this, so as little as possible is made on the way."""
        kept = {**vars(iteration), "path": None if iteration.path is None else _kept(iteration.path)}
        packed = ormsgpack.packb((kept, errors), np.ndarray.tolist, ormsgpack.OPT_SERIALIZE_NUMPY)
        return Entry(iteration, errors, packed)

    @staticmethod
    def read(packed: bytes) -> Entry:
        """
        Raises:
            ValueError: it is not what :meth:`of` made.
        """
        try:
            kept, errors = ormsgpack.unpackb(packed)
            return Entry(_converter().structure(kept, Iteration), frozen(errors, "errors", (3,)), packed)
        except cattrs.BaseValidationError as error:
            raise ValueError(f"not an iteration: {in_one_line(cattrs.transform_error(error)[0])}") from None
        except (TypeError, KeyError, ShapeError) as error:
            raise ValueError(f"not an iteration: {error}") from None


def as_recorded(iteration: Iteration) -> Iteration:
    """The iteration as it is read back from a recording."""
    return Entry.read(Entry.of(iteration, np.zeros(3)).packed).iteration


def _kept(path: SimulatedPath) -> dict[str, Any]:
    Ts = path.Ts_cam_obj.astype(np.float32)
    return {"Ts_cam_obj": Ts, "contacts": path.contacts[-1:], "tipping": path.tipping}


@cache
def _converter() -> cattrs.Converter:
    """From plain values to records."""
    converter = cattrs.Converter()
    converter.register_structure_hook_func(lambda kind: get_origin(kind) is np.ndarray, _array)
    converter.register_structure_hook(Contacts, _contacts)
    converter.register_structure_hook(SimulatedPath, _path)
    return converter


def _array(values: Any, kind: Any) -> np.ndarray:
    """As its annotation says: ``NDArray[np.float64]`` is an array of any shape and of that type."""
    _, dtype = get_args(kind)
    return np.array(values, get_args(dtype)[0])


def _path(values: Mapping[str, Any], _: Any) -> SimulatedPath:
    """With contacts for every step, as a run has them."""
    poses, last = values["Ts_cam_obj"], [_contacts(contacts, Contacts) for contacts in values["contacts"]]
    contacts = (NO_CONTACTS,) * (len(poses) - 1 - len(last)) + tuple(last)
    tipping = values.get("tipping")
    return SimulatedPath(np.array(poses), contacts, None if tipping is None else Tipping(**tipping))


def _contacts(values: Mapping[str, Any], _: Any) -> Contacts:
    """Plain values do not say how wide an empty array is."""
    return Contacts(
        np.reshape(values["points_cam"], (-1, 3)),
        np.reshape(values["normals_cam"], (-1, 3)),
        values["depths_m"],
        values["forces_n"],
        values["others"],
    )
