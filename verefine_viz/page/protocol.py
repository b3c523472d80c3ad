"""The verbs that a browser sends, as typed structs: decoding one is checking it. ``docs/page.md`` lists them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import as_rigid

Index = Annotated[int, Meta(ge=0, le=100_000)]
Text = Annotated[str, Meta(max_length=4096)]
Pose = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]
"""T_cam_obj by rows [m]."""
Changes = dict[Text, Any]
"""Settings by dotted name."""
MOST_POSES = 4096


class UnconfirmedError(InputError):
    """Something would be lost: nothing was done.

    Args:
        text: what would be lost.
        words: of the button that does it all the same.
        verb: what the button sends.
    """

    def __init__(self, text: str, words: str, verb: AnyVerb) -> None:
        super().__init__(text)
        self.words, self.verb = words, verb


class Verb(Struct, forbid_unknown_fields=True, tag_field="verb", tag=lambda name: name.removesuffix("Verb").lower()):
    """Something that a window asks the server to do."""


class EditedPose(Struct, frozen=True, forbid_unknown_fields=True):
    """A pose that replaces the current one of a hypothesis."""

    obj: int
    arm: Index
    T: Pose


class DrawnPose(Struct, frozen=True, array_like=True):
    """An object as the 3D view draws it at a pose: ``[obj, T, role, opacity]``."""

    obj: int
    T: Pose
    role: Annotated[str, Meta(max_length=40)]
    """The name of a stage, which gives the colour; "body": an object that is not in focus, in its own colour;
    "gizmo": the edited pose, with handles; "B": the run beside."""
    opacity: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Opacity of its body; 0 = an outline."""


class DrawnHypothesis(Struct, frozen=True, array_like=True):
    """A hypothesis of the object in focus as a ghost in the 3D view: ``[T, share]``."""

    T: Pose
    share: Annotated[float, Meta(ge=0, le=1)]
    """Its rank by score in what is known of the run: 0 = the lowest, 1 = the highest."""


class PathMoment(Struct, frozen=True, forbid_unknown_fields=True):
    """The simulated path of an iteration, and which of its moments is drawn."""

    k: Annotated[int, Meta(ge=1, le=100_000)]
    moment: Index | None = None
    """None = the path is not drawn, only the contacts at its end."""


class Grasp(Struct, frozen=True, forbid_unknown_fields=True):
    """The grasp that is drawn: at which pose, by the answer or the ground truth, and at which moment."""

    T: Pose
    by: Literal["pose", "truth"] = "pose"
    moment: Index = 0


Pixel = tuple[Index, Index]
Layer3D = Literal["cloud", "photo", "plane", "gravity", "other objects", "own colours", "contacts", "overlaps"]
CloudColors = Literal["photo", "distance to model", "normals", "class"]
CameraPlace = Literal["sensor", "object", "first"]
WHOLE_SCENE = 4.0


class SceneLook(Struct, frozen=True, forbid_unknown_fields=True):
    """What the 3D view shows of a frame besides poses, and how."""

    hidden: tuple[Layer3D, ...] = ()
    cloud: CloudColors = "photo"
    box: Annotated[float, Meta(ge=0.2, le=WHOLE_SCENE)] = WHOLE_SCENE
    """Side of the box around the object in focus to which the view is limited [diameters]; 4 = no limit."""
    cut: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Share of the object in focus that is cut away, from the front."""
    gizmo_px: Annotated[float, Meta(ge=40, le=800)] = 170.0
    text_px: Annotated[float, Meta(ge=6, le=60)] = 13.0


class Look(Verb):
    """What a window shows; the 3D view follows the window used last, and draws what it names."""

    branch: Index = 0
    k: Index = 0
    """Iteration by whose settings poses are scored."""
    obj: int | None = None
    """The object in focus; None = no object: the frame is drawn."""
    draw: Annotated[tuple[DrawnPose, ...], Meta(max_length=MOST_POSES)] = ()
    hypotheses: Annotated[tuple[DrawnHypothesis, ...], Meta(max_length=MOST_POSES)] = ()
    """Hypotheses of the object in focus."""
    arm: Index = 0
    """The hypothesis that is drawn more clearly."""
    allowed: Annotated[tuple[Pose, ...], Meta(max_length=MOST_POSES)] = ()
    """Poses of the object in focus that the image allows."""
    axes: Annotated[tuple[Pose, ...], Meta(max_length=2)] = ()
    """Poses of the object in focus whose axes are drawn."""
    path: PathMoment | None = None
    grasp: Grasp | None = None
    camera: CameraPlace | None = None
    """Where to take the 3D view's camera."""
    scene: SceneLook = SceneLook()
    pixel: Pixel | None = None
    """Pixel whose ray, and the point that it sees, are drawn."""
    ruler: tuple[Pixel, Pixel] | None = None


