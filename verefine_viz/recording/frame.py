"""What a recording holds before its first iteration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any

import rerun as rr

from verefine_viz.core.problem import Problem
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.background import background
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.graph import dependency_chunks
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece


def frame_chunks(
    about: Mapping[str, Any], problem: Problem, layout: Layout, drawing: Drawing, pictures: bool
) -> Iterator[Piece]:
    """Everything that is known before the first iteration; what makes the iterations readable comes first."""
    yield from property_chunks(about)
    yield from drawing.start()
    if problem.dependencies is not None and layout.is_scene:
        yield from dependency_chunks(problem.dependencies, layout)
    yield from background(problem, layout, pictures)


def property_chunks(about: Mapping[str, Any]) -> Iterator[Piece]:
    """What a recording is about as it holds it, and its name."""
    values = [_property(name, value) for name, value in about.items()]
    yield chunks.fixed_row(f"/__properties/{entities.PROPERTY}", values)
    name = f"{about['title']} {about['frame']} {about['method']}".strip()
    yield chunks.fixed_row("/__properties", [columns.text(_NAME, [name])])


_NAME = rr.archetypes.RecordingInfo.descriptor_name()


@lru_cache(maxsize=256)
def _property(name: str, value: int | str) -> columns.Column:
    """Most are the same for all frames of a batch."""
    return columns.one_value(rr.ComponentDescriptor(name), value)
