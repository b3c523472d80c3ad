"""Entity paths and frame names of a recording, each written here once.

Everything below :data:`SCENE` is in the camera frame; its parent is the world (+z up). Every object has its own branch,
named by instance and model, so that a frame with two mugs has ``1_mug`` and ``4_mug``.
"""

from __future__ import annotations

import re

from verefine_viz.core.problem import Instance, Problem

TIMELINE = "iteration"
SEQUENCE_FILE = "sequence.rrd"
"""Name of the recording over the frames of a batch instead of the iterations of a run."""
APPLICATION = "verefine_viz"
PROPERTY = "verefine"
PROPERTIES = f"/__properties/{PROPERTY}"
"""Where rerun keeps what :meth:`RecordingStream.send_property` sent."""

SCENE = "/scene"
CAMERA = f"{SCENE}/camera"
IMAGE = f"{CAMERA}/image"
DEPTH = f"{CAMERA}/depth"
MASKS = f"{CAMERA}/masks"
CLOUD = f"{SCENE}/cloud"
OBJECTS = f"{SCENE}/objects"
SUPPORT = "/support"
PLANE = f"{SUPPORT}/plane"
GRAVITY = f"{SUPPORT}/gravity"
NORMAL = f"{SUPPORT}/normal_of_plane"
SURFACES = f"{SUPPORT}/surfaces"
SOLIDS = f"{SUPPORT}/solids"
UNKNOWN = f"{SUPPORT}/unknown_objects"

CONTOURS = f"{CAMERA}/contours"
"""Outlines in the photo."""
MAPS = "/maps"
OBSERVED_COLOUR, OBSERVED_DEPTH = f"{MAPS}/observed/colour", f"{MAPS}/observed/depth"
COMPARED = ("before", "after")
"""The two poses of an iteration whose maps are drawn: simulated and refined, else the first and the last."""
SCENE_MAPS = "/scene_maps"
REFINER = "/refiner/steps"
REFINER_WORDS = "/refiner/numbers"
CURVES = "/curves"
BANDIT = "/bandit"
LANE = "/events/lane"
LOG = "/events/log"
CHOICE = "/choice"
RUN_FILE = "/run_file"
"""The whole run file (``run/run_file.py``), in a recording that was finished."""
GRAPH = "/dependencies"
GRAPH_OBJECTS = f"{GRAPH}/objects"
EVIDENCE = f"{GRAPH}/evidence"
TREE = "/tree"
LANDSCAPE = "/landscape"
FILM = "/film"
GRASP = "/grasp"
GRASP_TIMELINE = "grasp"
"""In moments, 30 per second, one object's grasp after another."""
GRASP_ENDS = f"{GRASP}/how_they_end"

WORKED_ON = ("current", "simulated", "mixed", "refined")
"""Poses of the object being worked on that are drawn, in this order; where flips compete, "flipped" as well."""
IN_SCENE = ("placed", "incumbent")
"""Two more poses in a scene of several objects: where it stands while others are worked on, and in the best scene so
far."""


def branch(instance: Instance, problem: Problem) -> str:
    """The name of an object's branch: ``3_mug``; letters, digits, ``_`` and ``-`` only."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", problem.models[instance.obj_id].name).strip("_")[:40]
    return f"{instance.instance_id}_{name or 'object'}"


def stage(branch_name: str, stage_name: str) -> str:
    """The mesh of an object at one of its stages."""
    return f"{OBJECTS}/{branch_name}/stages/{stage_name}"


def stage_frame(branch_name: str, stage_name: str) -> str:
    """The named coordinate frame in which the mesh of a stage is drawn."""
    return f"{branch_name}/{stage_name}"


def poses(branch_name: str) -> str:
    """The transforms of an object's stage frames."""
    return f"{OBJECTS}/{branch_name}/poses"


def hypotheses(branch_name: str) -> str:
    """The meshes of an object's initial poses."""
    return f"{OBJECTS}/{branch_name}/hypotheses"


def ground_truth(branch_name: str) -> str:
    """The mesh of an object at its ground truth."""
    return f"{OBJECTS}/{branch_name}/ground_truth"


def contacts(branch_name: str) -> str:
    """Contact forces at the end of an object's simulation."""
    return f"{OBJECTS}/{branch_name}/contacts"


def simulated_path(branch_name: str) -> str:
    """The line along which an object's origin moved in its simulation."""
    return f"{OBJECTS}/{branch_name}/path"


def curves(group: str, branch_name: str) -> str:
    """One group of an object's curves."""
    return f"{CURVES}/{group}/{branch_name}"


def curve(group: str, branch_name: str, name: str) -> str:
    """One curve of an object: a number over the iterations."""
    return f"{curves(group, branch_name)}/{name}"


def pose_map(name: str, when: str) -> str:
    """A score map of one of the two poses of an iteration, by :data:`COMPARED`."""
    return f"{MAPS}/{name}/{when}"


def scene_map(name: str) -> str:
    """A score map of a whole scene."""
    return f"{SCENE_MAPS}/{name}"


def contour(branch_name: str) -> str:
    """The outline of an object's best pose so far."""
    return f"{CONTOURS}/{branch_name}/best"


def contour_of_truth(branch_name: str) -> str:
    """The outline of an object's ground truth."""
    return f"{CONTOURS}/{branch_name}/ground_truth"


def grasp_side(side: str) -> str:
    """The simulated scene in which objects are grasped by their answers, or by their ground truth."""
    return f"{GRASP}/{side}"


def landscape(branch_name: str, axis: int) -> str:
    """The score around an object's answer along one axis."""
    return f"{LANDSCAPE}/{branch_name}/axis_{axis}"


def moment(branch_name: str, k: int) -> str:
    """The picture of one of an object's key moments, from 0."""
    return f"{FILM}/{branch_name}/{k}"


def landscape_words(branch_name: str) -> str:
    """The undetermined motions of an object's answer."""
    return f"{LANDSCAPE}/{branch_name}/undetermined"
