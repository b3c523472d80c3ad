"""The unit of a mesh file, checked against the diameter that models_info.json states for the object."""

from __future__ import annotations

from typing import Any

from verefine_viz.core.jsonfile import number_of

SIZE_TOLERANCE = 1.2
"""Ratio between a mesh's own and its stated diameter above which a person is told."""

DIAMETER_MM = (1e-3, 1e6)
"""Least and largest diameter that models_info.json may state [mm]."""


def diameter_mm_of(info: Any, where: str) -> float:
    """The diameter of an object's entry in models_info.json [mm].

    Raises:
        InputError: there is none, or it is out of ``DIAMETER_MM``.
    """
    low, high = DIAMETER_MM
    return number_of(info, "diameter", where, low, high, f"millimetres > 0, {low:g} to {high:g}")


def checked_unit(file: str, own_m: float, stated_m: float | None) -> tuple[float, str]:
    """What a mesh must be multiplied by, and what a person should know about its size.

    1000 where its size says that its unit is metres and was read as millimetres, 0.001 for the reverse, else 1.

    Args:
        file: name of the mesh file, for people.
        own_m: the mesh's diameter, in the unit that its format stands for [m].
        stated_m: the object's diameter by models_info.json [m]; None = it states none.
    """
    if stated_m is None:
        if 0.002 < own_m < 20:
            return 1.0, ""
        return 1.0, f"{file} is {own_m * 1e3:.4g} mm across; check its unit (models_info.json states no diameter)"
    if own_m == 0 or 1 / SIZE_TOLERANCE < own_m / stated_m < SIZE_TOLERANCE:
        return 1.0, ""
    contradiction = f"{file} is {own_m * 1e3:.4g} mm across, models_info.json says {stated_m * 1e3:.4g} mm"
    for factor, unit in ((1000.0, "metres"), (0.001, "millimetres")):
        if 1 / SIZE_TOLERANCE < own_m * factor / stated_m < SIZE_TOLERANCE:
            return factor, f"{contradiction}: its unit was taken to be {unit}"
    return 1.0, f"{contradiction}; one of them is wrong"
