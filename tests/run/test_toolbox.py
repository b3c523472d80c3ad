"""The composition root: what changes is rebuilt, the rest is shared; edits and changes of a session are repeated."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from tests.fakes import box_problem
from tests.scenes.bop_folder import make
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.geometry import transform
from verefine_viz.core.settings import Change
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.instance_notes import within_reach

RAW: dict[str, Any] = {"scene": {"demo": "duck"}, "hypotheses": {"max_per_object": 2}, "method": {"iterations": 2}}


def test_what_does_not_change_is_shared() -> None:
    box = Toolbox(resolve(RAW))
    other = box.changed({"method": {"exploration": 0.3}})
    assert other.verifier is box.verifier
    assert other.simulator is box.simulator
    assert other.source is box.source
    assert box.changed({"score": {"tau_m": 0.01}}).verifier is not box.verifier
    assert box.changed({"physics": {"steps": 5}}).simulator is not box.simulator


@pytest.mark.usefixtures("processes")
def test_the_order_can_change_at_the_start_of_a_run_and_the_rest_is_kept() -> None:
    box = Toolbox(resolve({**RAW, "scene": {"demo": "stack"}, "physics": {"enabled": False}}))
    problem = box.problem("0/0")
    other = box.restarted({"dependency": {"order": (("#2", "#0", "#1"),)}, "method": {"exploration": 0.3}})
    assert other.source is box.source
    assert other.verifier is box.verifier
    reordered = other.ordered(problem)
    assert reordered.clusters == ((2, 0, 1),)
    assert reordered.instances is problem.instances
    assert any("seems to carry it" in note for note in reordered.notes)
    back = other.restarted({"dependency": {"order": ()}}).ordered(reordered)
    assert (back.notes, back.dependencies) == (problem.notes, problem.dependencies)
    for change, refused in ((box.changed, "dependency"), (box.changed, "scene"), (box.restarted, "scene")):
        with pytest.raises(SettingsError, match=f"'{refused}'"):
            change({refused: {}})


@pytest.mark.usefixtures("processes")
def test_a_session_repeats_a_fork_with_other_settings_and_a_moved_pose() -> None:
    box = Toolbox(resolve(RAW))
    problem = box.problem(box.frames[0])
    run = box.run(problem)
    run.finish()
    settings = {"method": {"exploration": 3.0}, "score": {"tau_m": 0.01}, "icp": {"max_iterations": 3}}
    T = np.array(problem.instances[0].hypotheses[1].T_cam_obj)
    fork = run.fork(2, method=box.changed(settings).method, edit=(problem.instances[0].instance_id, 1, T))
    fork.finish()
    change = Change(after_iteration=2, settings=settings)
    session = structs.replace(box.session, edits=fork.edits, changes=(change,))
    reopened = Toolbox(session)
    again = reopened.run(problem)
    again.finish()
    assert first_difference(fork.iterations, again.iterations) is None
    assert [reopened.verifier_of(k).settings.tau_m for k in (1, 2, 3, again.length)] == [0.02, 0.02, 0.01, 0.01]
    assert first_difference(run.iterations, again.iterations) is not None


@pytest.mark.usefixtures("processes")
def test_a_solid_that_is_not_as_it_was_asked_for_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    made_in_time = BulletSimulator.collider
    monkeypatch.setattr(BulletSimulator, "collider", lambda *given: replace(made_in_time(*given), took_too_long=True))
    notes = Toolbox(resolve(RAW)).problem("0/0").notes
    assert len([n for n in notes if n.startswith("object 2 (duck): physics takes it for its convex hull, ")]) == 1


def test_an_object_of_which_no_solid_can_be_made_is_left_out_and_the_others_go_on(tmp_path: Path) -> None:
    made = make(tmp_path)
    flat = made.root / "models" / "obj_000005.ply"
    flat.write_text(re.sub(r"(?m)^(-?[\d.]+) (-?[\d.]+) -?[\d.]+$", r"\1 \2 0", flat.read_text()))
    raw: dict[str, Any] = {
        "scene": {"source": "bop", "dataset": str(made.root), "model_points": 200},
        "method": {"iterations": 1},
    }
    box = Toolbox(resolve(raw))
    problem = box.problem(made.frame)
    assert [i.obj_id for i in problem.instances] == [2, 2]
    assert [n for n in problem.notes if n.startswith("object 5 is left out: ") and "physics.enabled = false" in n]
    assert [(one.instance_id, one.obj_id, one.is_unreadable) for one in problem.left_out] == [(1, 5, True)]
    assert all(best is not None for best in box.run(problem).finish().best)
    assert len(Toolbox(resolve({**raw, "physics": {"enabled": False}})).problem(made.frame).instances) == 3
    only_flat = resolve({**raw, "scene": {**raw["scene"], "objects": [5]}})
    with pytest.raises(InputError, match="7/3"):
        Toolbox(only_flat).problem(made.frame)


def test_hypotheses_out_of_reach_are_left_out_with_a_note() -> None:
    problem = box_problem(n_hypotheses=3)
    (instance,) = problem.instances
    far = [
        replace(h, T_cam_obj=transform(np.eye(3), [0, 0, z_m]))
        for h, z_m in zip(instance.hypotheses, (150, 9e3), strict=False)
    ]
    near = instance.hypotheses[2]
    left, (note,) = within_reach(replace(instance, hypotheses=(*far, near)), problem.models[1])
    assert left.hypotheses == (near,)
    assert "2 of its 3 poses" in note
    left, (note,) = within_reach(replace(instance, hypotheses=(far[1],)), problem.models[1])
    assert left.hypotheses == ()
    assert "1 of 1" in note
    assert within_reach(instance, problem.models[1]) == (instance, ())


def in_surroundings(**physics: object) -> Toolbox:
    return Toolbox(
        resolve({"scene": {"demo": "duck"}, "physics": {"support": "observed", "collider": "hull", **physics}})
    )


@pytest.mark.usefixtures("processes")
def test_observed_surroundings_come_and_go_with_a_restart():
    box = Toolbox(resolve({"scene": {"demo": "duck"}, "physics": {"collider": "hull"}}))
    problem = box.problem(box.frames[0])
    assert problem.observation.support.surroundings is None
    observed = box.restarted({"physics": {"support": "observed"}})
    around = observed.surrounded(problem)
    assert around.observation.support.surroundings is not None
    same = in_surroundings().problem(box.frames[0]).observation.support
    assert same.surroundings is not None
    assert first_difference(around.observation.support.surroundings, same.surroundings) is None
    back = box.restarted({"physics": {"support": "plane"}}).surrounded(around)
    assert first_difference(back.observation.support, problem.observation.support) is None


def test_another_world_needs_a_restart():
    box = in_surroundings()
    with pytest.raises(SettingsError, match=r"physics\.support"):
        box.changed({"physics": {"support": "plane"}})
    assert box.changed({"physics": {"steps": 5}}).session.physics.support == "observed"


@pytest.mark.usefixtures("processes")
def test_a_dropped_object_that_is_not_there_is_noted():
    box = in_surroundings(dropped=(("0/0", 7), ("0/1", 8)))
    notes = [note for note in box.problem("0/0").notes if note.startswith("physics.support")]
    assert len(notes) == 1
    assert "unknown object 7" in notes[0]
