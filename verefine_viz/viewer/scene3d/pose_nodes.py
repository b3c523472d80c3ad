"""One object's poses in 3D: a node per stage, made once per object; afterwards only poses and visibility change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import pairwise

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from PIL import Image as PilImage
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from verefine_viz.core.arrays import Float
from verefine_viz.core.decimation import decimated
from verefine_viz.core.geometry import quat_wxyz, rotation_of_quat_wxyz, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import RGB, STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.pictures.skin import skin_of
from verefine_viz.rendering.simplify import scoring_mesh
from verefine_viz.viewer.commands import Command, SelectArm
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.view_options import STAGES
from verefine_viz.viewer.text.display_names import arm_color

OPACITY = {"initial": 0.25, "current": 0.3, "simulated": 0.6, "mixed": 0.4, "refined": 0.6, "flipped": 0.6}
OPACITY |= {"edited": 0.7}
OUTLINED = ("accepted", "best", "runner-up", "ground truth")
"""Drawn as a coarse wireframe around the others."""
_OUTLINE_FACES = 300
_BEND_RAD = np.deg2rad(28)
_FEWEST_EDGES = 12
_DISPLAY_MM = 0.2
_SIMPLIFY_FROM = 3000
_TEXTURE_PX = 512


Mesh = tuple[Float, NDArray[np.int32]]
"""Vertices (V, 3) [m] and faces (F, 3)."""


class PoseNodes:
    """Everything that moves with the object in focus."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: ObjectModel,
        n_arms: int,
        send: Callable[[Command], None],
        key: int = 0,
    ):
        """Makes the nodes; ``key`` tells those of several objects apart."""
        scene, mesh = server.scene, display_mesh(model)
        self.n_arms = n_arms
        self._nodes: dict[str, viser.SceneNodeHandle] = {}
        for name in STAGES:
            color, node = STAGE_COLORS[name], f"/cam/stages/{key}/{name.replace(' ', '_')}"
            if name in OUTLINED:
                self._nodes[name] = add_wireframe(scene, node, outline_of(model), color, 1.4)
            else:
                self._nodes[name] = add_mesh(scene, node, mesh, color, OPACITY[name])
        self._mover = add_mesh(scene, f"/cam/stages/{key}/moving", mesh)
        self._path = add_mesh(scene, f"/cam/stages/{key}/path", mesh, (255, 190, 90), 0.85)
        self._skin = add_skin(scene, f"/cam/stages/{key}/skin", model)
        self._ghosts = None
        if n_arms:
            colors = np.array([arm_color(j) for j in range(n_arms)], np.uint8)
            # Front faces alone: transparent ones of both sides are drawn in two passes, which software renderers feel.
            self._ghosts = scene.add_batched_meshes_simple(
                f"/cam/hypotheses/{key}", *mesh, np.tile([1.0, 0, 0, 0], (n_arms, 1)), np.zeros((n_arms, 3)),
                batched_colors=colors, batched_opacities=np.ones(n_arms), opacity=0.25, lod="off", side="front",
                cast_shadow=False, receive_shadow=False, visible=False,
            )  # fmt: skip

            @self._ghosts.on_click
            def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
                if event.instance_index is not None:
                    send(SelectArm(int(event.instance_index)))

    def show(self, snapshot: Snapshot) -> None:
        """Poses and visibility of all stages, ghosts and the simulated path."""
        layers = snapshot.options.layers
        for name, node in self._nodes.items():
            pose = snapshot.poses.get(name)
            if pose is not None:
                place(node, pose.T_cam_obj)
            # The edited pose is drawn by the gizmo that moves it.
            node.visible = pose is not None and name in layers and name != "edited"
        self._show_answer(snapshot)
        self._show_ghosts(snapshot)
        self._show_path(snapshot)

    def hide(self) -> None:
        """Takes the object from the screen; another one is in focus."""
        for node in (*self._nodes.values(), self._mover, self._path, self._skin):
            if node is not None:
                node.visible = False
        if self._ghosts is not None:
            self._ghosts.visible = False

    def _show_answer(self, snapshot: Snapshot) -> None:
        """The answer of a finished run, with its texture; among several objects it is drawn as the others are."""
        best = snapshot.poses.get("best")
        alone = len(snapshot.scene.objects) == 1
        self._mover.visible = snapshot.is_answer and alone and best is not None and "best" in snapshot.options.layers
        if self._mover.visible and best is not None:
            place(self._mover, best.T_cam_obj)
            self._mover.color = STAGE_COLORS["best"]
        if self._skin is not None:
            self._skin.visible = self._mover.visible
            if self._skin.visible and best is not None:
                self._mover.visible = False
                place(self._skin, best.T_cam_obj)

    def _show_ghosts(self, snapshot: Snapshot) -> None:
        if self._ghosts is None or snapshot.state is None:
            return
        Ts = [arm.current.T_cam_obj for arm in snapshot.state.arms]
        Ts += [h.T_cam_obj for h in snapshot.target.instance.hypotheses[len(Ts) :]]
        self._ghosts.batched_positions = np.array([T[:3, 3] for T in Ts], np.float32)
        self._ghosts.batched_wxyzs = np.array([quat_wxyz(T[:3, :3]) for T in Ts], np.float32)
        opacity = np.full(len(Ts), 1.0, np.float32)
        opacity[snapshot.arm] = 2.0 if snapshot.options.arm is not None else 1.0
        self._ghosts.batched_opacities = opacity
        self._ghosts.visible = "hypotheses" in snapshot.options.layers

    def _show_path(self, snapshot: Snapshot) -> None:
        path = snapshot.shown.path if snapshot.shown else None
        k = snapshot.options.path_pose
        if path is not None and k is not None:
            place(self._path, path.Ts_cam_obj[min(k, len(path.Ts_cam_obj) - 1)])
        self._path.visible = path is not None and k is not None

    def animation(self, snapshot: Snapshot) -> Iterator[None]:
        """The way of the iteration at the cursor, one picture per turn; ends as :meth:`show` has it."""
        iteration = snapshot.shown
        if iteration is None:
            return
        visible = {name: node.visible for name, node in self._nodes.items()}
        order = [s.name for s in iteration.stages if s.name != "current"] + ["accepted", "best"]
        for name in order:
            self._nodes[name].visible = False
        self._mover.visible = True
        if self._skin is not None:
            self._skin.visible = False
        for T_cam_obj, stage in way(iteration):
            place(self._mover, T_cam_obj)
            self._mover.color = STAGE_COLORS[stage]
            yield
            for name in order[: order.index(stage)] if stage in order else ():
                self._nodes[name].visible = visible[name]
        for name, was in visible.items():
            self._nodes[name].visible = was
        self._mover.visible = False
        self._show_answer(snapshot)

    def path_animation(self, snapshot: Snapshot) -> Iterator[int]:
        """The simulated path pose by pose; gives the index of the pose that is shown."""
        path = snapshot.shown.path if snapshot.shown else None
        if path is None:
            return
        self._path.visible = True
        for k, T_cam_obj in enumerate(path.Ts_cam_obj):
            place(self._path, T_cam_obj)
            yield k


