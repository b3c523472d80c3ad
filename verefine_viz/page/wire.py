"""What all that goes down to a browser is made of: messages, answers to wants, and the parts of both.

A struct is written as a JSON object with a key for each field; ``from_`` is the key ``from``. ``make messages`` writes
``web/messages.d.ts`` and the tables of ``docs/page.md`` from these classes and their docstrings.
"""

from __future__ import annotations

from msgspec import Struct

from verefine_viz.core.arrays import Float
from verefine_viz.page.protocol import Pose

__all__ = ["Answer", "Message", "Part", "Pose", "pose_numbers"]


def _key(field: str) -> str:
    """Return the key of a field: Python's reserved words end in an underscore there."""
    return field.removesuffix("_")


class Part(Struct, frozen=True, forbid_unknown_fields=True, rename=_key):
    """A part of a message or an answer."""


class Message(Part, frozen=True, tag_field="t", tag=lambda name: name.removesuffix("Message").lower()):
    """What a window gets without having asked for it; ``t`` is its type."""


class Answer(Part, frozen=True, tag_field="what", tag=lambda name: name.removesuffix("Answer").lower()):
    """What a want, or ``evaluate``, asked for; ``what`` is what."""


def pose_numbers(T_cam_obj: Float) -> Pose:
    """Return a pose (4, 4) as 16 numbers by rows, bit for bit."""
    return tuple(T_cam_obj.ravel().tolist())
