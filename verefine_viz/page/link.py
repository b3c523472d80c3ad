"""What stands behind the # of the page's address: frame, object, iteration, branch, and a run of several.

``frame=3/120&object=2&iteration=17``; objects are named as in session files: by ``object``, the id of its model, or by
``instance`` where a frame holds the object twice.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from urllib.parse import quote, unquote

from verefine_viz.core.errors import InputError, quoted, unknown


@dataclass(frozen=True)
class PageLink:
    """What a link opens; what it does not name stays as it is."""

    frame: str = ""
    """scene/image; empty = the one that is open."""
    object: int | None = None
    """obj_id."""
    instance: int | None = None
    """instance_id."""
    iteration: int | None = None
    branch: int | None = None
    """Number of a branch of the program that is running; None = the first run."""
    run: str = ""
    """Folder of a batch run; empty = the one that is open."""

    @property
    def text(self) -> str:
        """Without the #."""
        named = {name: value for name, value in asdict(self).items() if value not in ("", None)}
        return "&".join(f"{name}={quote(str(value), safe='/')}" for name, value in named.items())


NAMES = tuple(field.name for field in fields(PageLink))
_NUMBERS = ("object", "instance", "iteration", "branch")


def read_link(text: str) -> PageLink:
    """The link that :attr:`PageLink.text` wrote, or that the user typed.

    Raises:
        InputError: it names something else, or a number is none.
    """
    values: dict[str, str | int] = {}
    for part in filter(None, text.removeprefix("#").split("&")):
        name, _, value = part.partition("=")
        if name not in NAMES:
            raise InputError(f"link #{_short(text)}: {unknown('part', unquote(name), NAMES)}")
        given = unquote(value)
        if name not in _NUMBERS:
            values[name] = given
            continue
        if not (given.isascii() and given.isdigit() and len(given) < 10):
            raise InputError(f"link #{_short(text)}: {name} is {quoted(given)}, expected a number such as 17")
        values[name] = int(given)
    return PageLink(**values)  # type: ignore[arg-type]


def _short(text: str) -> str:
    return text.removeprefix("#")[:80]
