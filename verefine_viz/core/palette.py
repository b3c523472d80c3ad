"""Colours that mean something, the same on the page, in maps, recordings and reports."""

from __future__ import annotations

RGB = tuple[int, int, int]

STAGE_COLORS: dict[str, RGB] = {
    "initial": (120, 120, 120),
    "current": (160, 160, 160),
    "simulated": (255, 140, 0),
    "mixed": (240, 210, 40),
    "refined": (50, 110, 255),
    "accepted": (40, 200, 80),
    "best": (0, 170, 120),
    "edited": (190, 90, 220),
    "ground truth": (255, 255, 255),
}

CLASS_COLORS: dict[str, RGB] = {
    "explained": (60, 180, 75),
    "missed": (220, 50, 47),
    "protruding": (211, 54, 180),
    "hidden": (96, 125, 139),
    "unknown": (200, 200, 200),
}

ARM_COLORS: tuple[RGB, ...] = (
    (140, 140, 240),
    (205, 165, 110),
    (165, 70, 110),
    (120, 212, 228),
    (140, 130, 35),
    (238, 150, 165),
    (70, 95, 170),
    (190, 215, 140),
    (130, 82, 55),
    (60, 140, 150),
)
"""Arm j is drawn in ``ARM_COLORS[j % 10]``: softer than the colours that mean something, and told apart without red and
green."""

OBJECT_COLORS: tuple[RGB, ...] = (
    (102, 194, 255),
    (255, 179, 90),
    (186, 150, 255),
    (140, 214, 120),
    (255, 140, 170),
    (245, 224, 110),
    (70, 214, 205),
    (214, 160, 120),
    (240, 140, 240),
    (170, 190, 215),
)
"""The k-th instance of a frame, in the order of ``Problem.instances``, is drawn in ``OBJECT_COLORS[k % 10]``."""

SIDE_COLORS: dict[str, RGB] = {"A": (0, 190, 205), "B": (205, 255, 70)}
"""Two runs that are compared: A is drawn solid, B as an outline and dashed."""

EVENT_COLORS: dict[str, RGB] = {
    "kept_simulated": (255, 140, 0),
    "kept_refined": (50, 110, 255),
    "score_fell": (220, 50, 47),
    "new_best": (40, 200, 80),
    "arm_switched": (50, 110, 255),
    "unstable": (220, 50, 47),
    "physics_worse": (220, 50, 47),
    "empty_render": (220, 50, 47),
    "nan_score": (220, 50, 47),
    "refiner_stuck": (220, 50, 47),
    "no_physics": (160, 160, 160),
    "edited": (190, 90, 220),
    "new_best_scene": (240, 200, 60),
}
