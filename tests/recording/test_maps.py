from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem, seen_at
from tests.recording.runs import enlarged, new_run, recorded_run, session
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.scores import PixelGrid, ScoreMaps
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.evaluation.pose_axes import N_AXES
from verefine_viz.methods.registry import make_method
from verefine_viz.recording import entities
from verefine_viz.recording.maps import MAP_NAMES, TILE_PX, compared
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile

KB = 1000


@dataclass(frozen=True)
class NoisyVerifier(FakeVerifier):
    """Its maps are as busy as a real sensor makes them: 2 mm of depth noise, 8° in the normals."""

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps:
        o, mask = target.observation, target.instance.mask
        rng = np.random.default_rng(int(abs(T_cam_obj[0, 3]) * 1e9))
        seen = np.where(mask, 1.0, np.nan)
        difference = (rng.normal(0, 0.002, mask.shape) * seen).astype(np.float32)
        angle = (np.abs(rng.normal(0, np.radians(8), mask.shape)) * seen).astype(np.float32)
        f_d = np.nan_to_num(1 - np.abs(difference) / 0.02).astype(np.float32)
        f_n = np.nan_to_num(np.cos(angle)).astype(np.float32)
        classes = np.where(mask, rng.choice([1, 2], mask.shape, p=[0.95, 0.05]), 0).astype(np.uint8)
        rendered = np.where(mask, 0.57, 0).astype(np.float32)
        maps = ScoreMaps(rendered, o.normals_cam, difference, angle, f_d, f_n, mask, classes)
        return maps if at is None else seen_at(maps, at)


def images(path: Path, entity: str) -> dict[int, np.ndarray]:
    """The images of a map by iteration: numbers, classes, or colours."""
    rows: dict[int, dict[str, Any]] = {}
    for chunk in chunks_of(path):
        if chunk.entity_path == entity and not chunk.is_static:
            rows |= {row["iteration"]: row for row in chunk.to_record_batch().to_pylist()}
    return {k: image(row) for k, row in rows.items()}


def image(row: dict[str, Any]) -> np.ndarray:
    if "EncodedImage:blob" in row:
        return np.asarray(Image.open(io.BytesIO(bytes(row["EncodedImage:blob"][0]))).convert("RGB"))
    kind, dtype = ("DepthImage", np.float16) if "DepthImage:buffer" in row else ("SegmentationImage", np.uint8)
    (size,) = row[f"{kind}:format"]
    return np.array(row[f"{kind}:buffer"][0], np.uint8).view(dtype).reshape(size["height"], size["width"])


def test_every_iteration_has_every_map_of_both_poses(tmp_path: Path) -> None:
    problem = box_problem(2, 2)
    one, blind = problem.instances
    blind = replace(blind, mask=np.zeros((60, 80), bool), points_cam=np.zeros((0, 3)))  # Shown in the whole image.
    run = recorded_run(tmp_path / "run.rrd", session(iterations=2), replace(problem, instances=(one, blind)))
    for name in MAP_NAMES:
        for when in entities.COMPARED:
            found = images(tmp_path / "run.rrd", entities.pose_map(name, when))
            assert sorted(found) == [i.index for i in run.iterations]
            assert {p.shape for p in found.values()} == {(TILE_PX, TILE_PX)}
    assert sorted(images(tmp_path / "run.rrd", entities.OBSERVED_COLOUR)) == [1, 5], "once per object"


def test_maps_hold_the_numbers_of_the_score(tmp_path: Path) -> None:
    s, problem, verifier = session(iterations=2), box_problem(1), NoisyVerifier()
    recorder = Recorder(tmp_path / "run.rrd", s, problem, lambda _: verifier)
    run = new_run(s, problem, (recorder,))
    run.finish()
    recorder.close()
    target, (first, *_) = problem.targets[0], run.iterations
    expected = {"difference": 1e3, "angle": np.degrees(1), "f_d": 1.0, "f_n": 1.0, "rendered": 1.0}
    for when, stage in zip(entities.COMPARED, compared(first), strict=True):
        maps = verifier.maps(target, stage.T_cam_obj)
        values = {
            "difference": maps.depth_difference_m, "angle": maps.angle_rad, "f_d": maps.f_d, "f_n": maps.f_n,
            "rendered": maps.rendered_m,
        }  # fmt: skip
        for name, factor in expected.items():
            drawn = images(tmp_path / "run.rrd", entities.pose_map(name, when))[1]
            shown = drawn[np.isfinite(drawn)]
            assert len(shown) > 100, name
            # Every pixel that is drawn is one of the map.
            there = np.unique((factor * values[name][maps.counted]).astype(np.float16))
            assert np.isin(shown, there).all(), name


