"""Built-in scenes written out as a BOP folder, and results files made from its ground truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.scenes.write_bop import write_bop
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.evaluation.ground_truth import BopGroundTruth, GtInstance, Targets, find_targets, read_targets
from verefine_viz.evaluation.pose_table import PoseTable, pose_table
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.scenes.hypothesis_pool import perturbed
from verefine_viz.scenes.results_csv import ResultRow

FRAMES = (("clutter", "0/0"), ("clutter", "0/1"), ("bowl", "0/0"), ("stack", "0/0"))


@dataclass(frozen=True)
class DemoSet:
    """The folder, and what is in it."""

    folder: Path
    problems: tuple[Problem, ...]
    truth: BopGroundTruth
    targets: Targets

    @property
    def asked(self) -> list[tuple[int, int, GtInstance]]:
        """All instances of the targets; no object is there twice."""
        return [
            (scene_id, im_id, truth)
            for (scene_id, im_id), counts in self.targets.counts.items()
            for truth in self.truth.image(scene_id, im_id, with_depth=False).instances
            if truth.obj_id in counts
        ]

    def rows(
        self, pose: Callable[[int, GtInstance], Float], score: Callable[[int], float] = lambda k: 1.0
    ) -> list[ResultRow]:
        """A row for each instance asked for: ``pose`` gives its (4, 4) [m]."""
        return [
            ResultRow(scene_id, im_id, truth.obj_id, score(k), pose(k, truth), 0.5)
            for k, (scene_id, im_id, truth) in enumerate(self.asked)
        ]

    def symmetric(self, k: int, truth: GtInstance) -> Float:
        """Another pose that looks the same, where there is one."""
        symmetries = self.truth.model(truth.obj_id).symmetries_mm
        T = np.array(symmetries[(7 * k + 1) % len(symmetries)])
        T[:3, 3] *= 1e-3
        return T_of(truth) @ T


def make(folder: Path) -> DemoSet:
    settings = SceneSettings(model_points=200, cloud_points=100)
    hypotheses = HypothesesSettings(max_per_object=1)
    problems = tuple(
        replace(demo_problem(name, settings, hypotheses, frame), scene_id=3 + k // 2, im_id=k)
        for k, (name, frame) in enumerate(FRAMES)
    )
    write_bop(folder, problems)
    dataset = BopDataset(folder, "test")
    return DemoSet(folder, problems, BopGroundTruth(dataset), read_targets(find_targets(folder, "test")))


def T_of(truth: GtInstance) -> Float:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = truth.R, truth.t_mm * 1e-3
    return T


def perfect(k: int, truth: GtInstance) -> Float:
    return T_of(truth)


def disturbed(k: int, truth: GtInstance) -> Float:
    """A little for the first instances, more and more for later ones."""
    return perturbed(T_of(truth), 1, 2.0 * k, 2.0 * k, (k,))[0].T_cam_obj


def table(rows: Iterable[ResultRow], name: str = "method") -> PoseTable:
    return pose_table(name, list(rows))
