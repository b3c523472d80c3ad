"""What is said of mistakes and of right data by each way in which a frame reaches the program, with truth and without.

    python -m bench.four_ways [--data ../shared/data] [--frames 15] [--held-out 6] [--right 3] [--say]

writes frames (real ones of YCB-V and LM where ``--data`` has them, built-in ones, and some that no threshold was set
on) as a BOP data set, a trace, a kept frame and a folder of FoundationPose, or gives them to the library, and prints
how often each mistake of ``tests/calibration/ways_in.py`` is named, how often it is doubted that anything single fits
("?"), and how often something else is named ("!"); then, of every ``--right``-th variant of right frames, how many are
doubted. Initial poses are 3° and 3 mm off.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.data_faults import held_out
from bench.right_data import frames
from tests.calibration.right_variants import RIGHT, off
from tests.calibration.ways_in import MISTAKES, NOTHING_SINGLE, WAYS, Frame, frame_of, read
from verefine_viz.core.problem import Problem

LARGEST = 4
"""Objects of a frame that are written."""


def estimated(problem: Problem) -> Frame:
    """A frame with ground truth, and initial poses 3° and 3 mm off where it has no other ones."""
    disturb = off(np.random.default_rng(problem.im_id), 3, 3)
    frame = frame_of(problem, LARGEST)
    return frame.with_objects(lambda o: replace(o, initial=o.initial if o.truth is None else disturb(o.truth)))


def by_way(way: str, frame: Frame) -> tuple[str, str]:
    """What is noted, and what is doubted, of a frame that comes in one way."""
    with TemporaryDirectory() as folder:
        return read(way, frame, Path(folder) / "frame")


def cell(way: str, of: Sequence[Frame], change: Callable[[Frame], Frame], words: tuple[str, ...], say: str) -> str:
    """How many of the frames are named, "?" with of how many nothing single is, "!" with how many something else is."""
    n_named = n_none = n_wrong = 0
    for k, frame in enumerate(of):
        notes, doubts = by_way(way, change(frame))
        is_named = any(word in notes + doubts for word in words)
        names_nothing = any(words in doubts for words in NOTHING_SINGLE)
        n_named, n_none = n_named + is_named, n_none + (names_nothing and not is_named)
        n_wrong += bool(doubts) and not is_named and not names_nothing
        if say and not is_named:
            print(f"  {say}, {way}, frame {k}: {doubts[:240]}", flush=True)
    return f"{n_named}/{len(of)}" + f" ?{n_none}" * bool(n_none) + f" !{n_wrong}" * bool(n_wrong)


def print_mistakes(of: Sequence[Frame], say: bool) -> None:
    """Prints a row per mistake, with ground truth and without."""
    print(f"| mistake | truth | {' | '.join(WAYS)} |\n|---|---|{'---|' * len(WAYS)}")
    for name, (change, words) in MISTAKES.items():
        seen = [frame for frame in of if frame.rgb is not None or "photo" not in name]
        # Of one object alone, the masks of all are its own.
        seen = [frame for frame in seen if len(frame.objects) > 1 or "masks" not in name]
        for truth, some in (("with", seen), ("without", [frame.without_truth() for frame in seen])):
            cells = (cell(way, some, change, words, f"{name}, {truth}" * say) for way in WAYS)
            print(f"| {name} | {truth} | {' | '.join(cells)} |", flush=True)


def print_right(of: Sequence[Problem], every: int, say: bool) -> None:
    """Prints a row per variant of right data: how many are doubted."""
    print(f"\n| right data, doubted with truth, without | {' | '.join(WAYS)} |\n|---|{'---|' * len(WAYS)}")
    for name, variant in [*RIGHT.items()][::every]:
        rng = np.random.default_rng(0)
        made = [estimated(p) for problem in of if (p := variant(problem, rng)).instances]
        cells = []
        for way in WAYS:
            counts = []
            for some in (made, [frame.without_truth() for frame in made]):
                texts = [text for frame in some if (text := by_way(way, frame)[1])]
                counts.append(len(texts))
                for text in texts if say else ():
                    print(f"  {name}, {way}: {text[:240]}", flush=True)
            cells.append(f"{counts[0]}, {counts[1]} of {len(made)}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> int:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--frames", type=int, default=15)
    parser.add_argument("--held-out", type=int, default=6, help="frames")
    parser.add_argument("--right", type=int, default=3, help="every so many variants of right data")
    parser.add_argument("--say", action="store_true", help="print what is said where a mistake is not named")
    arguments = parser.parse_args()
    problems = frames(arguments.data, 15)[:: max(1, 15 // arguments.frames)]
    problems += map(held_out, range(arguments.held_out))
    print_mistakes([*map(estimated, problems)], arguments.say)
    print_right(problems[::2], arguments.right, arguments.say)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
