"""Verifiers, each test with all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec
import pytest

from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import gl_problem
from verefine_viz.rendering.gl_verifier import GlVerifier

MakeVerifier = Callable[..., CpuVerifier | GlVerifier]


@pytest.fixture(scope="module")
def needs_gl() -> None:
    problem = gl_problem()
    if problem:
        pytest.skip(problem)


@pytest.fixture(scope="module", params=["cpu", "gl"])
def make(request: pytest.FixtureRequest) -> Iterator[MakeVerifier]:
    """Makes one verifier for fields of the settings; every triangle is kept unless said otherwise."""
    if request.param == "gl":
        request.getfixturevalue("needs_gl")
    made: dict[str, CpuVerifier | GlVerifier] = {}

    def verifier(**fields: object) -> CpuVerifier | GlVerifier:
        settings = msgspec.convert({"simplify_mm": 0.0, **fields}, ScoreSettings)
        key = msgspec.json.encode(settings)
        if key not in made:
            made[key] = CpuVerifier(settings) if request.param == "cpu" else GlVerifier(settings)
        return made[key]

    yield verifier
    for v in made.values():
        if isinstance(v, GlVerifier):
            v.close()
