"""What stands behind the # of the page's address: frame, object, iteration, and the run of a page that has several.

``frame=3/120&object=2&iteration=17``; objects are named as in session files: by ``object``, the id of its model, or by
``instance`` where a frame holds the object twice.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

from verefine_viz.core.errors import InputError, quoted, unknown

if TYPE_CHECKING:
    from verefine_viz.viewer.state.state import State


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
    run: str = ""
    """Folder of a batch run; empty = the one that is open."""

    @property
    def text(self) -> str:
        """Without the #."""
        named = {name: value for name, value in asdict(self).items() if value not in ("", None)}
        return "&".join(f"{name}={quote(str(value), safe='/')}" for name, value in named.items())


NAMES = tuple(field.name for field in fields(PageLink))
_NUMBERS = ("object", "instance", "iteration")


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


def link_of(state: State) -> PageLink:
    """The link to what is shown; without an object where the page follows the one that an iteration works on."""
    space, options, browsing = state.workspace, state.options, state.browsing
    obj_ids = {i.instance_id: i.obj_id for i in space.work.problem.instances}
    obj_id = obj_ids.get(options.focus) if options.focus is not None else None
    is_single = list(obj_ids.values()).count(obj_id) == 1 if obj_id is not None else False
    return PageLink(
        frame=space.frame,
        object=obj_id if is_single else None,
        instance=None if is_single or obj_id is None else options.focus,
        iteration=space.run.cursor,
        run=browsing.run if browsing.gallery is not None and browsing.gallery.has_several_runs else "",
    )
