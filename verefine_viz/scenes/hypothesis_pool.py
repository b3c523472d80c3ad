"""Initial poses out of results files, or made from ground truth: whose each row is, and the order they are tried in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.frame_names import FrameIds, frame_name, parse_frame
from verefine_viz.core.geometry import FARTHEST_M, axis_angle, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Hypothesis
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.core.text_format import listed
from verefine_viz.scenes.results_csv import ResultRow, method_of
from verefine_viz.scenes.results_files import read_estimates
from verefine_viz.scenes.segments import Segment, best_owner, silhouette

NEAREST_M = 0.02
"""No sensor sees an object whose origin is nearer than this [m]; in metres, read as millimetres, up to 20 m are."""


@dataclass(frozen=True, eq=False)
class ResultsFile:
    """The estimates of one method."""

    name: str
    """The file's own, for messages."""
    method: str
    rows: dict[tuple[int, int, int], tuple[ResultRow, ...]]
    """By (scene, image, object), highest score first; rows of equal score keep the file's order. No pose is
    there twice."""
    n_repeated: int = 0
    """Rows that were dropped because they repeat a pose of the same object in the same frame."""
    n_far: int = 0
    """Rows that were dropped because they lie further away than ``FARTHEST_M``."""
    notes: tuple[str, ...] = ()
    """About rows that cannot be used, and about rounded rotations."""

    def objects(self) -> dict[FrameIds, set[int]]:
        """The objects that have rows, by frame."""
        objects: dict[FrameIds, set[int]] = {}
        for scene_id, im_id, obj_id in self.rows:
            objects.setdefault((scene_id, im_id), set()).add(obj_id)
        return objects


def open_results(path: Path | str) -> ResultsFile:
    """A results file, ready to be asked for an object of a frame.

    Raises:
        InputError: as :func:`read_estimates`, or every pose lies further away than ``FARTHEST_M``.
    """
    grouped: dict[tuple[int, int, int], list[ResultRow]] = {}
    read = read_estimates(path)
    rows = read.rows
    near = [row for row in rows if np.linalg.norm(row.T_cam_obj[:3, 3]) <= FARTHEST_M]
    if not near:
        raise InputError(
            f"{path}: every pose lies more than {FARTHEST_M:g} m from the camera; BOP wants t in millimetres, expected "
            f"at most {FARTHEST_M * 1e3:g}"
        )
    for row in near:
        grouped.setdefault((row.scene_id, row.im_id, row.obj_id), []).append(row)
    # Two starts from one pose would do the same, twice; the better score stays.
    ranked = {key: _each_once(sorted(rows, key=lambda r: -r.score)) for key, rows in grouped.items()}
    n_repeated = sum(len(rows) - len(ranked[key]) for key, rows in grouped.items())
    return ResultsFile(Path(path).name, method_of(path), ranked, n_repeated, len(rows) - len(near), read.notes)


def _each_once(rows: Sequence[ResultRow]) -> tuple[ResultRow, ...]:
    """The first row of each pose."""
    by_pose: dict[bytes, ResultRow] = {}
    for row in rows:
        by_pose.setdefault(row.T_cam_obj.tobytes(), row)
    return tuple(by_pose.values())


def results_of(hypotheses: HypothesesSettings) -> tuple[ResultsFile, ...]:
    """The results files that initial poses come from, in the order of trust; none where they come from elsewhere.

    Raises:
        SettingsError: no file is named.
        InputError: as :func:`read_estimates`.
    """
    if hypotheses.source != "results":
        return ()
    if not hypotheses.files:
        raise SettingsError("hypotheses.source is 'results' but hypotheses.files is empty; name a BOP results CSV")
    paths = [Path(path) for path in hypotheses.files]
    files = [open_results(path) for path in paths]
    often = Counter(file.method for file in files)
    # Methods of the same name are called by their folders as well: "posecnn/results".
    return tuple(
        replace(file, method=f"{path.resolve().parent.name}/{file.method}") if often[file.method] > 1 else file
        for path, file in zip(paths, files, strict=True)
    )


