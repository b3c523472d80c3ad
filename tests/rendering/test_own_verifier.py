"""Verifiers of other programs: poses are scored by a stand-in, and all else goes on as with Eq. 1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.test_own_refiner import make_recording
from tests.fakes import box_problem
from verefine_viz import cli
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, ShapeError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.settings import EQ_1, ScoreSettings, Session
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.landscape import landscape
from verefine_viz.page.protocol import Fork, MapsWanted, RunVerb
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.pixel_maps import maps
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.registry import VERIFIERS, make_verifier
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

OWN = ScoreSettings(verifier="own")


class Wrapped:
    """Eq. 1, as if it were another program's: it gives the score alone."""

    def __init__(self, settings: ScoreSettings) -> None:
        self._eq_1 = CpuVerifier(settings)

    def scores(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Float:
        return self._eq_1.score(target, Ts_cam_obj, placed).score


class Nearness:
    """How near each pose is to ground truth; keeps what was placed."""

    def __init__(self) -> None:
        self.placed: list[tuple[int, ...]] = []

    def scores(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Float:
        self.placed.append(tuple(p.instance_id for p in placed))
        assert target.instance.T_cam_obj_gt is not None
        apart = np.linalg.norm(Ts_cam_obj[:, :3, 3] - target.instance.T_cam_obj_gt[:3, 3], axis=1)
        return np.exp(-apart / 0.01)


@pytest.fixture(autouse=True)
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(VERIFIERS, "own", Wrapped)


def session(method: str = "rir", verifier: str = "own", **more: Any) -> Session:
    settings = {"score": {"verifier": verifier}, "method": {"name": method, "refiner": "icp", "iterations": 2}}
    return resolve(settings | {"hypotheses": {"max_per_object": 2}} | more)


def poses_of(settings: Session) -> list[tuple[str, bytes, float]]:
    """The accepted pose of every iteration, with its score."""
    toolbox = Toolbox(settings)
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    accepted = [(i.accepted, next(s for s in i.stages if s.name == i.accepted)) for i in run.iterations]
    return [(name, s.T_cam_obj.tobytes(), s.score.score if s.score else -1.0) for name, s in accepted]


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("method", ["sir", "rir"])
def test_the_same_scores_give_the_same_run(method: str) -> None:
    renderer = {"renderer": "cpu"}
    theirs = poses_of(session(method, score={"verifier": "own"} | renderer))
    assert theirs == poses_of(session(method, score={"verifier": EQ_1} | renderer))
    assert len(theirs) >= 2


@pytest.mark.usefixtures("processes")
def test_whole_scenes_are_the_mean_over_their_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    nearness = Nearness()
    monkeypatch.setitem(VERIFIERS, "own", lambda settings: nearness)
    verifier, problem = make_verifier(OWN), box_problem(n_hypotheses=2, n_instances=3)
    targets = problem.targets[:2]
    Ts = np.array([[t.instance.hypotheses[k].T_cam_obj for t in targets] for k in (0, 1, 0)])
    other = Placed(2, problem.targets[2].model, problem.targets[2].instance.hypotheses[0].T_cam_obj)
    scores = verifier.score_scene(targets, Ts, (other,))
    assert {*nearness.placed} == {(2, 1), (2, 0)}, "what is placed, and the other object of the scene"
    alone = [verifier.score(t, Ts[:, i]).score for i, t in enumerate(targets)]
    assert np.allclose(scores.score, np.mean(alone, axis=0))
    assert scores.score[0] == scores.score[2]
    with pytest.raises(ShapeError, match=r"combinations to score have shape \(3, 2, 4\), expected n×2×4×4"):
        verifier.score_scene(targets, Ts[..., 0])


@pytest.mark.usefixtures("processes")
def test_it_solves_whole_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(VERIFIERS, "own", lambda settings: Nearness())
    settings = session("vf_depth", scene={"demo": "stack"}, physics={"enabled": False})
    toolbox = Toolbox(settings)
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    for i, (target, best) in enumerate(zip(run.problem.targets, run.state.best, strict=True)):
        initial = run.state.initial[i]
        assert best is not None
        assert initial is not None
        assert best.score.score >= initial.score.max()
        assert target.instance.T_cam_obj_gt is not None


def test_a_score_has_no_parts_and_no_maps() -> None:
    (target,), verifier = box_problem().targets, make_verifier(OWN)
    T = target.instance.hypotheses[0].T_cam_obj
    score = verifier.score(target, T[None])[0]
    assert (score.has_parts, score.undefined, score.n_pixels) == (False, False, 0)
    assert score.n_rendered > 0
    assert CpuVerifier(ScoreSettings()).score(target, T[None])[0].has_parts
    assert verifier.maps(target, T) is None
    assert verifier.scene_maps([target], T[None]) is None
    assert verifier.begin(target, T[None]) is None
    outside = transform(T[:3, :3], [50.0, 0, 1])
    assert verifier.score(target, outside[None])[0].n_rendered == 0, "an event says that it is not seen"


@pytest.mark.parametrize(("given", "shape"), [([0.5, 0.5], "(2,)"), (0.5, "()"), ([[0.5]], "(1, 1)")])
def test_another_number_of_scores_is_refused(given: object, shape: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong:
        def scores(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Any:
            return given

    monkeypatch.setitem(VERIFIERS, "own", lambda settings: Wrong())
    (target,) = box_problem().targets
    with pytest.raises(ShapeError) as caught:
        make_verifier(OWN).score(target, target.instance.hypotheses[0].T_cam_obj[None])
    assert str(caught.value) == f"verifier own gave scores of shape {shape} for 1 poses"


def test_what_is_not_a_number_counts_as_0(monkeypatch: pytest.MonkeyPatch) -> None:
    class Nan:
        def scores(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Float:
            return np.full(len(Ts_cam_obj), np.nan)

    monkeypatch.setitem(VERIFIERS, "own", lambda settings: Nan())
    (target,) = box_problem().targets
    score = make_verifier(OWN).score(target, target.instance.hypotheses[0].T_cam_obj[None])[0]
    assert (score.score, score.undefined) == (0.0, True)


def test_an_unknown_name_lists_them() -> None:
    with pytest.raises(SettingsError) as caught:
        make_verifier(ScoreSettings(verifier="owm"))
    assert str(caught.value) == "unknown verifier 'owm'; did you mean 'own'? available: eq_1, own"


@pytest.mark.usefixtures("processes")
def test_the_score_around_a_pose_is_its_own_and_its_noise_that_of_images() -> None:
    toolbox = Toolbox(session())
    (target,) = toolbox.problem(toolbox.frames[0]).targets
    assert target.instance.T_cam_obj_gt is not None
    T_gt, eq_1 = target.instance.T_cam_obj_gt, CpuVerifier(ScoreSettings())
    theirs = landscape(toolbox.verifier, target, allowed_poses(toolbox.verifier, target, T_gt))
    ours = landscape(eq_1, target, allowed_poses(eq_1, target, T_gt))
    assert theirs.score == ours.score
    for one, other in zip(theirs.curves, ours.curves, strict=True):
        assert np.array_equal(one.scores, other.scores)
        # Two poses' scores are taken to share nothing of the noise, so that more is undetermined, not less.
        assert one.extent.width >= 0.5 * other.extent.width
    assert 0.2 < theirs.allowed.undetermined_mm / ours.allowed.undetermined_mm < 10


@pytest.mark.usefixtures("processes")
def test_the_page_steps_it_beside_eq_1_and_says_that_it_has_no_maps() -> None:
    debugger = Debugger(Workspace(session(verifier=EQ_1), None, Toolbox)).carry_out([RunVerb()])
    debugger.carry_out([Fork(branch=0, k=0, changes={"score.verifier": "own"}), RunVerb(branch=1)])
    eq_1, own = (debugger.space.branch(k).run.iterations for k in (0, 1))
    assert len(own) == len(eq_1)
    # Eq. 1 under another name, so the poses are the same.
    assert own[-1].best.T_cam_obj.tobytes() == eq_1[-1].best.T_cam_obj.tobytes()
    T = tuple(own[-1].best.T_cam_obj.ravel().tolist())
    obj = debugger.space.problem.instances[0].instance_id
    assert maps(debugger.space, MapsWanted(0, 1, obj, T), debugger.blobs).arrays
    with pytest.raises(InputError, match=r"^own gives a score, and no maps of it\.$"):
        maps(debugger.space, MapsWanted(1, 1, obj, T), debugger.blobs)


@pytest.mark.usefixtures("processes")
def test_it_is_recorded_without_maps_and_replayed_through_its_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.rrd"
    make_recording(path, session())
    assert not [chunk for chunk in chunks_of(path) if chunk.entity_path.startswith(entities.MAPS)]
    assert cli.main(["replay", str(path), "--verify"]) == 0
    assert "no difference" in capsys.readouterr().out
    monkeypatch.delitem(VERIFIERS, "own")
    assert cli.main(["replay", str(path), "--verify"]) == 2
    assert capsys.readouterr().err == (
        f"verefine-viz: recording {path} was made with the verifier 'own', which this program does not have (it has "
        f'eq_1); verify it through the program that does, as in docs/guide.md, "Your own verifier": python PROGRAM.py '
        f"replay {path} --verify\n"
    )
