import re

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.algorithm_settings import IcpSettings
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.refiners.icp import Icp
from verefine_viz.refiners.registry import REFINERS, make_refiner


def test_icp_gets_the_sessions_settings_and_identity_changes_nothing() -> None:
    refiner = make_refiner("icp", Session(icp=IcpSettings(metric="plane", max_iterations=3)))
    assert isinstance(refiner, Icp)
    assert refiner.settings == IcpSettings(metric="plane", max_iterations=3)
    target = box_problem().targets[0]
    T = target.instance.hypotheses[0].T_cam_obj
    assert np.array_equal(make_refiner("identity", Session()).refine(target, T), T)


def test_an_unknown_name_lists_the_known_ones() -> None:
    said = f"unknown refiner 'ipc'; did you mean 'icp'? available: {', '.join(REFINERS)}"
    with pytest.raises(SettingsError, match=f"^{re.escape(said)}$"):
        make_refiner("ipc", Session())


# densefusion has no weights of its own: tests/refiners/test_densefusion.py.
def test_every_refiner_gives_a_rigid_pose() -> None:
    target = box_problem().targets[0]
    for name in sorted(REFINERS.keys() - {"densefusion"}):
        T = make_refiner(name, Session()).refine(target, target.instance.hypotheses[0].T_cam_obj)
        assert T.shape == (4, 4), name
        assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12), name
