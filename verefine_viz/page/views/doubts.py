"""Doubts about the data of the open frame, as badges, and what puts them right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from verefine_viz.core.data_remedies import AS_READ, changes_between, on_top
from verefine_viz.page.frame_messages import DoubtShown

if TYPE_CHECKING:
    from verefine_viz.core.doubt import Doubt
    from verefine_viz.page.branch import Branch


def shown_doubts(branch: Branch) -> list[DoubtShown]:
    """Return the doubts about the data as badges."""
    return [
        DoubtShown(one.kind, one.title, one.text, one.instances, one.picture, _changes(one, branch) or None)
        for one in branch.doubts()
    ]


def as_read(branch: Branch) -> dict[str, Any]:
    """Return the settings with which data are as they were read; none where they are."""
    return changes_between(branch.tools.session.data, AS_READ)


def _changes(one: Doubt, branch: Branch) -> dict[str, Any]:
    """Return the settings that would put the data right; none where no settings do."""
    now = branch.tools.session.data
    then = None if one.remedy is None else on_top(now, one.remedy)
    return {**({} if then is None else changes_between(now, then)), **one.other_settings}