def place(node: viser.SceneNodeHandle, T_cam_obj: Float) -> None:
    """Moves a node that lives in the camera frame."""
    node.position = T_cam_obj[:3, 3]
    node.wxyz = quat_wxyz(T_cam_obj[:3, :3])


def add_mesh(
    scene: viser.SceneApi,
    name: str,
    mesh: Mesh,
    color: RGB = (90, 200, 255),
    opacity: float | None = None,
) -> viser.MeshHandle:
    """A mesh that is not visible yet."""
    return scene.add_mesh_simple(
        name, *mesh, color=color, opacity=opacity, flat_shading=True, side="double", visible=False, cast_shadow=False,
        receive_shadow=False,
    )  # fmt: skip


def add_skin(scene: viser.SceneApi, name: str, model: ObjectModel) -> viser.GlbHandle | None:
    """A model with its texture, not visible yet; None where it has none."""
    skin = skin_of(model, _TEXTURE_PX)
    if skin is None:
        return None
    # trimesh writes its material as rough and not metallic only where that is said.
    material = PBRMaterial(baseColorTexture=PilImage.fromarray(skin.image), metallicFactor=0.0, roughnessFactor=1.0)
    looks = TextureVisuals(uv=skin.uv, material=material)
    mesh = trimesh.Trimesh(skin.vertices, skin.faces, visual=looks, process=False)
    return scene.add_mesh_trimesh(name, mesh, visible=False, cast_shadow=False, receive_shadow=False)


