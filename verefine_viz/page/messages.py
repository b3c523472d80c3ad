"""Messages to a browser: those without a module of their own, and the list of all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from msgspec import UNSET, UnsetType

from verefine_viz.page.answers_to_wants import AnswerMessage
from verefine_viz.page.frame_messages import BranchesMessage, BreakpointsMessage, DoubtShown, FrameMessage
from verefine_viz.page.gallery_messages import AnswersMessage, FixMessage, ReportMessage
from verefine_viz.page.label_messages import LabelsMessage
from verefine_viz.page.palette_message import Palette
from verefine_viz.page.protocol import AnyVerb
from verefine_viz.page.run_messages import RunMessage, VerdictMessage
from verefine_viz.page.wire import Message, Part, Pose


class HelloMessage(Message, frozen=True):
    """The first after a connection; a page that meets another version reloads itself."""

    window: int
    """Number of this window; 0 in a file."""
    version: str
    palette: Palette
    correct: float
    """A pose is right below this share of the diameter."""


class ReadyMessage(Message, frozen=True):
    """All that is known has been sent."""


class FileMessage(Message, frozen=True):
    """Content of a page in a file."""

    command: str
    """Opens the same in the program."""
    maps: Literal["end", "marked", "all"]
    """Which iterations have score maps."""
    scene: bool
    """Whether it has the 3D view."""


class BusyMessage(Message, frozen=True):
    """Progress of long work."""

    text: str
    """What is being done; "" = nothing."""
    share: float | None = None
    """How much is done, 0 to 1."""
    cancel: bool = False
    """Whether it can be given up."""
    hulls: bool = False
    """Whether `open` with `hulls` alone restarts the opening, or the waiting run, with hulls."""
    picture: str | None = None
    """Blob of the photo of what is being opened."""


class RunningMessage(Message, frozen=True):
    """The branches that are being computed."""

    branch: int | None
    """The branch whose turn it is."""
    branches: Sequence[int]
    stopped: str
    """The breakpoint at which a run stopped last."""
    remaining_s: float | None


class DoubtsMessage(Message, frozen=True):
    """Doubts about the open frame's data, once they are known."""

    doubts: Sequence[DoubtShown]


class NoteMessage(Message, frozen=True):
    """A short message."""

    text: str


class OfferedVerb(Part, frozen=True):
    """What a button does nevertheless."""

    words: str
    verb: AnyVerb


class ErrorMessage(Message, frozen=True):
    """An error; everything is as before."""

    text: str
    offer: OfferedVerb | None


class WrittenMessage(Message, frozen=True):
    """A file was written."""

    name: str
    path: str | None
    """null: only handed to the browser, and kept nowhere else."""
    url: str
    """Where it can be downloaded."""
    note: str
    """What the file does not hold."""


class EditedMessage(Message, frozen=True):
    """The gizmo in 3D was dragged."""

    obj: int
    T: Pose


class PickedMessage(Message, frozen=True):
    """A pixel was clicked in 3D."""

    u: int
    v: int


class Scene3DMessage(Message, frozen=True):
    """The window that the 3D view follows."""

    window: int | None


class ViewPatch(Part, frozen=True):
    """Changes of what a window looks at; the rest stays."""

    branch: int | UnsetType = UNSET
    k: int | UnsetType = UNSET
    obj: int | UnsetType | None = UNSET
    stage: str | UnsetType | None = UNSET
    arm: int | UnsetType | None = UNSET
    moment: int | UnsetType | None = UNSET
    edited: UnsetType | None = UNSET
    """null: no pose is edited any more."""


class ViewMessage(Message, frozen=True):
    """What this window looks at from now on."""

    patch: ViewPatch
    at: int | UnsetType | None = UNSET
    """The iteration that a link names, shown once its row is there; null = the end."""


OpenMessage = FrameMessage | BranchesMessage | RunMessage | VerdictMessage
"""The messages that together say all that is known of the open frame."""
AnyMessage = (
    HelloMessage | FileMessage | FrameMessage | BranchesMessage | RunMessage | VerdictMessage | ReadyMessage
    | DoubtsMessage | BusyMessage | RunningMessage | NoteMessage | ErrorMessage | WrittenMessage | EditedMessage
    | PickedMessage | Scene3DMessage | ViewMessage | BreakpointsMessage | AnswerMessage | AnswersMessage | ReportMessage
    | LabelsMessage | FixMessage
)  # fmt: skip
