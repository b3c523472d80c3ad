"""Objects across groups: recall of each object model by group, and the objects that most groups get wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from verefine_viz.batch.rows import ObjectRow
from verefine_viz.report.groups import Group
from verefine_viz.report.loaded import Key, key

MOST_HARD = 40
"""Objects that are listed as hard."""


@dataclass
class Share:
    """How many of some answers are right."""

    right: int = 0
    n: int = 0

    def add(self, is_right: bool) -> None:
        self.right += is_right
        self.n += 1

    @property
    def value(self) -> float | None:
        """In [0, 1]; None of none."""
        return self.right / self.n if self.n else None


@dataclass(frozen=True)
class HeatRow:
    """One object model."""

    obj_id: int
    name: str
    total: Share
    by_group: tuple[Share, ...]


@dataclass
class Instance:
    """One object of one frame over all groups and seeds."""

    row: ObjectRow
    """One of its rows, for names."""
    total: Share
    by_group: dict[str, Share] = field(default_factory=dict)
    causes: Counter[str] = field(default_factory=Counter)

    @property
    def frame(self) -> str:
        return self.row.frame

    @property
    def wrong_groups(self) -> int:
        """Groups that get it wrong with most seeds."""
        return sum(2 * share.right < share.n for share in self.by_group.values())

    @property
    def best(self) -> tuple[str, Share]:
        """The group that gets it right most often."""
        return max(self.by_group.items(), key=lambda item: item[1].value or 0.0)

    @property
    def cause(self) -> str:
        """The most frequent one; empty where none is known."""
        return self.causes.most_common(1)[0][0] if self.causes else ""


def heat(groups: Sequence[Group]) -> tuple[HeatRow, ...]:
    """Recall of each object model, by group in their order; only objects with ground truth."""
    found: dict[int, HeatRow] = {}
    for k, group in enumerate(groups):
        for run in group.runs:
            for row in run.with_truth:
                if row.obj_id is not None:
                    fresh = HeatRow(row.obj_id, row.name, Share(), tuple(Share() for _ in groups))
                    mine = found.setdefault(row.obj_id, fresh)
                    mine.total.add(row.is_correct is True)
                    mine.by_group[k].add(row.is_correct is True)
    return tuple(found[obj_id] for obj_id in sorted(found))


def by_frame(groups: Sequence[Group]) -> dict[Key, Instance]:
    """Each object of each frame over all groups and seeds; only objects with ground truth."""
    found: dict[Key, Instance] = {}
    for group in groups:
        for run in group.runs:
            for row in run.with_truth:
                hard = found.setdefault(key(row), Instance(row, Share()))
                hard.total.add(row.is_correct is True)
                hard.by_group.setdefault(group.name, Share()).add(row.is_correct is True)
                if row.cause:
                    hard.causes[row.cause] += 1
    return found


def hardest(objects: Iterable[Instance]) -> tuple[Instance, ...]:
    """Those that most groups get wrong with most seeds, the hardest first."""
    most = [hard for hard in objects if 2 * hard.wrong_groups > len(hard.by_group)]
    return tuple(sorted(most, key=lambda hard: (-hard.wrong_groups, hard.total.value or 0.0, key(hard.row))))
