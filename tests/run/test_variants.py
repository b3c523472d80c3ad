"""The other side's settings: what is changed is changed, the frame stays, and nonsense is refused in one line."""

from __future__ import annotations

import pytest
from msgspec import structs

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.presets import PRESETS
from verefine_viz.core.settings import Change, Edit, MethodSettings, Session
from verefine_viz.run.session_file import resolve
from verefine_viz.run.variants import scores_alike, settings_between, variant

SESSION = Session(title="mug", method=MethodSettings(name="rir", iterations=3, exploration=0.2))


def test_only_what_is_changed_differs() -> None:
    other = variant(SESSION, (("method.name", "sir"), ("score.tau_m", 0.01)))
    assert settings_between(SESSION, other) == (("method.name", "rir", "sir"), ("score.tau_m", 0.02, 0.01))
    assert settings_between(SESSION, variant(SESSION, ())) == ()
    assert not scores_alike(SESSION, other)
    assert scores_alike(SESSION, variant(SESSION, (("method.name", "sir"), ("score.renderer", "cpu"))))


def test_a_preset_sets_what_it_names_and_can_be_taken_back() -> None:
    published = variant(SESSION, (("preset", "published"),))
    assert published.preset == "published"
    for section, fields in PRESETS["published"].items():
        for name, value in fields.items():
            if section != "scene":  # Both sides show the same frame.
                assert getattr(getattr(published, section), name) == value
    assert published.scene == SESSION.scene
    assert (published.method.name, published.method.iterations) == ("rir", 3)
    assert published.score == resolve({"preset": "published"}).score
    back = variant(published, (("preset", "recommended"),))
    assert (back.score, back.hypotheses) == (resolve({}).score, resolve({}).hypotheses)
    assert back.method.exploration == MethodSettings().exploration


def test_one_preset_leaves_nothing_of_another() -> None:
    paper = variant(SESSION, (("preset", "paper"),))
    assert paper.score == resolve({"preset": "paper"}).score
    assert (paper.hypotheses.max_per_object, paper.method.iterations) == (3, 5)
    by_trimmed_icp = variant(paper, (("method.refiner", "trimmed_icp"), ("preset", "paper")))
    assert (by_trimmed_icp.hypotheses.max_per_object, by_trimmed_icp.physics.steps) == (25, 60)
    for one, other in (("paper", "published"), ("published", "paper"), ("paper", "recommended")):
        direct = variant(Session(), (("preset", other),))
        assert variant(variant(Session(), (("preset", one),)), (("preset", other),)) == direct


def test_a_field_given_beside_a_preset_wins_in_any_order() -> None:
    one = variant(SESSION, (("preset", "published"), ("score.tau_m", 0.03)))
    other = variant(SESSION, (("score.tau_m", 0.03), ("preset", "published")))
    assert one == other
    assert one.score.tau_m == 0.03


def test_it_starts_at_the_beginning() -> None:
    pose = tuple(float(x) for x in (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
    way = {
        "edits": (Edit(after_iteration=1, instance=0, hypothesis=0, T_cam_obj=pose),),
        "changes": (Change(after_iteration=2, settings={"method": {"exploration": 0.5}}),),
    }
    other = variant(structs.replace(SESSION, **way), ())
    assert (other.edits, other.changes) == ((), ())


def test_nonsense_is_refused_by_its_name() -> None:
    for name, value, named in (
        ("method.nme", "sir", "'nme'"),
        ("scene.demo", "box", "'scene'"),
        ("method", "sir", "'method'"),
        ("preset", "best", "'best'"),
        ("method.iterations", 0, "method.iterations"),
    ):
        with pytest.raises(SettingsError, match=named):
            variant(SESSION, ((name, value),))