class Step(Verb):
    """Compute one more iteration at the end of a branch."""

    branch: Index = 0


class Seek(Verb):
    """Go on computing a branch until it holds k iterations, whatever the breakpoints."""

    k: Index
    branch: Index = 0


class RunVerb(Verb):
    """Go on computing a branch to its end, or to the next event; breakpoints stop both."""

    branch: Index = 0
    until: Literal["end", "event"] = "end"


class Pause(Verb):
    """Stop computing after the iteration at hand."""


class Cancel(Verb):
    """Cancel long work, leaving everything as it was before."""


class Restart(Verb):
    """Begin the first run again with changed settings; the frame's branches are discarded."""

    branch: Index = 0
    changes: Changes = {}
    discard: bool = False
    """Whether other branches and edited poses may be lost."""
    run: bool = False
    """Whether it then runs to its end."""


class Fork(Verb):
    """Fork a branch after iteration k, with changed settings or from an edited pose."""

    k: Index
    branch: Index = 0
    changes: Changes = {}
    edit: EditedPose | None = None
    run: bool = False


class Refine(Verb):
    """Begin a branch in which a pose is the only hypothesis of its object; other objects begin where they stand."""

    obj: int
    T: Pose
    k: Index
    """The iteration after which the other objects' poses are taken."""
    branch: Index = 0
    run: bool = True


class Open(Verb):
    """Open something; one of the fields says what."""

    frame: Text = ""
    object: Index | None = None
    """With a frame: the model that comes into focus."""
    demo: Text = ""
    session: Text = ""
    recording: Text = ""
    batch: Text = ""
    """Folder of a batch, or of several."""
    link: Text = ""
    answer: Index | None = None
    beside: Text = ""
    """For an answer: a recorded run of its frame, to be put beside it as B, both at their ends."""
    label: bool = False
    """The frames of the open session, to be labelled."""
    hulls: bool = False
    """Whether physics uses the convex hull of every model, so that nothing has to be decomposed."""


class Estimate(Verb):
    """New initial poses of one object, as a new branch."""

    obj: int
    estimator: str
    """Name of the estimator; "session": the session's own."""
    branch: Index = 0


class BranchVerb(Verb):
    """Name a branch, or remove it."""

    index: Index
    name: Annotated[str, Meta(max_length=80)] = ""
    remove: bool = False


class Compare(Verb):
    """Put a run beside branch ``a``: another branch, a run from the start with changed settings, or a recording."""

    a: Index = 0
    b: Index | None = None
    changes: Changes | None = None
    recording: Text = ""
    run: bool = True
    stop: bool = False


class Break(Verb):
    """Change when a run stops and waits."""

    changes: Changes


class Order(Verb):
    """Change the order in which objects are solved, or what stops them; one of the fields says what."""

    branch: Index = 0
    cut: tuple[int, int, bool] | None = None
    """(first, second, cut): whether the edge between two instances is ignored."""
    move: tuple[int, int] | None = None
    """(instance, −1 or 1)."""
    drop: tuple[int, bool] | None = None
    """(number of an unknown object, whether it is dropped and stops nothing)."""
    reset: bool = False
    discard: bool = False
    """As of ``Restart``."""


class Evaluate(Verb):
    """Compute something that takes long and send it as the answer ``id``."""

    id: Text
    what: Literal["grasp"]
    obj: int
    T: Pose
    branch: Index = 0
    k: Index = 0


class Wanted(
    Struct, forbid_unknown_fields=True, tag_field="what", tag=lambda name: name.removesuffix("Wanted").lower()
):
    """What a want asks for; each kind belongs to a view."""


class MapsWanted(Wanted):
    """The score of a pose, or of several together, pixel by pixel."""

    branch: Index = 0
    k: Index = 0
    obj: int | None = None
    T: Pose | None = None
    poses: Annotated[tuple[tuple[int, Pose], ...], Meta(max_length=64)] = ()


class OutlinesWanted(Wanted):
    """The outlines of a model in the image at some poses."""

    obj: int
    poses: Annotated[tuple[Pose, ...], Meta(max_length=MOST_POSES)]


