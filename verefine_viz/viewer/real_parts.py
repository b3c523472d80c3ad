"""What the page needs of simulator, renderer and refiners; imported late, since it is heavy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

from verefine_viz.core.patience import Patience
from verefine_viz.core.settings import Session
from verefine_viz.viewer.tools import Tools


def real_parts(
    patience: Patience,
) -> tuple[Callable[[Session], Tools], Callable[..., Any], Callable[..., Any], tuple[str, ...]]:
    """The toolbox, the checks of plausibility and overlap, and the built-in scenes."""
    from verefine_viz.physics.overlap import overlap
    from verefine_viz.physics.plausibility import plausibility
    from verefine_viz.physics.proximity import Surfaces
    from verefine_viz.scenes.demo import demo_names
    from verefine_viz.session.toolbox import Toolbox

    surfaces = Surfaces()
    make_tools = cast(Callable[[Session], Tools], partial(Toolbox, patience=patience))
    checks = partial(plausibility, surface_of=surfaces, patience=patience), partial(overlap, surface_of=surfaces)
    return make_tools, *checks, tuple(demo_names())
