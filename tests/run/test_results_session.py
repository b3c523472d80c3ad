"""Results files that are opened by themselves: the data set near them, its split, and the frames that have poses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError
from verefine_viz.page.openable import read_openable
from verefine_viz.run.built_in_sessions import built_in_sessions, named_session
from verefine_viz.run.data_folder import data_at, open_session
from verefine_viz.scenes.results_csv import ResultRow, write_results
from verefine_viz.scenes.source import open_scene


def write(path: Path, *frames: tuple[int, int]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    T = np.eye(4)
    T[2, 3] = 0.5
    write_results(path, [ResultRow(*frame, 2, 0.9, T) for frame in frames])
    return path


@pytest.mark.parametrize("place", ["net_made-test.csv", "made/out/a.csv", "results/x/a.csv"])
def test_the_data_set_near_a_results_file_is_opened(place: str, tmp_path: Path) -> None:
    make(tmp_path / "made")
    known = data_at(write(tmp_path / place, (7, 3), (99, 1)), {})
    assert known is not None
    source = open_scene(known.session.scene, known.session.hypotheses)
    assert source.frames == ("7/3",)
    (posed,) = (i for i in source.problem("7/3").instances if i.hypotheses)
    assert posed.obj_id == 2
    assert np.allclose(posed.hypotheses[0].T_cam_obj[2, 3], 0.5)


def test_the_name_of_the_file_chooses_between_data_sets(tmp_path: Path) -> None:
    for name in ("aaa", "made"):
        make(tmp_path / name)
    for name in ("aaa", "made"):
        session = open_session(write(tmp_path / f"net_{name}-test.csv", (7, 3)), {})
        assert Path(session.scene.dataset).name == name


def test_without_a_data_set_the_line_says_what_to_add(tmp_path: Path) -> None:
    path = write(tmp_path / "a" / "b" / "c" / "d.csv", (7, 3))
    make(tmp_path / "made")
    with pytest.raises(InputError, match=str(path)):
        open_session(path, {})
    assert open_session(path, {"scene": {"dataset": str(tmp_path / "made")}}).scene.frames == ("7/3",)
    far = write(tmp_path / "made" / "e.csv", (8, 3))
    with pytest.raises(InputError, match="has none of its frames"):
        open_session(far, {"scene": {"dataset": str(tmp_path / "made")}})


def test_a_scene_with_other_images_and_a_folder_without_models_are_read_past(tmp_path: Path) -> None:
    place = tmp_path / "a" / "b"  # Two levels above it lie the folders of other tests.
    make(place / "made")
    make(place / "aaa")
    (place / "aaa" / "models").rename(place / "aaa" / "gone")
    with pytest.raises(InputError, match=r"images 3, .* image 0"):
        open_session(write(place / "a.csv", (7, 0)), {})
    assert open_session(write(place / "b.csv", (7, 3)), {}).scene.frames == ("7/3",)


def test_a_folder_above_that_may_not_be_listed_is_read_past(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path / "a" / "made")
    path, listed = write(tmp_path / "a" / "net.csv", (7, 3)), Path.iterdir

    def refused(self: Path) -> Iterator[Path]:
        if self == tmp_path:
            raise PermissionError(13, "Permission denied", str(self))
        return listed(self)

    monkeypatch.setattr(Path, "iterdir", refused)
    assert open_session(path, {}).scene.frames == ("7/3",)


# Sessions that come with the package are opened by their names.


def test_a_name_is_a_session_and_a_file_of_that_name_goes_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert {"mug", "clutter", "ycbv"} <= built_in_sessions().keys()
    for name in ("mug", "clutter"):
        assert open_session(Path(name), {}).scene.demo == name
        assert read_openable(Path(name)).session.scene.demo == name
    (tmp_path / "mug").mkdir()
    assert named_session(Path("mug")) == Path("mug")
    assert named_session(Path("x/clutter")) == Path("x/clutter")
    with pytest.raises(InputError, match=r"did you mean 'mug'.* clutter, "):
        named_session(Path("muk"))
