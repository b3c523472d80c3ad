"""The verbs that a browser sends, as typed structs: decoding one is checking it. ``docs/page.md`` lists them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from verefine_viz.core.errors import InputError

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

    def __init__(self, text: str, words: str, verb: Verb) -> None:
        super().__init__(text)
        self.offer = {"words": words, "verb": msgspec.to_builtins(verb)}


class Verb(Struct, forbid_unknown_fields=True, tag_field="verb", tag=lambda name: name.removesuffix("Verb").lower()):
    """Something that a window asks the server to do."""


class EditedPose(Struct, frozen=True, forbid_unknown_fields=True):
    """A pose that takes the place of a hypothesis's current one."""

    obj: int
    arm: Index
    T: Pose


class Grasp(Struct, frozen=True, forbid_unknown_fields=True):
    """The grasp that is drawn: by which pose, and which of its moments."""

    by: Literal["pose", "truth"] = "pose"
    moment: Index = 0


class Beside(Struct, frozen=True, forbid_unknown_fields=True):
    """The run that stands beside the one looked at."""

    branch: Index
    k: Index


class Look(Verb):
    """What a window shows; the 3D view follows the window used last."""

    branch: Index = 0
    k: Index = 0
    stage: Text | None = None
    """Last stage of iteration k that is shown; None = all of it."""
    obj: int | None = None
    """None = the object of the iteration."""
    arm: Index | None = None
    moment: Index | None = None
    """Moment of the simulated path; None = it is not drawn."""
    edited: Pose | None = None
    grasp: Grasp | None = None
    b: Beside | None = None
    answer: bool = False
    """Whether the answers of the finished run are shown instead of iteration k."""
    camera: Literal["sensor", "object", "first"] | None = None
    """Where to take the 3D view's camera."""


class Step(Verb):
    """Compute one more iteration at the end of a branch."""

    branch: Index = 0


class Seek(Verb):
    """Compute a branch on until it holds k iterations, breakpoints or not."""

    k: Index
    branch: Index = 0


class RunVerb(Verb):
    """Compute a branch on to its end, or to the next event; breakpoints stop both."""

    branch: Index = 0
    until: Literal["end", "event"] = "end"


class Pause(Verb):
    """Stop computing after the iteration at hand."""


class Cancel(Verb):
    """Give up what takes long, with everything as it was before."""


class Restart(Verb):
    """Begin the first run again with changed settings; the frame's branches are discarded."""

    branch: Index = 0
    changes: Changes = {}
    discard: bool = False
    """Whether other branches, and poses that were edited, may be lost."""


class Fork(Verb):
    """Leave a branch after iteration k with changed settings, or from an edited pose."""

    k: Index
    branch: Index = 0
    changes: Changes = {}
    edit: EditedPose | None = None
    run: bool = False


class Open(Verb):
    """Open something else; one of the fields says what."""

    frame: Text = ""
    demo: Text = ""
    session: Text = ""
    recording: Text = ""
    link: Text = ""
    answer: Index | None = None
    hulls: bool = False
    """Whether physics takes every model for its convex hull, so that nothing has to be decomposed."""


class Estimate(Verb):
    """New initial poses of one object, as a new branch."""

    obj: int
    estimator: str
    """Its name; "session": as the session has it."""
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
    """Change the order in which objects are solved, or what is in their way; one of the fields says what."""

    branch: Index = 0
    cut: tuple[int, int, bool] | None = None
    """(first, second, cut): whether what is seen between two instances counts no more."""
    move: tuple[int, int] | None = None
    """(instance, −1 or 1)."""
    drop: tuple[int, bool] | None = None
    """(number of an unknown object, whether it stops nothing)."""
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
    """What a want asks for; each kind stands beside its view."""


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


class ShadedWanted(Wanted):
    """A model as it would look at a pose."""

    obj: int
    T: Pose


class PhysicsWanted(Wanted):
    """Whether the objects can stand where they are, and what the simulation did."""

    branch: Index = 0
    k: Index = 0
    obj: int | None = None
    answer: bool = False
    edited: Pose | None = None


class LandscapeWanted(Wanted):
    """The score around the best pose of an object at an iteration."""

    obj: int
    branch: Index = 0
    k: Index = 0
    part: Literal["curves", "slice", "other"] = "curves"
    """Curves along all axes, the map over two of them, or what fits as well."""
    axes: tuple[Index, Index] = (5, 0)
    """Axes of the map: across and up."""


class ComparisonWanted(Wanted, tag="compare"):
    """Two branches side by side, iteration by iteration."""

    a: Index
    b: Index
    done: tuple[Index, Index] = (0, 0)
    """Iterations of both: a browser asks again when there are more."""


class CropsWanted(Wanted):
    """What a learned refiner saw in an iteration."""

    k: Index
    obj: int
    branch: Index = 0


class TrackWanted(Wanted):
    """An object over the frames of a sequence."""

    obj: int
    done: bool = False
    """Whether the open frame is solved: a browser asks again when it is."""


class RecordedWanted(Wanted):
    """What another program recorded of an object's poses, beside our scores."""

    obj: int
    branch: Index = 0
    done: Index = 0
    """Iterations that are there: a browser asks again when there are more."""


AnyWant = (
    MapsWanted
    | OutlinesWanted
    | ShadedWanted
    | PhysicsWanted
    | LandscapeWanted
    | ComparisonWanted
    | CropsWanted
    | TrackWanted
    | RecordedWanted
)


class Want(Verb):
    """Ask for what is needed to show something; of one slot the latest wins."""

    id: Text
    of: AnyWant
    slot: Annotated[str, Meta(max_length=40)] = ""


class Save(Verb):
    """Write a file: the session, a recording, the page, the table of results, the score maps, or the verbs."""

    what: Literal["session", "recording", "share", "results", "maps", "verbs"]
    branch: Index = 0
    k: Index = 0
    obj: int | None = None
    name: Annotated[str, Meta(max_length=120)] = ""
    replace: bool = False


class Tag(Verb):
    """Give answers of the gallery a tag, or take it away."""

    answers: Annotated[tuple[Index, ...], Meta(max_length=10_000)]
    tag: Annotated[str, Meta(max_length=80)]
    on: bool = True


AnyVerb = (
    Look | Step | Seek | RunVerb | Pause | Cancel | Restart | Fork | Open | Estimate | BranchVerb | Compare | Break
    | Order | Evaluate | Want | Save | Tag
)  # fmt: skip

_DECODER = msgspec.json.Decoder(AnyVerb)


def read_verb(text: str | bytes) -> AnyVerb:
    """Decode a message of a browser.

    Raises:
        InputError: it is no verb.
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


def write_verb(verb: AnyVerb) -> str:
    """Encode a verb as a line of the log."""
    return encoded(verb).decode()
