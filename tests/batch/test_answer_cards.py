"""Cards of answers: what they can be filtered, searched and sorted by, and that page and report have the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.report.runs import row
from verefine_viz.batch.answer_cards import choices_of, places_of, values_of
from verefine_viz.batch.answer_tags import TAGS_FILE, TagFile, answer_key, read_tags, save_tags
from verefine_viz.batch.index import ORDERS
from verefine_viz.core.errors import InputError

ROWS = (
    row(1, 0, add_s_mm=40.0, score=0.8, cause="pool", evidence="The nearest starts 80° away.", ms_total=3.0),
    row(2, 1, undetermined_deg=25.0, ms_total=90.0),
    row(3, 0, status="no_answer", add_s_mm=None, score=None, message="No hypothesis."),
    row(4, 1, has_truth=False, add_s_mm=None, undetermined_deg=40.0),
)
CAUSE = "no good hypothesis in the pool"


def test_every_order_has_a_place_for_every_answer() -> None:
    places = places_of(ROWS)
    assert all(sorted(place[order] for place in places) == [0, 1, 2, 3] for order in ORDERS)

    def in_order(order: str) -> list[int]:
        return [r.im_id for _, r in sorted(zip((p[order] for p in places), ROWS, strict=True))]  # type: ignore[index]

    assert in_order("error") == [3, 1, 2, 4]
    assert in_order("time")[0] == 2
    assert in_order("undetermined") == [4, 2, 1, 3]


def test_a_filter_is_there_where_it_leaves_a_choice() -> None:
    assert [by for by, _, _ in choices_of([values_of(r) for r in ROWS])] == ["result", "cause", "object"]
    assert choices_of([values_of(ROWS[1])]) == []


@pytest.mark.parametrize(
    "damaged", ["", "{", "[]", '{"tags": 3}', '{"labels": {}}', '{"filters": {"a": {"order": "x"}}}']
)
def test_a_damaged_file_of_tags_is_one_clear_line(tmp_path: Path, damaged: str) -> None:
    (tmp_path / TAGS_FILE).write_text(damaged)
    with pytest.raises(InputError, match=r"tags\.json is damaged \(.*\); mend it, or delete it") as caught:
        read_tags(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file")
    with pytest.raises(InputError, match=r"cannot write .*tags\.json: .*run is a file, not a folder"):
        save_tags(tmp_path / "run", TagFile())


def test_tags_come_back_as_they_were_saved(tmp_path: Path) -> None:
    assert read_tags(tmp_path) == TagFile()
    content = TagFile(tags={answer_key(ROWS[0]): ("glänzend", "b")})
    save_tags(tmp_path, content)
    assert read_tags(tmp_path) == content
    assert [path.name for path in tmp_path.iterdir()] == [TAGS_FILE]