def test_class_picture_shows_the_mask(tmp_path: Path) -> None:
    problem = box_problem(1)
    recorded_run(tmp_path / "run.rrd", session(iterations=1), problem)
    explained = images(tmp_path / "run.rrd", entities.pose_map("classes", "before"))[1] == 1
    v, u = np.nonzero(problem.instances[0].mask)
    side = 1.5 * max(np.ptp(v), np.ptp(u))
    assert explained.mean() == pytest.approx(len(v) / side**2, rel=0.1)
    # The object is in the middle of the cut-out.
    rows, columns = np.nonzero(explained)
    assert (rows.min() + rows.max()) / 2 == pytest.approx(TILE_PX / 2, abs=4)
    assert (columns.min() + columns.max()) / 2 == pytest.approx(TILE_PX / 2, abs=4)


def sizes(folder: Path, maps: bool, iterations: int) -> tuple[int, int]:
    """Bytes and iterations of a recording of one object at 640×480 with five hypotheses."""
    s, problem = session(iterations=iterations, maps=maps), enlarged(box_problem(5))
    assert problem.observation.camera.shape == (480, 640)
    verifier = NoisyVerifier()
    recorder = Recorder(folder / f"{iterations}.rrd", s, problem, lambda _: verifier)
    method = make_method(s.method, FakeSimulator(), FakeRefiner(), verifier, s.physics.steps)
    file = RunFile(folder / f"{iterations}.vfrun", s)
    run = Run(method, problem, (recorder, file))
    run.finish()
    recorder.close(file.path.read_bytes())
    return (folder / f"{iterations}.rrd").stat().st_size, run.length


@pytest.mark.usefixtures("long_run")
@pytest.mark.parametrize(("maps", "most"), [(True, 100 * KB), (False, 2 * KB)])
def test_an_iteration_is_small(tmp_path: Path, maps: bool, most: int) -> None:
    few, many = sizes(tmp_path, maps, 4), sizes(tmp_path, maps, 14)
    assert few[1] < many[1]
    assert 100 < (many[0] - few[0]) / (many[1] - few[1]) <= most


def test_maps_are_those_of_the_score_of_the_iteration(tmp_path: Path) -> None:
    seen: list[int] = []

    def verifier_of(index: int) -> FakeVerifier:
        seen.append(index)
        return FakeVerifier(ScoreSettings(tau_m=0.005 if index > 2 else 0.02))

    s, problem = session(iterations=1), box_problem(4)
    recorder = Recorder(tmp_path / "run.rrd", s, problem, verifier_of)
    new_run(s, problem, (recorder,)).finish()
    recorder.close()
    assert seen == [1, 2, 3, 4, 4]  # The last once more, for the score landscape at the end.
    # What the sensor saw is cut out once for each score that it is compared by.
    observed = [c for c in chunks_of(tmp_path / "run.rrd") if c.entity_path == entities.OBSERVED_COLOUR]
    assert len(observed) == 2


def test_the_score_around_the_answers_is_in_recordings_with_maps(tmp_path: Path) -> None:
    run = recorded_run(tmp_path / "with.rrd")
    recorded_run(tmp_path / "without.rrd", session(maps=False))
    drawn = {chunk.entity_path for chunk in chunks_of(tmp_path / "with.rrd")}
    for instance in run.problem.instances:
        name = entities.branch(instance, run.problem)
        assert {entities.landscape(name, k) for k in range(N_AXES)} <= drawn
        assert entities.landscape_words(name) in drawn
    for drawn_with_maps in (entities.LANDSCAPE, entities.MAPS):
        assert not any(c.entity_path.startswith(drawn_with_maps) for c in chunks_of(tmp_path / "without.rrd"))