class DoubtWanted(Wanted):
    """The evidence of a doubt about the data in the image."""

    index: Index
    """Index in the list of the frame or the verdict."""
    branch: Index = 0


class MomentDrawn(Struct, frozen=True, array_like=True):
    """The picture of a key moment: ``[k, poses, map, layer]``."""

    k: Index
    """Iteration by whose settings it is scored."""
    poses: Annotated[tuple[tuple[Text, Pose], ...], Meta(max_length=MOST_POSES)]
    """By role; the map is that of the first."""
    map: Text
    layer: Text = ""
    """Further layer: mask, plane, axes; "" = none."""


class FilmWanted(Wanted):
    """Pictures of the key moments of an object."""

    obj: int
    moments: Annotated[tuple[MomentDrawn, ...], Meta(max_length=8)]
    branch: Index = 0


class ShadedWanted(Wanted):
    """A model as it would look at a pose."""

    obj: int
    T: Pose


class Standing(Struct, frozen=True, array_like=True):
    """An object at its current pose: ``[obj, T, waits]``."""

    obj: int
    T: Pose
    waits: bool = False
    """Whether its turn is still to come, so that it stands at an initial pose."""


class PhysicsWanted(Wanted):
    """Whether the objects' poses are stable, and what the simulation did."""

    obj: int
    """The object in focus."""
    branch: Index = 0
    k: Index = 0
    """Iteration by whose settings it is worked out."""
    poses: Annotated[tuple[tuple[Text, Pose], ...], Meta(max_length=8)] = ()
    """Poses of the focus to examine in detail, by name: before and after."""
    stands: Annotated[tuple[Standing, ...], Meta(max_length=MOST_POSES)] = ()
    alone: bool = False
    """Whether only the focus is examined, among the others at their poses."""
    path: Index | None = None
    """Iteration whose simulated path is shown."""


class RefinedWanted(Wanted):
    """The result of refining a pose: refined, settled and verified among the other objects at their poses."""

    obj: int
    T: Pose
    branch: Index = 0
    stands: Annotated[tuple[Standing, ...], Meta(max_length=MOST_POSES)] = ()


class PointWanted(Wanted):
    """The point measured at a pixel, and its distance from the objects at their poses."""

    pixel: Pixel
    branch: Index = 0
    stands: Annotated[tuple[Standing, ...], Meta(max_length=MOST_POSES)] = ()


class LandscapeWanted(Wanted):
    """The score around a pose of an object."""

    obj: int
    T: Pose
    branch: Index = 0
    k: Index = 0
    part: Literal["curves", "slice", "other"] = "curves"
    """Curves along all axes, the map over two of them, or distant poses that fit as well."""
    axes: tuple[Index, Index] = (5, 0)
    """Axes of the map: across and up."""


class ComparisonWanted(Wanted, tag="compare"):
    """Two branches side by side, iteration by iteration."""

    a: Index
    b: Index
    done: tuple[Index, Index] = (0, 0)
    """Iterations of both that exist: a browser asks again when there are more."""


class CropsWanted(Wanted):
    """What a learned refiner saw in an iteration."""

    k: Annotated[int, Meta(ge=1, le=100_000)]
    branch: Index = 0


class SequenceWanted(Wanted):
    """The objects of a scene over its frames."""

    run: Text = ""
    """A run of the open batch; "" = that of the open frame, or none."""
    scene: Index | None = None
    """null = that of the open frame."""
    done: Index = 0
    """Number of answers so far: a browser asks again when there are more."""


class RecordedWanted(Wanted):
    """What another program recorded of an object's poses, beside our scores."""

    obj: int
    branch: Index = 0
    done: Index = 0
    """Number of iterations so far: a browser asks again when there are more."""


AnyWant = (
    MapsWanted | OutlinesWanted | DoubtWanted | ShadedWanted | PhysicsWanted | PointWanted | RefinedWanted
    | LandscapeWanted | ComparisonWanted | CropsWanted | SequenceWanted | RecordedWanted | FilmWanted
)  # fmt: skip


class Want(Verb):
    """Ask for what is needed to show something; of one slot the latest wins."""

    id: Text
    of: AnyWant
    slot: Annotated[str, Meta(max_length=40)] = ""