def add_wireframe(
    scene: viser.SceneApi, name: str, edges: NDArray[np.float32], color: RGB, width_px: float
) -> viser.LineSegmentsHandle:
    """The edges (E, 2, 3) of a mesh, not visible yet."""
    return scene.add_line_segments(name, edges, color, thickness=width_px, thickness_units="screen", visible=False)


def way(iteration: Iteration, n_between: int = 5) -> Iterator[tuple[Float, str]]:
    """Poses on the way through an iteration, each with the stage it leads to."""
    stages = iteration.stages
    for _ in range(3):
        yield stages[0].T_cam_obj, "current"
    for before, after in pairwise(stages):
        if after.name == "simulated" and iteration.path is not None:
            poses = list(iteration.path.Ts_cam_obj)
            for a, b in pairwise(poses):
                for k in range(1, 3):
                    yield between(a, b, k / 2), "simulated"
        else:
            for k in range(1, n_between + 1):
                yield between(before.T_cam_obj, after.T_cam_obj, k / n_between), after.name
        yield after.T_cam_obj, after.name
    for _ in range(4):
        yield iteration.accepted_stage.T_cam_obj, "accepted"


def between(T_a: Float, T_b: Float, share: float) -> Float:
    """A pose part of the way from one to another: position linear, rotation by blended quaternions."""
    q_a, q_b = quat_wxyz(T_a[:3, :3]), quat_wxyz(T_b[:3, :3])
    if q_a @ q_b < 0:
        q_b = -q_b
    position = (1 - share) * T_a[:3, 3] + share * T_b[:3, 3]
    return transform(rotation_of_quat_wxyz((1 - share) * q_a + share * q_b), position)


@lru_cache(maxsize=64)
def outline_of(model: ObjectModel) -> NDArray[np.float32]:
    """The edges of a model that are drawn, (E, 2, 3)."""
    return edges(*coarse_mesh(*display_mesh(model)))


@lru_cache(maxsize=64)
def display_mesh(model: ObjectModel) -> Mesh:
    """The mesh as it is drawn: the simplified one that is scored, where the original is large."""
    if len(model.faces) < _SIMPLIFY_FROM:
        return model.vertices, model.faces
    mesh = scoring_mesh(model, _DISPLAY_MM)
    return mesh.vertices, mesh.faces


def edges(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """The edges of a mesh at which it bends or ends, (E, 2, 3); all of them where it is too round to have many."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-18)
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, which = np.unique(pairs, axis=0, return_inverse=True)
    which = which.reshape(-1)
    # The sum of the two unit normals beside an edge is shorter the more the surface bends there; at a border it is 1.
    total = np.zeros((len(unique), 3))
    np.add.at(total, which, np.tile(normals, (3, 1)))
    bent = np.linalg.norm(total, axis=1) < 2 * np.cos(_BEND_RAD / 2)
    chosen = unique[bent] if bent.sum() >= _FEWEST_EDGES else unique
    return vertices[chosen].astype(np.float32)


def coarse_mesh(vertices: Float, faces: NDArray[np.int32]) -> Mesh:
    """A few hundred triangles, so that a wireframe can be looked through."""
    if len(faces) <= _OUTLINE_FACES:
        return vertices, faces
    scale = float(np.abs(vertices).max())
    coarse_vertices, coarse_faces = decimated(vertices / scale, faces, _OUTLINE_FACES)
    return coarse_vertices * scale, coarse_faces
