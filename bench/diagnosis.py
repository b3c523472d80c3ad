"""How often a diagnosis names what was broken on purpose: 20 failing scenes for each cause.

``python -m bench.diagnosis [CAUSE …] [--seeds 20] [--first 0] [--most 100] [--refiner NAME] [--second] [--verbose]``. A
scene that comes out right in spite of what is broken has nothing to diagnose; further seeds are taken until there are
enough that fail, of ``--most`` scenes. ``--refiner`` solves them with another refiner than each has. ``--second`` puts
a smaller fault of another kind into each scene: then "named" says how often the diagnosis still names the larger
one, and "second named" how often it names the smaller one instead.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from time import perf_counter

from bench.second_faults import with_second
from tests.failing_scenes import GENERATORS, broken_scene, named
from verefine_viz.core.causes import Cause

SEEDS = 20
MOST_SEEDS = 100


def run(
    causes: Sequence[Cause] = tuple(GENERATORS),
    n_seeds: int = SEEDS,
    first: int = 0,
    verbose: bool = False,
    second: bool = False,
    most: int = MOST_SEEDS,
    refiner: str = "",
) -> list[dict[str, object]]:
    """One row per cause: how many of the failing scenes were named right, and what the others were called."""
    rows: list[dict[str, object]] = []
    for cause in causes:
        said: Counter[str] = Counter()
        n_fine, n_confirmed, n_second, n_reruns, ms = 0, 0, 0, 0, 0.0
        began = perf_counter()
        for seed in count(first):
            if said.total() >= n_seeds or seed >= first + most:
                break
            broken, smaller = broken_scene(cause, seed), None
            if second:
                broken, smaller = with_second(broken, seed)
            if refiner:
                broken = replace(broken, toolbox=broken.toolbox.changed({"method": {"refiner": refiner}}))
            diagnosis = named(broken)
            if diagnosis is None:
                n_fine += 1
                continue
            said[diagnosis.main.cause] += 1
            n_confirmed += diagnosis.main.is_confirmed and diagnosis.main.cause == cause
            n_second += diagnosis.main.cause == smaller
            n_reruns += diagnosis.n_reruns
            ms += diagnosis.ms
            if verbose or diagnosis.main.cause != cause:
                beside = f" and {smaller}" if smaller else ""
                print(f"  {cause}{beside} {seed}: {diagnosis.main.cause}: {diagnosis.main.text}")
                if verbose:
                    for other in diagnosis.findings[1:]:
                        print(f"      also {other.cause} ({other.is_confirmed}): {other.text}")
        n = max(said.total(), 1)
        rows.append(
            {
                "broken": str(cause),
                "named": f"{said[cause]}/{said.total()}",
                "rate": said[cause] / n,
                "confirmed": n_confirmed,
                **({"second named": n_second} if second else {}),
                "came out right": n_fine,
                "re-runs each": n_reruns / n,
                "ms each": ms / n,
                "called instead": ", ".join(f"{c} {k}" for c, k in said.most_common() if c != cause),
            }
        )
        print({**rows[-1], "s": round(perf_counter() - began)}, flush=True)
    return rows


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("causes", nargs="*", type=Cause, help="default: all")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--most", type=int, default=MOST_SEEDS, help="scenes of a cause at most")
    parser.add_argument("--refiner", default="", help="instead of each scene's own")
    parser.add_argument("--second", action="store_true", help="a smaller fault of another kind beside each")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    run(args.causes or tuple(GENERATORS), args.seeds, args.first, args.verbose, args.second, args.most, args.refiner)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