class Save(Verb):
    """Write a file: the session, a recording, the page, the table of results, the score maps, the film, the verbs."""

    what: Literal["session", "recording", "share", "results", "maps", "film", "verbs"]
    branch: Index = 0
    k: Index = 0
    """For maps: the iteration that is shown."""
    obj: int | None = None
    """For maps and film: the object."""
    poses: Annotated[tuple[tuple[Text, Pose], ...], Meta(max_length=8)] = ()
    """For maps: the poses of the object, by name."""
    name: Annotated[str, Meta(max_length=120)] = ""
    replace: bool = False


class Tag(Verb):
    """Give answers of the gallery a tag, or take it away."""

    answers: Annotated[tuple[Index, ...], Meta(max_length=10_000)]
    tag: Annotated[str, Meta(max_length=80)]
    on: bool = True


class Fix(Verb):
    """Try the remedies of causes on the answers of the gallery, end a trial, or write the session with some of them."""

    every: bool = False
    """Whether each remedy is tried on all wrong answers; else on those with its causes."""
    take: Annotated[tuple[Text, ...], Meta(max_length=100)] = ()
    """Remedies that are also tried together; or that are written."""
    write: Text = ""
    """The session file that is written; "" = none."""
    stop: bool = False


class Place(Verb):
    """Place an object in a frame for labelling, where the photo was clicked: upright, at the depth there."""

    obj_id: Index
    pixel: Pixel


class Find(Verb):
    """Search for an object inside a box, or on the pixels that a scribble covers; the best poses become its
    candidates.
    """

    obj_id: Index
    box: tuple[Index, Index, Index, Index] | None = None
    """Left, top, right, bottom [px]."""
    scribble: Annotated[tuple[Pixel, ...], Meta(max_length=10_000)] = ()


class Snap(Verb):
    """Refine a labelled object from a pose, settle it and verify it."""

    obj: int
    T: Pose


class Decide(Verb):
    """Set the state of a label, or remove it."""

    obj: int
    state: Literal["accepted", "uncertain", "proposed", "removed"]
    note: Annotated[str, Meta(max_length=400)] = ""


class UndoLabel(Verb):
    """Undo the last change of the frame's labels, or redo it."""

    redo: bool = False


class Carry(Verb):
    """Carry the labels of the frame to those that follow, until one needs a person."""

    most: Annotated[int, Meta(ge=1, le=100_000)] = 100_000
    """Frames."""


class Export(Verb):
    """Write the labels as the ground truth of a BOP data set."""

    out: Text = ""
    """Folder of a data set that is written; none = into the data set itself."""
    uncertain: bool = False
    """Whether uncertain ones are written, too."""
    symmetries: Annotated[tuple[Index, ...], Meta(max_length=1000)] = ()
    """Objects whose proposed symmetries the user confirmed."""
    overwrite: bool = False


AnyVerb = (
    Look | Step | Seek | RunVerb | Pause | Cancel | Restart | Fork | Refine | Open | Estimate | BranchVerb | Compare
    | Break | Order | Evaluate | Want | Save | Tag | Fix | Place | Find | Snap | Decide | UndoLabel | Carry | Export
)  # fmt: skip

_DECODER = msgspec.json.Decoder(AnyVerb)


def read_verb(text: str | bytes) -> AnyVerb:
    """Decode a message of a browser.

    Raises:
        InputError: it is not a verb.
    """
    try:
        return _DECODER.decode(text)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise InputError(f"not a verb: {error}") from None


def encoded(message: Any) -> bytes:
    """Encode what a browser gets; half characters, as in names of files that are no UTF-8, become "?"."""
    try:
        return msgspec.json.encode(message, enc_hook=_plain)
    except UnicodeEncodeError:
        return msgspec.json.encode(_whole(msgspec.to_builtins(message, enc_hook=_plain)))


def _plain(value: Any) -> Any:
    """Write numpy's numbers and arrays, and sets, as JSON can."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, set | frozenset):
        return sorted(value)
    raise TypeError(f"{type(value).__name__} cannot be sent to the page")


def _whole(value: Any) -> Any:
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, dict):
        return {_whole(key): _whole(one) for key, one in value.items()}
    return [*map(_whole, value)] if isinstance(value, list | tuple) else value


def pose_matrix(values: Sequence[float]) -> Float:
    """Return a pose (4, 4) that came from a browser as 16 numbers by rows, made rigid.

    Raises:
        ShapeError: it is no rigid pose.
    """
    return as_rigid(np.array(values, float).reshape(4, 4), "pose")


def write_verb(verb: AnyVerb) -> str:
    """Encode a verb as a line of the log."""
    return encoded(verb).decode()
