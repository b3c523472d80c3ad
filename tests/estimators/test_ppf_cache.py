"""Tables on disk: loaded where they are whole, made again where they are not, and never a reason to fail."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.estimators.views import random_pose, view
from tests.progress import asked, cancelled_everywhere, ending_after, hearing
from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.errors import Cancelled
from verefine_viz.core.problem import Target
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.estimators.ppf import Ppf
from verefine_viz.estimators.ppf_model import LEARNT_FROM, PpfModel, cache_file, learn, read, write
from verefine_viz.scenes.demo_models import demo_model

COARSE = PpfSettings(step=0.1)


def same(a: PpfModel, b: PpfModel) -> bool:
    return all(np.array_equal(x, y) for x, y in zip((*a.table, *a.field), (*b.table, *b.field), strict=True))


def target() -> Target:
    model = demo_model("bracket", 10, 0)
    return view(model, random_pose(0, model))


def with_array(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[bytes], bytes]:
    """A whole file in which one array is not what it should be."""

    def damage(data: bytes) -> bytes:
        with np.load(io.BytesIO(data)) as kept:
            arrays = dict(kept)
        arrays[name] = change(arrays[name])
        out = io.BytesIO()
        np.savez(out, **arrays)
        return out.getvalue()

    return damage


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "no archive": lambda data: b"nothing of the sort" * 100,
    "cut off": lambda data: data[: len(data) // 2],
    "a bit turned": lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:],
    "pickled": with_array("first", lambda a: np.array([{}], dtype=object)),
    "points beyond the model": with_array("first", lambda a: a + 60_000),
    "bins that end before they begin": with_array("starts", lambda a: a[::-1]),
    "too few turns": with_array("turn_rad", lambda a: a[:-1]),
    "not a number": with_array("weights", lambda a: a * np.nan),
    "other precision": with_array("points", lambda a: a.astype(np.float32)),
    "more bins than there are": with_array("n_angles", lambda a: a + 1),
}


def learnt_in(said: list[str]) -> list[str]:
    return [words for words in said if words.startswith("Learning")]


def test_a_damaged_table_is_made_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    seen = target()
    first = Ppf(COARSE, tmp_path).hypotheses(seen, 3)
    path = cache_file(seen.model, COARSE, tmp_path)
    whole = path.read_bytes()
    for damage, damaged in DAMAGES.items():
        path.write_bytes(damaged(whole))
        said: list[str] = []
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            again = Ppf(COARSE, tmp_path).hypotheses(seen, 3, hearing(said))
        assert [h.T_cam_obj.tobytes() for h in again] == [h.T_cam_obj.tobytes() for h in first], damage
        assert learnt_in(said) == ["Learning the point pairs of bracket."], damage
        assert path.name in caplog.text, damage
        assert path.read_bytes() == whole, damage


def test_a_table_is_learnt_once(tmp_path: Path) -> None:
    said: list[str] = []
    seen = target()
    ppf = Ppf(COARSE, tmp_path)
    for _ in range(2):
        ppf.hypotheses(seen, 1, hearing(said))
    Ppf(COARSE, tmp_path).hypotheses(seen, 1, hearing(said))
    assert learnt_in(said) == ["Learning the point pairs of bracket."]
    assert [p.name for p in tmp_path.iterdir()] == [cache_file(seen.model, COARSE).name]


def test_nothing_is_kept_of_a_table_whose_learning_is_cancelled_and_the_next_is_the_same(tmp_path: Path) -> None:
    seen = target()
    Ppf(COARSE, tmp_path / "whole").hypotheses(seen, 3)
    table = cache_file(seen.model, COARSE, tmp_path / "whole")

    def work(progress: ProgressToken) -> object:
        return learn(seen.model, COARSE, progress)

    for k in cancelled_everywhere(work, asked(work)):
        ppf = Ppf(COARSE, tmp_path / "stopped")
        with pytest.raises(Cancelled):
            ppf.hypotheses(seen, 3, ending_after(k + 1))  # It is asked once before it learns.
        assert not (tmp_path / "stopped").exists()
    ppf.hypotheses(seen, 3)
    assert cache_file(seen.model, COARSE, tmp_path / "stopped").read_bytes() == table.read_bytes()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    learnt = learn(demo_model("duck", 10, 0), COARSE)
    write(tmp_path / "table.npz", learnt)
    again = read(tmp_path / "table.npz")
    assert again is not None
    assert same(again, learnt)


def test_a_table_belongs_to_its_mesh_and_settings(tmp_path: Path) -> None:
    changed = {"step": 0.09, "distance_bin": 0.06, "angle_bin_deg": 11.0, "bin_limit": 50, "seed": 1}
    assert set(changed) == set(LEARNT_FROM)
    duck, bracket = demo_model("duck", 10, 0), demo_model("bracket", 10, 0)
    others = [structs.replace(COARSE, **{name: value}) for name, value in changed.items()]
    files = [cache_file(duck, s, tmp_path) for s in (COARSE, *others)] + [cache_file(bracket, COARSE, tmp_path)]
    assert len(set(files)) == len(files)
    assert cache_file(duck, structs.replace(COARSE, candidates=7), tmp_path) == files[0]


def test_without_a_place_to_write_it_only_takes_longer(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    seen = target()
    assert len(Ppf(COARSE, tmp_path / "file").hypotheses(seen, 3)) == len(Ppf(COARSE, tmp_path).hypotheses(seen, 3)) > 0
