"""Verifiers by name: Eq. 1, and those of other programs, which only score poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError, ShapeError, UnavailableError, unknown
from verefine_viz.core.geometry import apply, as_poses
from verefine_viz.core.own_parts import NO_PARTS, Lender, OwnParts
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.protocols import PoseScorer, Verifier
from verefine_viz.core.scores import PIXEL_CLASSES, PixelGrid, Scores
from verefine_viz.core.settings import EQ_1, ScoreSettings

VERIFIERS: dict[str, Callable[[ScoreSettings], PoseScorer]] = {}
"""Beside Eq. 1. A new one is a class with ``scores`` (core.protocols.PoseScorer) and a line here; docs/guide.md, "Your
own verifier"."""


def verifier_names() -> tuple[str, ...]:
    """What ``score.verifier`` may be."""
    return (EQ_1, *VERIFIERS)


def make_verifier(
    settings: ScoreSettings, progress: ProgressToken = NEVER_CANCELLED, own: OwnParts = NO_PARTS
) -> Verifier:
    """The verifier that the settings ask for; ``auto`` takes the CPU rasteriser where OpenGL has no GPU,
    else what was measured to be faster, for few poses and for many apart.

    Args:
        settings: of the score.
        progress: asked where the mesh of a model has to be made.
        own: parts of the caller, preferred to others of the same name.

    Raises:
        SettingsError: no verifier has that name; lists those that exist.
        UnavailableError: ``renderer = "gl"``, and there is no usable OpenGL.
    """
    if settings.verifier in own.verifiers:
        return ScoringVerifier(settings, own.verifiers[settings.verifier])
    if settings.verifier != EQ_1:
        if settings.verifier not in VERIFIERS:
            raise SettingsError(unknown("verifier", settings.verifier, verifier_names()))
        return ScoringVerifier(settings, VERIFIERS[settings.verifier](settings))
    from verefine_viz.rendering import auto_renderer, gl_context
    from verefine_viz.rendering.cpu_verifier import CpuVerifier
    from verefine_viz.rendering.gl_verifier import GlVerifier

    if settings.renderer == "cpu":
        return CpuVerifier(settings, progress=progress)
    gl = gl_context.probe()
    if settings.renderer == "gl":
        if isinstance(gl, UnavailableError):
            raise gl
        return GlVerifier(settings, progress=progress)
    if isinstance(gl, UnavailableError) or gl.is_software:
        return CpuVerifier(settings, progress=progress)
    return auto_renderer.fastest(settings, auto_renderer.times_on(gl), progress)


class ScoringVerifier:
    """Wraps a part that scores poses one by one as a verifier (core.protocols): without parts of the score and without
    maps.

    Args:
        settings: with the scorer's name.
        scorer: of another program.
    """

    def __init__(self, settings: ScoreSettings, scorer: PoseScorer) -> None:
        self.settings = settings
        self.name = settings.verifier
        self._scorer, self._lender = scorer, Lender(f"verifier {self.name}")

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4).

        Raises:
            ShapeError: the poses have the wrong shape, or the scorer returns the wrong number of scores.
        """
        Ts = as_poses(Ts_cam_obj)
        return self._as_scores(self._scores(target, Ts, placed), _points_in_image(target, Ts))

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> None:
        """None: it is unknown whether the scorer can run in parallel to the caller."""

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> None:
        """None: the scorer gives one number for the whole pose."""

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """The mean over m targets in N combinations of poses (N, m, 4, 4), each scored with the others placed."""
        Ts = np.ascontiguousarray(Ts_cam_obj, dtype=np.float64)
        if len(targets) == 0 or Ts.ndim != 4 or Ts.shape[1:] != (len(targets), 4, 4):
            raise ShapeError(f"the combinations to score have shape {Ts.shape}, expected n×{len(targets)}×4×4")
        score, seen = np.zeros((len(Ts), len(targets))), np.zeros(len(Ts), np.int64)
        for i, target in enumerate(targets):
            seen += _points_in_image(target, Ts[:, i])
            own = [p for p in placed if p.instance_id not in [t.instance.instance_id for t in targets]]
            for n, together in enumerate(Ts):
                others = [Placed(t.instance.instance_id, t.model, T) for t, T in zip(targets, together, strict=True)]
                score[n, i] = self._scores(target, Ts[n : n + 1, i], [*own, *others[:i], *others[i + 1 :]])[0]
        return self._as_scores(score.mean(axis=1), seen)

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        *,
        at: PixelGrid | None = None,
    ) -> None:
        """None, as :meth:`maps`."""

    def _scores(self, target: Target, Ts: Float, placed: Sequence[Placed]) -> Float:
        with self._lender.call(target, Ts, placed) as lent:
            scores = np.asarray(self._scorer.scores(*lent), dtype=np.float64)
        if scores.shape != (len(Ts),):
            raise ShapeError(f"verifier {self.name} gave scores of shape {scores.shape} for {len(Ts)} poses")
        if np.any((scores < 0) | (scores > 1)):
            wrong = scores[(scores < 0) | (scores > 1)][0]
            raise ShapeError(f"verifier {self.name} gave a score of {wrong:g}, expected 0 to 1")
        return scores

    @staticmethod
    def _as_scores(score: Float, seen: np.ndarray) -> Scores:
        none = np.full(len(score), np.nan)
        counts = np.zeros((len(score), len(PIXEL_CLASSES)), np.int64)
        return Scores(score, none, none, np.zeros(len(score), np.int64), seen, counts)


def _points_in_image(target: Target, Ts: Float) -> np.ndarray:
    """(N,) number of the model's points that each pose puts into the image; 0 for an unseen pose."""
    camera = target.observation.camera
    seen = np.zeros(len(Ts), np.int64)
    for n, T in enumerate(Ts):
        points = apply(T, target.model.points)
        u, v = camera.project(points[points[:, 2] > 0]).T
        seen[n] = np.count_nonzero((u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height))
    return seen
