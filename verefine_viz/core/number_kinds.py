"""Kinds of numbers in what is decoded, with their bounds."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

Id = Annotated[int, Meta(ge=-(2**53), le=2**53)]
Index = Annotated[int, Meta(ge=0, le=2**31 - 1)]
"""The number of an object, an instance, a hypothesis, an iteration."""
Seed = Annotated[int, Meta(ge=0, le=2**32 - 1)]
"""Seed of a random generator."""
Real = Annotated[float, Meta(ge=-1e300, le=1e300)]
"""A finite number."""
Share = Annotated[float, Meta(ge=0, le=1)]
