"""Colliders are built once per test run, outside the user's cache."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.physics.bodies import ring
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import Collider, collider
from verefine_viz.physics.simulator import BulletSimulator


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("colliders")


@pytest.fixture(scope="session")
def simulator(cache: Path) -> BulletSimulator:
    """One simulator for all tests: that its past does not matter is part of what is tested."""
    return BulletSimulator(PhysicsSettings(), cache)


@pytest.fixture(scope="session")
def hollow_ring(processes: None, cache: Path) -> Collider:
    """A ring that CoACD took apart."""
    return collider(ring(), "decomposition", cache)