def file_notes(files: Sequence[ResultsFile]) -> tuple[str, ...]:
    """What is odd about the poses of a file (rounded, in metres, repeated, none at all), and what is done about it."""
    notes: list[str] = []
    for file in files:
        notes += file.notes
        if all(np.linalg.norm(row.T_cam_obj[:3, 3]) < NEAREST_M for rows in file.rows.values() for row in rows):
            notes.append(
                f"{file.name}: every pose lies within {NEAREST_M * 1e3:g} mm of the camera, so t looks like metres; "
                "BOP wants millimetres: multiply t by 1000"
            )
        if file.n_far:
            which = "row gives no pose: it lies" if file.n_far == 1 else "rows give no pose: they lie"
            notes.append(
                f"{file.name}: {file.n_far} {which} more than {FARTHEST_M:g} m from the camera; BOP wants t in "
                "millimetres"
            )
        if file.n_repeated:
            which = "row repeats" if file.n_repeated == 1 else "rows repeat"
            notes.append(
                f"{file.name}: {file.n_repeated} {which} a pose of the same object in the same frame; each pose is "
                "tried once"
            )
    return tuple(notes)


def check_covered(
    files: Sequence[ResultsFile],
    hypotheses: HypothesesSettings,
    frames: Sequence[FrameIds],
    objects_of: Callable[[FrameIds], Collection[int] | None],
) -> tuple[str, ...]:
    """Checks that the rows of ``files`` are of objects that are asked for in ``frames``.

    Args:
        files: none where initial poses come from elsewhere.
        hypotheses: whose files they are.
        frames: the chosen ones.
        objects_of: the objects that are asked for in a frame; None where that is unknown.

    Returns:
        Which files have no such row, where others do.

    Raises:
        InputError: not a single row is; the message names what they hold and what is needed.
    """
    if not files or hypotheses.estimate:  # An estimator is asked for what the files do not have.
        return ()
    held = [(file, file.objects()) for file in files]
    unused, there, needed = held, set[int](), set[int]()
    for ids in frames:
        wanted = objects_of(ids)
        unused = [(file, objects) for file, objects in unused if not _has_any(objects.get(ids), wanted)]
        if not unused:
            return ()
        there = there.union(*(objects.get(ids, ()) for _, objects in held))
        needed |= set(wanted or ())
    if len(unused) < len(held):
        return tuple(
            f"{file.name} has no row for an object of the chosen frames and gives no pose" for file, _ in unused
        )
    if there and not needed:  # Why a frame holds nothing is reported when it is read.
        return ()
    who = f"{', '.join(file.name for file in files)} {'has' if len(files) == 1 else 'have'} no row"
    if not there:
        elsewhere = dict.fromkeys(chain.from_iterable(objects for _, objects in held))
        rows, chosen = listed(frame_name(ids) for ids in elsewhere), listed(frame_name(ids) for ids in frames)
        raise InputError(f"{who} for the chosen frames ({chosen}), only for {rows}; choose other frames or files")
    raise InputError(
        f"{who} for an object of the chosen frames: the frames need {listed(needed)}, the rows are of {listed(there)}; "
        "check the object ids, or choose other files"
    )


def _has_any(objects: set[int] | None, wanted: Collection[int] | None) -> bool:
    return objects is not None and (wanted is None or not objects.isdisjoint(wanted))


def pools_of_frame(
    files: Sequence[ResultsFile],
    ids: FrameIds,
    segments: Sequence[Segment],
    models: Mapping[int, ObjectModel],
    camera: Camera,
    hypotheses: HypothesesSettings,
) -> dict[int, tuple[Hypothesis, ...]]:
    """The hypotheses of the instances of a frame, by instance_id; none where an estimator makes them later.

    Args:
        files: those of ``hypotheses``, in the order of trust.
        ids: of the frame.
        segments: all instances, also those not asked for.
        models: by obj_id; instances of other objects get no row of the files.
        camera: of the frame.
        hypotheses: where they come from.
    """
    pools: dict[int, tuple[Hypothesis, ...]] = {s.instance_id: () for s in segments}
    h = hypotheses
    if h.source == "results":
        for obj_id, model in models.items():
            same = [s for s in segments if s.obj_id == obj_id]
            of_object = _pools_of_object(files, ids, same, model, camera, h.max_per_object)
            pools |= {s.instance_id: pool for s, pool in zip(same, of_object, strict=True)}
    elif h.source == "perturb":
        for s in segments:
            if s.T_cam_obj_gt is not None:
                seed = (h.seed, *ids, s.instance_id)
                pools[s.instance_id] = perturbed(
                    s.T_cam_obj_gt, h.max_per_object, h.rotation_deg, h.translation_mm, seed
                )
    return pools


