"""Chooses the key moments of a run for each object, as its film shows them (``pictures/film.py``)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.moment import Moment, MomentKind, MomentLayer
from verefine_viz.core.records import Iteration, Stage, StageName
from verefine_viz.core.scores import MapName
from verefine_viz.diagnosis.number_words import distinct_texts, millimetres
from verefine_viz.run.record import Answer, ObjectHeader, RunRecord

MOST_WORDS = 12
"""Most words of a caption."""
GIVEN_UP = 0.05
"""Lead in score over the answer by which a pose was given up."""
BY_SIMULATION = (Cause.SIMULATION, Cause.PLANE, Cause.COLLIDER, Cause.NEIGHBOUR, Cause.IMPOSSIBLE)
"""Causes that show in what the simulation did; others show in what the refiner did."""
FROM_START = (Cause.POOL, Cause.OUT_OF_RANGE, Cause.UNIT)
"""Causes that show in all initial poses."""
LAYERS: dict[str, MomentLayer] = {
    Cause.MASK: "mask",
    Cause.NEIGHBOUR: "mask",
    Cause.PLANE: "plane",
    Cause.SYMMETRIC: "axes",
    Cause.AMBIGUOUS: "axes",
    Cause.SCORE: "axes",
}
"""What is to blame beside poses, by cause."""
MADE_BY = {"simulated": "Simulation", "refined": "Refiner", "flipped": "Flip", "mixed": "Mixing", "edited": "Edit"}


def key_moments(record: RunRecord, answer: Answer, other: Float | None = None) -> tuple[Moment, ...]:
    """Four to six moments that tell how an answer came about, and what is wrong with it.

    The best start; the decisive stage, before and after; the iteration that made the answer, where that is another;
    the answer; ground truth, or what speaks against the answer where it is unknown. None without an iteration.

    Args:
        record: the run.
        answer: of one of its objects, with its findings.
        other: a pose (4, 4) elsewhere that the image allows as well; None = none is known.
    """
    own = [i for i in record.iterations if i.instance_id == answer.instance_id]
    one = next((o for o in record.header.objects if o.instance_id == answer.instance_id), None)
    if one is None or answer.T_cam_obj is None or not own or not one.hypotheses:
        return ()
    return _Story(one, own, answer, answer.T_cam_obj, other, record.iterations[-1].index).moments()


class _Story:
    """One object while its moments are chosen.

    Args:
        one: its header.
        own: its iterations.
        answer: what the run answered.
        T_answer: its pose.
        other: a pose that fits as well.
        last: the run's last iteration.
    """

    def __init__(
        self,
        one: ObjectHeader,
        own: Sequence[Iteration],
        answer: Answer,
        T_answer: Float,
        other: Float | None,
        last: int,
    ) -> None:
        self._one, self._own, self._answer, self._T, self._last = one, own, answer, T_answer, last
        self._truth, self._other = one.T_cam_obj_gt, other
        self._main = answer.findings[0] if answer.findings else Finding("", "")
        self._numbers = self._main.numbers
        self._layer: MomentLayer = LAYERS.get(self._main.cause, "")
        at = {i.index: i for i in own}
        self._made = at.get(answer.best_iteration or 0)
        """The iteration that made the answer; None: it is an initial pose."""
        change = self._largest_change() if self._main.cause == "" or self._truth is None else None
        self._decisive = at.get(self._main.iteration or 0) or change or self._made or own[-1]

    def _largest_change(self) -> Iteration | None:
        """The iteration that raised the object's score most, or lowered it most where a better pose was given up.

        None where none did, or that is not kept.
        """
        scores = [max((score.score for score in self._one.initial), default=1.0)]
        scores += [i.best.score.score for i in self._own]
        changes = np.diff(scores)
        if max(scores) - scores[-1] > GIVEN_UP:
            return self._own[int(np.argmin(changes))]
        return self._own[int(np.argmax(changes))] if changes.max() > 0 else None

    def moments(self) -> tuple[Moment, ...]:
        """All moments, in the order of their iterations."""
        start, change = self._start(), self._given_up() or self._change()
        gained = self._gained() if self._made not in (None, self._decisive) else []
        # What stands at the start already is not drawn twice.
        if len(change) > 1 and change[0].poses[0][1].tobytes() == start.poses[0][1].tobytes():
            change = change[1:]
        way = sorted([*change, *gained], key=lambda moment: moment.iteration)
        return (start, *way, self._end("answer", self._answer_words()), self._against())

    def _moment(
        self,
        kind: MomentKind,
        iteration: int,
        stage: StageName | None,
        poses: Sequence[tuple[str, Float]],
        caption: str,
        map_name: MapName = "classes",
        arm: int | None = None,
    ) -> Moment:
        # A plane is shown once: it takes the whole image.
        layer = self._layer if self._layer != "plane" or kind in ("truth", "against") else ""
        own, words = self._one.instance_id, _in_few_words(caption)
        return Moment(kind, iteration, own, stage, tuple(poses), words, map_name, arm, layer)

    @property
    def _truly(self) -> list[tuple[str, Float]]:
        return [] if self._truth is None else [("ground truth", self._truth)]

    # The start

    def _start(self) -> Moment:
        """The start that matters: the nearest to ground truth where the cause is about that, else the best one.

        Where only one of several was worked on, it is that one.
        """
        pool, scores = self._one.hypotheses, [score.score for score in self._one.initial]
        numbers, cause, tried = self._numbers, self._main.cause, {i.arm for i in self._own}
        highest = int(np.argmax(scores)) if scores else 0
        best = highest if len(tried) > 1 else min(tried)
        named = numbers.get("hypothesis" if cause in (Cause.ARM_STARVED, Cause.DISCARDED) else "nearest")
        j = best if named is None or not 0 <= named < len(pool) else int(named)
        words = f"{'Best' if j == highest else 'First'} of {len(pool)}"
        if scores:
            words += f": score {scores[j]:.2f}"
        if cause == Cause.ARM_STARVED and "iterations_of_it" in numbers:
            n = numbers.get("iterations", len(self._own))
            words = f"Nearest start: tried in {numbers['iterations_of_it']:.0f} of {n:.0f} iterations"
        elif "nearest_error" in numbers:
            words = (
                f"Nearest start: {numbers['nearest_rotation_deg']:.0f}° off, error {numbers['nearest_error']:.0%} of "
                "the diameter"
            )
        elif j == highest and self._answer.initial_add_s_mm is not None:
            words += f", {millimetres(self._answer.initial_add_s_mm)} off"
        others = [("initial", h.T_cam_obj) for k, h in enumerate(pool) if k != j] if cause in FROM_START else []
        return self._moment("start", 0, None, [("initial", pool[j].T_cam_obj), *others, *self._truly], words, arm=j)

    # What decided

    def _change(self) -> list[Moment]:
        """Moments before and after the decisive stage of the decisive iteration."""
        before, after = self._pair(self._decisive)
        k, arm, words = self._decisive.index, self._decisive.arm, _moved(before, after)
        drawn = [(after.name, after.T_cam_obj), *([(before.name, before.T_cam_obj)] if before else self._truly)]
        moments = [self._moment("after", k, after.name, drawn, words, "difference", arm)]
        if before is not None:
            step = MADE_BY.get(after.name, after.name).lower()
            score = "" if before.score is None else f": score {before.score.score:.2f}"
            words = f"Before the {step}{score}" if score else f"Where the {step} starts{self._nearest()}"
            drawn = [(before.name, before.T_cam_obj), *self._truly]
            moments.insert(0, self._moment("before", k, before.name, drawn, words, "difference", arm))
        return moments

    def _nearest(self) -> str:
        error = self._numbers.get("error_before")
        return "" if error is None else f"; nearest was {millimetres(1e3 * self._one.diameter_m * error)} off"

    def _pair(self, iteration: Iteration) -> tuple[Stage | None, Stage]:
        """The poses before and after the decisive step."""
        made = next((s for s in iteration.stages if s.T_cam_obj.tobytes() == self._T.tobytes()), None)
        wanted = ["simulated", "refined"] if self._main.cause in BY_SIMULATION else ["refined", "simulated"]
        if iteration is self._made and made is not None and self._main.cause not in BY_SIMULATION:
            wanted.insert(0, made.name)
        pairs = {after.name: (before, after) for before, after in pairwise(iteration.stages)}
        for name in wanted:
            if name in pairs:
                return pairs[name]
        return next(iter(pairs.values())) if pairs else (None, iteration.stages[-1])

    def _given_up(self) -> list[Moment]:
        """Moments of the correct pose and of the wrong one that was preferred; none where that is not the cause."""
        if self._main.cause != Cause.DISCARDED or self._answer.score is None:
            return []
        arm, k, margin = (self._numbers[name] for name in ("hypothesis", "iteration", "margin"))
        score = self._answer.score - margin
        there = next((i for i in self._own if i.index == int(k)), None)
        stage = None if there is None else next((s for s in there.stages if _scores(s, score)), None)
        words = f"Correct here, score {score:.3f}; then given up"
        moments: list[Moment] = []
        if there is not None and stage is not None:
            drawn = [(stage.name, stage.T_cam_obj), *self._truly]
            moments.append(self._moment("before", there.index, stage.name, drawn, words, "difference", int(arm)))
        right = stage.T_cam_obj if stage is not None else self._one.hypotheses[int(arm)].T_cam_obj
        best, at = self._decisive.best, max(self._decisive.index, int(k))
        how = f"Preferred: scores {abs(margin):.3f} {'more' if margin >= 0 else 'less'}, "
        words = how + _apart(right, best.T_cam_obj)
        drawn = [("best", best.T_cam_obj), (stage.name if stage is not None else "initial", right)]
        return [*moments, self._moment("after", at, None, drawn, words, "difference", best.arm)]

    def _gained(self) -> list[Moment]:
        """The iteration that made the answer."""
        assert self._made is not None
        best = self._made.best
        was = next((i.best for i in reversed(self._own) if i.index < self._made.index), None)
        words, drawn = f"The answer is made here: score {best.score.score:.2f}", self._truly
        if was is not None and was.score.score < best.score.score:
            one, two = f"{was.score.score:.2f}", f"{best.score.score:.2f}"
            if one == two:
                return []
            words, drawn = f"The answer is made here: best score {one} to {two}", [(was.stage, was.T_cam_obj)]
        return [
            self._moment("gained", self._made.index, None, [("best", self._T), *drawn], words, "difference", best.arm)
        ]

    # The end

    def _end(self, kind: MomentKind, words: str, map_name: MapName = "classes") -> Moment:
        beside = self._truly or ([] if self._other is None else [("runner-up", self._other)])
        arm = None if self._answer.best_hypothesis is None else self._answer.best_hypothesis - 1
        return self._moment(kind, self._last, None, [("best", self._T), *beside], words, map_name, arm)

    def _answer_words(self) -> str:
        a, limit_mm = self._answer, 1e3 * CORRECT * self._one.diameter_m
        score = "" if a.score is None else f"score {a.score:.2f}"
        if a.add_s_mm is not None:
            return f"{millimetres(a.add_s_mm)} off, {millimetres(limit_mm)} allowed; {score}"
        wide = "" if not a.undetermined_deg else f", turn undetermined within ±{a.undetermined_deg:.0f}°"
        return f"{score}{wide}"

    def _against(self) -> Moment:
        """The moment of ground truth and the cause; without ground truth, of what speaks against the answer."""
        at = self._last
        words, detail = "", self._main.detail.removeprefix(":").removeprefix(" for").removeprefix(", ").strip()
        if self._main.cause:
            whole = f"{self._main.title}{self._main.detail}"
            words = whole if len(whole.split()) <= MOST_WORDS or not detail else detail
        if self._truth is None:
            if self._answer.doubts and not words:
                words = f"Look at the data: {self._answer.doubts[0]}"
            if self._other is not None and self._main.cause in ("", Cause.AMBIGUOUS, Cause.SYMMETRIC):
                drawn = [("runner-up", self._other), ("best", self._T)]
                return self._moment("also_fits", at, None, drawn, words or "This pose fits as well")
            return self._end("against", words or "Nothing in sight speaks against it", "difference")
        if "score_of_ground_truth" in self._numbers and self._answer.score is not None:
            right, wrong = distinct_texts(self._numbers["score_of_ground_truth"], self._answer.score, 2)
            words = f"{words.partition(':')[0]}: scores {right}, the answer {wrong}"
        return self._moment("truth", at, None, self._truly, words or "The answer is right")


def _scores(stage: Stage, score: float) -> bool:
    return stage.score is not None and abs(stage.score.score - score) < 1e-9


def _apart(T_one: Float, T_other: Float) -> str:
    """How far a pose is moved and turned: "12.1 mm and 5° away"."""
    mm = 1e3 * float(np.linalg.norm(T_one[:3, 3] - T_other[:3, 3]))
    return f"{millimetres(mm)} and {np.degrees(angle_between(T_one[:3, :3], T_other[:3, :3])):.0f}° away"


def _moved(before: Stage | None, after: Stage) -> str:
    """What a step did: "Simulation moved it 34.1 mm, 40°; score 0.84 to 0.61"."""
    made_by = MADE_BY.get(after.name, "Step")
    if before is None:
        return made_by if after.score is None else f"{made_by}: score {after.score.score:.2f}"
    words = f"{made_by} moved it {_apart(before.T_cam_obj, after.T_cam_obj).removesuffix(' away').replace(' and', ',')}"
    if before.score is None or after.score is None:
        return words if after.score is None else f"{words}; score {after.score.score:.2f}"
    return f"{words}; score {before.score.score:.2f} to {after.score.score:.2f}"


def _in_few_words(text: str) -> str:
    """A text with a capital letter and at most :data:`MOST_WORDS` words."""
    words = text.split()
    cut = words if len(words) <= MOST_WORDS else [*words[: MOST_WORDS - 1], f"{words[MOST_WORDS - 1].rstrip(',;:.')} …"]
    whole = " ".join(cut).replace(" …", "…")
    return f"{whole[:1].upper()}{whole[1:]}"
