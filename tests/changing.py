"""Changes of frozen records, be they dataclasses or msgspec structs."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from msgspec import Struct, structs

Record = TypeVar("Record")


def replace(record: Record, **changes: Any) -> Record:
    """Return a record with some of its fields replaced."""
    is_struct = isinstance(record, Struct)
    return structs.replace(record, **changes) if is_struct else dataclasses.replace(record, **changes)  # type: ignore
