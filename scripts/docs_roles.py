"""Makes links of the roles in docstrings, ``:class:`~verefine_viz.library.solving.Run```, for the reference."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROLE = re.compile(r":(?:class|func|meth|data|mod|attr):`(~?)([\w.]+)`")


class Roles(griffe.Extension):
    """A link where the reference has the name, else the name as code."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = ROLE.sub(lambda role: _link(obj, *role.groups()), obj.docstring.value)


def _link(obj: griffe.Object, tilde: str, name: str) -> str:
    try:
        target = obj.resolve(name)
    except griffe.NameResolutionError:
        target = name
    shown = name.rpartition(".")[2] if tilde else name
    return f'<autoref identifier="{target}" optional><code>{shown}</code></autoref>'
