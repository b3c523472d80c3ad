"""Which poses are called impossible: ground truth, and poses that no object can have.

    python -m bench.impossible_poses [--data ../shared/data]

takes the ground truth of every frame for answers, those of real frames of YCB-V and LINEMOD where ``--data`` has them,
and those of the built-in scenes; then each object sunk by 25 mm, floating 30 mm higher, and in the middle of a
neighbour, the others staying where they are. No ground truth may be called impossible, and all others have to be.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tests.diagnosis.impossible_poses import built_in_frames, heights_of, real_frames, table, truth_of


def main(data: Path) -> None:
    """Prints how many poses of each kind are called impossible, others than expected, and measured heights."""
    for title, frames in (("real", list(real_frames(data))), ("built-in", list(built_in_frames()))):
        for what, objects in table(frames).items():
            expected = what != "ground truth"
            others = [label for label, is_named in objects if is_named != expected]
            n_named = sum(is_named for _, is_named in objects)
            print(f"{title:9} {what:15} {n_named:3} of {len(objects):3} called impossible", *others, sep="  ")
        for problem in frames:
            heights = heights_of(problem, truth_of(problem)) if problem.observation.support else None
            if heights is not None:
                print(f"{title:9} {problem.frame}: {heights.describe()}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    main(parser.parse_args().data)
