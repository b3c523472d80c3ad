"""Whether depth and colour of a split can be read, and are plausible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.commands.dataset_parts import Parts
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.listing import MOST_NAMED, first_of
from verefine_viz.scenes.bop import NO_COLOR, BopDataset
from verefine_viz.scenes.frames import frame_name


def check_images(dataset: BopDataset, sampled: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Adds what is there and what is wrong; frames without colour are named, and nothing is wrong with them."""
    trouble: list[str] = []
    medians_m: list[float] = []
    colourless: list[str] = []
    for ids in sampled:
        try:
            image = dataset.image(*ids)
        except VerefineError as error:
            trouble.append(str(error))
            continue
        medians_m.append(float(np.median(image.depth_m[image.depth_m > 0])))
        trouble += [f"image {frame_name(ids)}: {note}" for note in image.notes if note != NO_COLOR]
        colourless += [frame_name(ids)] * (image.rgb is None)
    parts.depth = bool(medians_m)
    looked = f"{len(medians_m)} of {len(sampled)} frames looked at"
    found = f"median {np.median(medians_m):.2f} m in {looked}" if medians_m else f"none could be read in {looked}"
    if colourless:
        which = "all of them" if len(colourless) == len(medians_m) else first_of(colourless, MOST_NAMED)
        found += f"; no rgb or gray image in {which}: drawn without colour, which is optional"
    parts.add("depth and colour", found, "; ".join(dict.fromkeys(trouble)))
