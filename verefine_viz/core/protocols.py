"""Protocols of the parts that can be plugged in.

A new refiner, simulator or verifier is one class that has the method named here. Every answer depends on the arguments
only: the same call after any history gives the same bits. Parts of other programs get arrays of their own
(core/own_parts.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Hypothesis, Placed, Problem, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.records import Best, Iteration, SimulatedPath
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings


class Refiner(Protocol):
    """Improves a pose by the observation.

    ``target`` has everything: cloud and mask of the instance, depth, colour and camera of the frame, the model. A
    refiner that draws the model has a renderer of its own (rendering/mesh.py, rendering/rasterizer.py). A refiner of
    another program gets arrays of its own for the call, and may write into them.
    """

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        """The refined pose (4, 4). ``fixed`` are objects already placed, whose points a refiner may leave out."""
        ...


class Simulator(Protocol):
    """Lets an object move under gravity for a moment."""

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> SimulatedPath:
        """The path of ``moving`` over ``n_steps`` steps of 1/60 s among ``fixed`` objects on the support plane."""
        ...


class PoseSimulator(Protocol):
    """Moves an object in place of Bullet: what a simulator of another program has to have."""

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> Float:
        """(n_steps + 1, 4, 4) T_cam_obj [m]: where ``moving`` is, and where it is after each step of 1/60 s.

        ``fixed`` are the objects already placed. The plane of ``support`` goes through the origin of the world, with a
        normal of its own; gravity pulls against the world's z.
        """
        ...


class PoseScorer(Protocol):
    """Scores poses in place of Eq. 1: what a verifier of another program has to have."""

    def scores(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Float:
        """(N,) in [0, 1], higher is better, of N poses (N, 4, 4) of an object; ``placed`` objects may hide parts.

        The score of a pose must not depend on the others that it is scored with. NaN counts as 0.
        """
        ...


class Verifier(Protocol):
    """Scores poses: by rendering them (Eq. 1), or by what another program's network says of them."""

    @property
    def settings(self) -> ScoreSettings:
        """Scores of two verifiers can be compared where these are the same."""
        ...

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4) in one call; ``placed`` objects may hide parts of them."""
        ...

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Callable[[], Scores] | None:
        """Start :meth:`score` while the caller goes on; calling the result waits for the scores.

        None where it cannot be done beside the caller: by OpenGL, or without a second processor.
        """
        ...

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps | None:
        """The score of one pose, pixel by pixel, for the screen and for recordings; ``at`` some pixels, or all.

        None where the score is not made of pixels.
        """
        ...

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """Scores of N combinations of poses (N, m, 4, 4) of m ≥ 1 targets of one frame, each combination drawn into
        one depth buffer; ``placed`` objects may hide parts. With one target the same as :meth:`score`.

        ``whole_frame`` lets the ``published`` pixels count every object of the frame (authors' code, as :meth:`score`
        does) instead of the masks of the targets; the other kinds of pixels use the targets' masks in any case.
        """
        ...

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        *,
        at: PixelGrid | None = None,
    ) -> ScoreMaps | None:
        """The scene's score of one combination (m, 4, 4), pixel by pixel; None as :meth:`maps`."""
        ...


class SceneRenderer(Protocol):
    """Draws whole scenes and counts what they leave unexplained: the cost of PHYSIM-MCTS. docs/methods.md 3.3."""

    def unexplained_px(self, observation: Observation, scene: Sequence[Placed]) -> int:
        """Pixels in which the objects, drawn together, and what was observed of objects differ; one of both missing
        counts as well.
        """
        ...


class Estimator(Protocol):
    """Finds initial poses of an object from its segment of the frame."""

    def hypotheses(self, target: Target, n: int, progress: ProgressToken = NEVER_CANCELLED) -> tuple[Hypothesis, ...]:
        """At most ``n`` hypotheses, best first; none where the segment is too small for any.

        Args:
            target: the instance; its own hypotheses are not used.
            n: how many are wanted.
            progress: has checkpoints before anything that may take seconds, and during it.

        Raises:
            Cancelled: they are not wanted any more.
        """
        ...


class RunState(Protocol):
    """State of a run, as every method has it. States are immutable."""

    @property
    def problem(self) -> Problem: ...
    @property
    def initial(self) -> tuple[Scores | None, ...]:
        """Per instance: the scores of its hypotheses before the first iteration; None where the pool is empty."""
        ...

    @property
    def best(self) -> tuple[Best | None, ...]:
        """Per instance: the answer so far; None where the pool is empty."""
        ...


S = TypeVar("S", bound=RunState)
S_contra = TypeVar("S_contra", bound=RunState, contravariant=True)


class Method(Protocol[S]):
    """An algorithm that can be stepped, rewound, forked and saved."""

    def start(self, problem: Problem) -> S:
        """The state before iteration 1; scores the hypotheses."""
        ...

    def step(self, state: S) -> tuple[S, Iteration]:
        """The next state and the record of how it came about."""
        ...

    def is_done(self, state: S) -> bool: ...

    def n_iterations(self, state: S) -> int:
        """How many iterations the whole run will have taken, for progress bars."""
        ...

    def edit(self, state: S, instance_id: int, arm: int, T_cam_obj: Float) -> S:
        """The state with the arm's current pose replaced by an edited one.

        That arm is worked on next, or as soon as the method's order allows; without budget it is only scored.
        """
        ...

    @property
    def verifier(self) -> Verifier:
        """The verifier that it scores poses with."""
        ...

    @property
    def refiner(self) -> Refiner | None:
        """The refiner; None where the method repeats recorded steps."""
        ...

    def rescored(self, state: S) -> S:
        """The state with all poses scored again by :attr:`verifier`, after another verifier had scored them.

        Raises:
            InputError: the method decides by something that cannot be scored again.
        """
        ...


class Watcher(Protocol[S_contra]):
    """Sees every record of a run; cannot change it."""

    def on_start(self, state: S_contra) -> None: ...
    def on_iteration(self, state: S_contra, iteration: Iteration) -> None: ...
    def on_finish(self, state: S_contra) -> None: ...