def _pools_of_object(
    files: Sequence[ResultsFile],
    ids: FrameIds,
    segments: Sequence[Segment],
    model: ObjectModel,
    camera: Camera,
    max_per_object: int,
) -> tuple[tuple[Hypothesis, ...], ...]:
    """The hypotheses of each instance of one object, best first.

    The files take turns: the best row of the first file, the best of the second, …, then their second bests. Scores of
    different methods cannot be compared, and so the cut at ``max_per_object`` starves no file; the order of the files
    is the order of trust. Where there are several instances, a row belongs to the one whose mask its outline overlaps
    most.
    """
    per_file: list[list[list[Hypothesis]]] = []
    for file in files:
        owned: list[list[Hypothesis]] = [[] for _ in segments]
        for row in file.rows.get((*ids, model.obj_id), ()):
            k = 0
            if len(segments) > 1:
                k = best_owner(silhouette(model, row.T_cam_obj, camera), [s.mask for s in segments])
            owned[k].append(Hypothesis(row.T_cam_obj, row.score, file.method))
        per_file.append(owned)
    pools = []
    for k in range(len(segments)):
        turns = chain.from_iterable(zip_longest(*(owned[k] for owned in per_file)))
        pools.append(tuple(h for h in turns if h is not None)[:max_per_object])
    return tuple(pools)


def perturbed(
    T_cam_obj_gt: Float, n: int, rotation_deg: float, translation_mm: float, seed: int | Sequence[int]
) -> tuple[Hypothesis, ...]:
    """``n`` poses, each turned by exactly ``rotation_deg`` and moved by exactly ``translation_mm``.

    The axis (through the object's origin) and the direction are uniform on the sphere. The first k of n poses are the
    same for every n.

    Args:
        T_cam_obj_gt: (4, 4) ground truth [m].
        n: how many.
        rotation_deg: angle [deg].
        translation_mm: distance [mm].
        seed: non-negative; several numbers (seed, scene, image, instance) make frames independent of each other.

    Source: VeREFINE, Sec. V-A (docs/methods.md 8.1).
    """
    rng = np.random.default_rng(seed)
    poses = []
    for k in range(n):
        axis, direction = random_unit_vector(rng), random_unit_vector(rng)
        R = axis_angle(axis, np.radians(rotation_deg)) @ T_cam_obj_gt[:3, :3]
        t = T_cam_obj_gt[:3, 3] + direction * translation_mm * 1e-3
        poses.append(Hypothesis(transform(R, t), 1.0, f"perturbed {rotation_deg:g}° {translation_mm:g} mm #{k + 1}"))
    return tuple(poses)


# Instances whose initial poses come from an estimator, wherever those of the others come from.


def asked_estimators(hypotheses: HypothesesSettings) -> dict[tuple[str, int], str]:
    """The estimator of each frame's instance that ``hypotheses.estimate`` names; frames as "scene/image".

    Raises:
        SettingsError: a frame is something else, or an instance is named twice.
    """
    asked: dict[tuple[str, int], str] = {}
    for frame, instance_id, estimator in hypotheses.estimate:
        try:
            name = frame_name(parse_frame(frame))
        except SettingsError as error:
            raise SettingsError(f"hypotheses.estimate: {error}") from None
        if (name, instance_id) in asked:
            raise SettingsError(f"hypotheses.estimate names instance {instance_id} of frame {name} twice; name it once")
        asked[name, instance_id] = estimator
    return asked


def check_asked(hypotheses: HypothesesSettings, check_frame: Callable[[str], None]) -> None:
    """Checks that the frames of ``hypotheses.estimate`` exist; which instances they have is known when they are read.

    Args:
        hypotheses: what is asked for.
        check_frame: raises where there is no such frame.

    Raises:
        SettingsError: see :func:`asked_estimators`.
        InputError: there is no such frame.
    """
    for frame, _ in asked_estimators(hypotheses):
        try:
            check_frame(frame)
        except VerefineError as error:
            raise InputError(f"hypotheses.estimate: {error}") from None
