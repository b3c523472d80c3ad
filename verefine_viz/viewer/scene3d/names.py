"""Names of the nodes in the 3D scene: what hangs below ``/cam`` moves with the camera's frame."""

from __future__ import annotations

CAMERA_FRAME, WORLD_FRAME = "/cam", "/world"
CLOUD = "/cam/cloud"
BALANCE = "/cam/balance"
"""The support polygon with the centre of mass."""
CONTACTS = "/cam/contacts"
OVERLAPS = "/cam/overlaps"
FRUSTUM, IMAGE = "/cam/frustum", "/cam/image"
GIZMO, GIZMO_MESH = "/cam/gizmo", "/cam/gizmo/mesh"
GRID, GRAVITY = "/world/grid", "/world/gravity"


def stage(key: int, name: str) -> str:
    """A stage of the object ``key``; also ``moving``, what is animated, and ``path``."""
    return f"/cam/stages/{key}/{name.replace(' ', '_')}"


def hypotheses(key: int) -> str:
    """All hypotheses of the object ``key``."""
    return f"/cam/hypotheses/{key}"


def scene_object(instance_id: int, part: str = "") -> str:
    """An object of the scene; ``part``: its marker or its name."""
    return f"/cam/objects/{instance_id}{part and '_'}{part}"


def compared_object(side: str, instance_id: int) -> str:
    """An object where run ``side``, a or b, has it."""
    return f"/cam/sides/{side}_{instance_id}"
