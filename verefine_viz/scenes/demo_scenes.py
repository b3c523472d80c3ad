"""The built-in scenes that show how refinement works; those that show how it fails are in :mod:`demo_failures`."""

from __future__ import annotations

from verefine_viz.scenes.demo_scene import DemoScene, Item
from verefine_viz.scenes.demo_view import Viewpoint

_AROUND = (
    Viewpoint(azimuth_deg=-90, elevation_deg=40, distance_m=0.80),
    Viewpoint(azimuth_deg=-40, elevation_deg=46, distance_m=0.80),
    Viewpoint(azimuth_deg=-150, elevation_deg=35, distance_m=0.82),
)
"""Three views of the same table."""

SCENES: dict[str, DemoScene] = {
    "mug": DemoScene("A mug on a table", (Item("mug", yaw_deg=-125),), (Viewpoint(elevation_deg=38, distance_m=0.5),)),
    "duck": DemoScene("A rubber duck on a table", (Item("duck", yaw_deg=-60),), (Viewpoint(distance_m=0.5),)),
    "bowl": DemoScene(
        "A bowl with a wooden block in it",
        (Item("bowl"), Item("block", 0.008, 0.0, 30, drop_m=0.06)),
        (Viewpoint(elevation_deg=48, distance_m=0.55),),
    ),
    "bracket": DemoScene(
        "A steel bracket, the same from both legs",
        (Item("bracket", yaw_deg=-35, tilt_deg=(0, 0)),),
        (Viewpoint(elevation_deg=45, distance_m=0.45),),
    ),
    "stack": DemoScene(
        "A can and a duck on a cereal box",
        (
            Item("cereal", 0.0, 0.0, 15, tilt_deg=(0, 90)),
            Item("can", -0.045, 0.02, 0, drop_m=0.068),
            Item("duck", 0.045, -0.01, -50, drop_m=0.068),
        ),
        _AROUND,
    ),
    "clutter": DemoScene(
        "Six things on a table, some touching, some hidden",
        (
            Item("cereal", 0.01, 0.13, 20),
            Item("bowl", -0.13, -0.02),
            Item("mug", 0.055, -0.035, -150),
            Item("can", 0.135, 0.025, 0),
            Item("bottle", -0.05, 0.075, 0),
            Item("duck", -0.025, -0.12, -50),
        ),
        _AROUND,
    ),
}
"""By name; the first is what the app opens with."""
