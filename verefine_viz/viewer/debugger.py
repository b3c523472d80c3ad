"""Carries out commands, one after another, on one thread: those of a list, or of the queue that the page fills.

The debugger needs no screen: a list of commands (:meth:`Debugger.carry_out`) has the same result as the page. Commands
that change only what is shown are carried out here, all others in ``handlers/``.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, get_args

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.records import Iteration
from verefine_viz.core.scores import MAP_NAMES
from verefine_viz.evaluation.landscape import N_AXES
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.handlers import (
    comparison_handlers,
    edit_handlers,
    gallery_handlers,
    grasp_handlers,
    navigation,
    open_handlers,
)
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.view_options import LAYERS, OF_ITERATION, STAGES, ViewOptions, is_answer

STOP = object()
"""What the worker takes instead of a command when it is to end."""


class RequestQueue:
    """Commands that wait for the worker thread, and whether what the worker does is still wanted.

    Args:
        on_cancel: called, on the thread that asks for it, before what the worker does is cancelled.
    """

    def __init__(self, on_cancel: Callable[[], None] = lambda: None) -> None:
        self._on_cancel = on_cancel
        self._queue: deque[Command] = deque()
        self._wake = threading.Condition()
        self._stopping = self._idle = self._cancelled = self._is_aside = False
        self.can_cancel = False
        """Whether what the worker does may be left undone."""
        self.view_meanwhile: Callable[[Command], None] = lambda command: None
        """Carries out a command that only looks, and shows it, while the worker does something long."""
        self.offers_hulls = self.wants_hulls = False
        """Whether what is being opened may be opened with hulls in place of convex parts, and whether it is to be."""
        self._long_on: int | None = None
        """The worker's thread while it does something long and shows nothing else meanwhile."""

    def is_wanted(self) -> bool:
        """Whether what the worker does is still wanted; before that, commands that only look are carried out."""
        if self._long_on == threading.get_ident():
            worker, self._long_on = self._long_on, None
            while (command := self._take_looking()) is not None:
                self.view_meanwhile(command)
            self._long_on = worker
        gives_way = self._cancelled or self._stopping or (self.offers_hulls and self.wants_hulls)
        return not (gives_way or (self._is_aside and self._queue))

    @contextmanager
    def cancellable(self, is_long: bool = False) -> Iterator[None]:
        """What the worker does inside may be left undone: ``Cancel`` has it no longer wanted.

        Where it ``is_long``, commands that only look are carried out meanwhile.
        """
        with self._wake:
            self.can_cancel = True
        self._long_on = threading.get_ident() if is_long else None
        try:
            yield
        finally:
            self._long_on = None
            with self._wake:
                self.can_cancel = self._cancelled = False

    @contextmanager
    def opening(self) -> Iterator[None]:
        """What the worker opens inside is given up where ``UseHulls`` asks for the same with hulls."""
        self.offers_hulls, self.wants_hulls = True, False
        try:
            yield
        finally:
            self.offers_hulls = False

    @contextmanager
    def aside(self) -> Iterator[None]:
        """What the worker does inside is no longer wanted once any command waits."""
        self._is_aside = True
        try:
            yield
        finally:
            self._is_aside = False

    def send(self, command: Command) -> None:
        """Puts a command into the queue; returns at once. Callable from any thread.

        ``Cancel`` overtakes all others, and takes with it what waits: that was meant for what was to come.
        """
        with self._wake:
            if isinstance(command, c.Cancel):
                if self.can_cancel and not self._cancelled:
                    self._queue.clear()
                    self._on_cancel()
                    self._cancelled = True
                return
            if isinstance(command, c.UseHulls):
                self.wants_hulls = self.offers_hulls
                return
            if command.latest_wins and self._queue and type(self._queue[-1]) is type(command):
                self._queue[-1] = command
            else:
                self._queue.append(command)
            self._idle = False
            self._wake.notify_all()

    def take(self, wait_s: float | None) -> Command | object | None:
        """The next command; None = nothing waits, go on with what is under way; STOP = end.

        Args:
            wait_s: how long to wait for one [s]; None = nothing is under way, wait until one comes.
        """
        with self._wake:
            if not self._queue and wait_s != 0:
                if wait_s is None:
                    self._idle = True
                    self._wake.notify_all()
                self._wake.wait_for(lambda: self._queue or self._stopping, wait_s)
            if self._stopping:
                return STOP
            return self._queue.popleft() if self._queue else None

    def _take_looking(self) -> Command | None:
        with self._wake:
            return self._queue.popleft() if self._queue and self._queue[0].only_looks else None

    def holds(self, kind: type[Command] = Command) -> bool:
        """Whether a command of that kind waits."""
        with self._wake:
            return any(isinstance(waiting, kind) for waiting in self._queue)

    def wait_until_idle(self, timeout_s: float) -> None:
        """Waits until every command so far is carried out and nothing is under way."""
        with self._wake:
            if not self._wake.wait_for(lambda: self._idle and not self._queue, timeout_s):
                raise TimeoutError(f"still busy after {timeout_s} s")

    def stop(self) -> None:
        """Ends the worker; the command at hand is cancelled where that is possible."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()


class Debugger(State):
    """A state that commands are applied to. Handlers see the state alone."""

    def apply(self, command: Command) -> None:
        """Begins to carry out a command; a run goes on with each :meth:`tick`.

        Raises:
            VerefineError: it cannot be done; everything is as before.
            Cancelled: it is no longer wanted; everything is as before.
        """
        if not isinstance(command, c.RefreshGallery):  # The user did not ask for it.
            self.message, self.refused, self.offer = "", False, None
        if isinstance(command, c.TogglePause):
            command = c.Pause() if self.is_busy else c.RunUntil("end")
        command = gallery_handlers.resolved(self, command)
        edit_handlers.refuse_loss(self, command)
        self.log.extend(self.comparison.progress())
        if not command.keeps_b_running:
            self.pause_b()
        if not command.runs_beside:
            self.pause()
        HANDLERS[type(command)](self, command)
        self.log.extend(command.logged(self.run.cursor))

    def carry_out(self, commands: Iterable[Command]) -> Debugger:
        """Every command in order, each to its end."""
        for command in commands:
            self.apply(command)
            while self.is_busy:
                self.tick()
        return self

    def tick(self) -> Iteration | None:
        """One iteration of the open run, or else of B; None where the open one has none to make."""
        if self.running.goal is not None:
            return navigation.tick(self)
        comparison_handlers.tick_b(self)
        return None

    @property
    def is_busy(self) -> bool:
        """Whether a run is on, be it A's or B's."""
        return self.running.goal is not None or self.comparison.is_running

    def view(self, deep: bool = True) -> Snapshot:
        """What is to be seen now; if not ``deep`` without score maps, and plausibility only of an edited pose."""
        return snapshot_of(self, deep)


# Commands that change view options only: what is shown, of what, in which colours


def change_options(state: State, command: Command) -> None:
    """Carries out a command that changes view options only.

    Raises:
        InputError: the command names a stage, map, layer, instance or pixel that does not exist.
    """
    options = _of_last_iteration(_CHANGES[type(command)](state.options, command), command, state)
    problem = state.workspace.work.problem
    ids = [i.instance_id for i in problem.instances]
    if options.focus is not None and options.focus not in ids:
        raise InputError(unknown("instance", options.focus, ids))
    if options.pixel is not None:
        h, w = problem.observation.camera.shape
        if not (0 <= options.pixel[0] < w and 0 <= options.pixel[1] < h):
            raise InputError(f"pixel {options.pixel} is outside of the {w}×{h} image")
    if options.preset == "gallery":
        gallery_handlers.open_gallery(state)
    state.options = options


def show_layer(state: State, command: c.ShowLayer) -> None:
    """A layer on or off; one that a comparison hides comes back if it is asked for."""
    choice = state.comparison.choice
    if choice is not None and command.name in choice.hidden and command.visible is not False:
        state.workspace.work.comparison = replace(choice, hidden=choice.hidden - {command.name})
        state.options = replace(state.options, layers=state.options.layers | {command.name})
    else:
        change_options(state, command)


def play_path(state: State, command: c.PlayPath) -> None:
    """Shows the last pose of the simulated path; the page animates it."""
    shown = snapshot_of(state, deep=False).shown
    if shown is None or shown.path is None:
        raise InputError("no simulated path here; step to an iteration with physics")
    options = state.options
    state.options = replace(options, path_pose=len(shown.path.Ts_cam_obj) - 1, layers=options.layers | {"path"})


def _compare(options: ViewOptions, command: c.Compare) -> ViewOptions:
    for name in (command.a, command.b):
        if name is not None and name not in STAGES:
            raise InputError(unknown("stage", name, STAGES))
    return replace(options, a=command.a or options.a, b=command.b or options.b, compared_before=None, has_chosen=True)


def _show_map(options: ViewOptions, command: c.ShowMap) -> ViewOptions:
    if command.name not in MAP_NAMES:
        raise InputError(unknown("map", command.name, MAP_NAMES))
    return replace(options, map=command.name)


def _place_ruler(options: ViewOptions, command: c.PlaceRuler) -> ViewOptions:
    if options.ruler is None and options.pixel is None:
        raise InputError("no pixel is marked; click where the ruler is to start")
    return replace(options, ruler=options.pixel if options.ruler is None else None)


def _cut_view(options: ViewOptions, command: c.CutView) -> ViewOptions:
    if not 0 <= command.percent <= 100:
        raise InputError(f"{command.percent} % cannot be cut off, expected 0 to 100")
    return replace(options, cut_percent=command.percent)


def _color_cloud(options: ViewOptions, command: c.ColorCloud) -> ViewOptions:
    kinds = get_args(c.CloudColors)
    return replace(options, cloud=command.by or kinds[(kinds.index(options.cloud) + 1) % len(kinds)])


def _show_layer(options: ViewOptions, command: c.ShowLayer) -> ViewOptions:
    if command.name not in LAYERS:
        raise InputError(unknown("layer", command.name, LAYERS))
    on = command.name not in options.layers if command.visible is None else command.visible
    return replace(options, layers=options.layers | {command.name} if on else options.layers - {command.name})


def _show_layout(options: ViewOptions, command: c.ShowLayout) -> ViewOptions:
    presets = get_args(c.Preset)
    if command.preset not in presets:
        raise InputError(unknown("layout", command.preset, presets))
    return replace(options, preset=command.preset, enlarged=None)


def _enlarge(options: ViewOptions, command: c.Enlarge) -> ViewOptions:
    order: tuple[c.Pane | None, ...] = (None, *get_args(c.Pane))
    if command.pane not in order:
        raise InputError(unknown("pane", command.pane, get_args(c.Pane)))
    if command.pane is None:
        return replace(options, enlarged=order[(order.index(options.enlarged) + 1) % len(order)])
    return replace(options, enlarged=None if command.pane == options.enlarged else command.pane)


def _show_landscape(options: ViewOptions, command: c.ShowLandscape) -> ViewOptions:
    across = options.slice_axes[0] if command.across is None else command.across
    up = options.slice_axes[1] if command.up is None else command.up
    for axis in (across, up):
        if axis not in range(N_AXES):
            raise InputError(unknown("axis", axis, range(N_AXES)))
    frame = command.frame or options.curves_of
    return replace(options, landscape_wanted=True, curves_of=frame, slice_axes=(across, up))


_CHANGES: dict[type[Command], Callable[[ViewOptions, Any], ViewOptions]] = {
    c.Focus: lambda o, x: replace(o.unedited(), focus=x.instance_id, whole_scene=False, arm=None),
    c.ShowScene: lambda o, x: replace(o.unedited(), focus=None, whole_scene=True, arm=None),
    c.SelectArm: lambda o, x: replace(o.unedited(), arm=x.arm),
    c.Compare: _compare,
    c.ShowMap: _show_map,
    c.ShowRefinerCrops: lambda o, x: replace(o, refiner_crops=not o.refiner_crops if x.on is None else x.on),
    c.ProbePixel: lambda o, x: replace(o, pixel=(x.u, x.v)),
    c.PlaceRuler: _place_ruler,
    c.CutView: _cut_view,
    c.ColorCloud: _color_cloud,
    # From the sensor its image would hide all that is behind it.
    c.MoveCamera: lambda o, x: replace(o, layers=o.layers - {"camera image"}) if x.to == "sensor" else o,
    c.ShowLayer: _show_layer,
    c.ShowLayout: _show_layout,
    c.Enlarge: _enlarge,
    c.ShowLandscape: _show_landscape,
    c.ScrubPath: lambda o, x: replace(o, path_pose=x.pose),
    c.Animate: lambda o, x: replace(o, animate=x.on),
    c.ArrangeGallery: lambda o, x: replace(o, arrangement=gallery_handlers.arrangement(x), arranged_by=x.browser),
    c.ScoreGroundTruth: lambda o, x: replace(
        o, a="best", b="ground truth", layers=o.layers | {"ground truth", "best"}, has_chosen=True
    ),
}
"""By command: the options after it."""


def _of_last_iteration(options: ViewOptions, command: Command, state: State) -> ViewOptions:
    """``options``, or those that show the last iteration where its answer is shown and ``command`` asks for a pose of
    the iteration.
    """
    run, now = state.run, state.options
    if run.iteration is None or not is_answer(run, now):
        return options
    last = run.iteration.stages[-1].name
    match command:
        case c.ShowLayer(name, visible) if name in OF_ITERATION and visible is not False:
            return replace(now, layers=now.layers | {name}, stage=last)
        case c.ShowLayer("hypotheses", visible):
            on = not now.hypotheses_with_answer if visible is None else visible
            return replace(now, hypotheses_with_answer=on, layers=now.layers | {"hypotheses"} if on else now.layers)
        case c.ShowLayer("best", visible) if visible is not True:
            return replace(now, layers=now.layers - {"best"}, stage=last)
        case c.Compare(a, b) if OF_ITERATION & {a, b}:
            return replace(options, stage=last)
    return options


HANDLERS: dict[type[Command], Callable[[State, Any], None]] = {
    **dict.fromkeys(_CHANGES, change_options),
    c.ShowLayer: show_layer,
    c.PlayPath: play_path,
    **navigation.HANDLERS,
    **open_handlers.HANDLERS,
    **gallery_handlers.HANDLERS,
    **edit_handlers.HANDLERS,
    **comparison_handlers.HANDLERS,
    **grasp_handlers.HANDLERS,
}
"""By command: what carries it out."""
