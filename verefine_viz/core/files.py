"""The door: every file that comes from outside is opened here, and an error in it becomes one line.

The line is in words of this program. What a library said is the context of the error, which ``--debug`` prints.
"""

from __future__ import annotations

import codecs
import gzip
import io
import math
import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, Generic, Literal, TypeVar, get_args

import msgspec
import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ContentError, InputError, VerefineError, one_line, quoted

MOST_BYTES = 2_000_000_000
"""Largest size of a file that is read, unless its reader sets a lower one."""
MOST_JSON_BYTES = 1_000_000_000
"""Largest JSON file, and largest text that a .json.gz unpacks to."""
MOST_YAML_BYTES = 10_000_000
"""Largest YAML file: reading one takes eighty times as much memory."""
LONGEST = 300
"""Length of an error that is shown [characters]."""
LEVELS_BELOW = 3
"""Depth of the search below a folder that was named by mistake."""
_CUT_OFF = re.compile(
    r"truncated|ended before|EOFError|\bEOF|No data left|read all data|expected length|to its end|no element found|"
    r"unclosed token|failed finding central|requires a buffer of|could not read bytes|"
    r"cannot reshape array of size \d+ into shape \(\d+,\)",
    re.IGNORECASE,
)
"""Words of libraries for a file that ends too early."""
KINDS_OF_FILE = {
    "a PLY mesh": (".ply",),
    "an OBJ mesh": (".obj",),
    "an STL mesh": (".stl",),
    "a glTF mesh": (".glb", ".gltf"),
    "an image": (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".gif", ".tga", ".webp"),
    "an array of numpy": (".npy",),
    "an archive of numpy arrays": (".npz",),
    "a MATLAB file": (".mat",),
    "an ONNX network": (".onnx",),
    "a file of torch's weights": (".pth", ".pt", ".checkpoint"),
    "JSON": (".json", ".gz", ".jsonl"),
    "YAML": (".yml", ".yaml"),
    "XML": (".xml",),
    "a table": (".csv",),
    "text": (".txt", ".mtl"),
}
"""Expected content of a file, by its ending."""
_SHOULD_BE = {ending: kind for kind, endings in KINDS_OF_FILE.items() for ending in endings}
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)

T = TypeVar("T")


@contextmanager
def reading(path: Path, what: str = "", most_bytes: int = MOST_BYTES) -> Iterator[BinaryIO]:
    """Open a regular file for reading; whatever is raised inside names the file in one line.

    Args:
        path: the file; links are followed.
        what: what the file is, before its path in messages ("session file").
        most_bytes: size above which it is refused.

    Raises:
        InputError: it is missing, no regular file or too large, or an exception was raised inside. One that already
            names its file passes as it is.
    """
    name = f"{what} {path}".lstrip()
    try:
        with opened(path, name, most_bytes) as file:
            yield file
    except Exception as error:
        if isinstance(error, VerefineError) and not isinstance(error, ContentError):
            raise
        raise InputError(f"{name}: {_fault(error, path)}") from None


def _fault(error: Exception, path: Path) -> str:
    """One line on the error in a file that was being read."""
    is_empty = path.is_file() and path.stat().st_size == 0
    how = "empty" if is_empty else "cut off" if _CUT_OFF.search(f"{type(error).__name__} {error}") else ""
    line = first_line(error, _SHOULD_BE.get(path.suffix.lower(), ""))
    if not how:
        return line
    # What is left of it may look like many things, so that only words of this program say more.
    return f"{line}; it is {how}, fetch it again" if isinstance(error, ContentError) else f"it is {how}, fetch it again"


def read_file(path: Path, what: str = "", most_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a file; as :func:`reading`."""
    with reading(path, what, most_bytes) as file:
        return file.read()


def first_line(error: Exception, should_be: str = "") -> str:
    """Describe what was raised in one line: in the words of this program or of the system, never in a library's.

    Args:
        error: what was raised.
        should_be: what was read, as "a PLY mesh".
    """
    if isinstance(error, MemoryError):
        return "it does not fit into memory"
    if isinstance(error, VerefineError):
        return one_line(str(error))[:LONGEST]
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, UnicodeDecodeError):
        return "it is no text in UTF-8"
    return f"it cannot be read as {should_be or 'what it should be'}: it is damaged, or of another kind"


def opened(path: Path, name: str = "", most_bytes: int = MOST_BYTES) -> BinaryIO:
    """Open a regular file, which the caller closes; ``name`` is what messages call it.

    Raises:
        InputError: it is missing, no regular file, too large, or cannot be read.
    """
    name = name or str(path)
    try:
        # Before it is opened: opening a device can do something, and opening a pipe waits for its other end.
        _check_regular(os.stat(path), name, most_bytes)  # noqa: PTH116
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{name} does not exist") from None
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{quoted(name)} is no path: it holds a NUL or half a character") from None
    try:
        _check_regular(os.fstat(descriptor), name, most_bytes)  # It may have been replaced in between.
    except InputError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def _check_regular(status: os.stat_result, name: str, most_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = next((kind for is_kind, kind in _KINDS if is_kind(status.st_mode)), "something else")
        raise InputError(f"{name} is {kind}, expected a file")
    if status.st_size > most_bytes:
        raise InputError(f"{name} is larger than {most_bytes / 1e6:g} MB")


# JSON, decoded into types. Bounds are metadata of the fields (number_kinds.py).

Numbers3 = np.ndarray[tuple[Literal[3]], np.dtype[np.float64]]
Numbers3x3 = np.ndarray[tuple[Literal[3], Literal[3]], np.dtype[np.float64]]
Numbers4x4 = np.ndarray[tuple[Literal[4], Literal[4]], np.dtype[np.float64]]
"""Finite numbers, row by row, flat or nested in the file."""


def read_json(path: Path, kind: type[T], what: str = "") -> T:
    """Return the content of a JSON file (.json or .json.gz) as ``kind``.

    Raises:
        InputError: as :func:`reading`; where something does not fit ``kind``, its place is named as ``$[3].cam_K``.
    """
    with reading(path, what, MOST_JSON_BYTES) as file:
        return decoded_json(file.read(), kind)


def read_entries(path: Path, kind: type[T]) -> tuple[list[tuple[int, T]], list[str]]:
    """The valid entries of a JSON list, each with its place; and what is wrong with the others.

    Raises:
        InputError: as :func:`read_json`, where it is no list.
    """
    return sorted_out(read_json(path, tuple[msgspec.Raw, ...]), kind)


def sorted_out(raw: Sequence[msgspec.Raw], kind: type[T]) -> tuple[list[tuple[int, T]], list[str]]:
    """:func:`read_entries` of a list that was read."""
    entries: list[tuple[int, T]] = []
    faults: list[str] = []
    for k, one in enumerate(raw):
        try:
            entries.append((k, decoded_json(bytes(one), kind)))
        except (ValueError, RecursionError) as error:
            faults.append(f"entry {k}: {first_line(error)}")
    return entries, faults


def read_yaml(path: Path, kind: type[T], what: str = "") -> T:
    """Return the content of a YAML file as ``kind``; as :func:`read_json`."""
    with reading(path, what, MOST_YAML_BYTES) as file:
        raw = file.read()
        if b"*" in raw:  # A few lines of them stand for gigabytes.
            raise ContentError("aliases (*) are not read")
        try:
            return msgspec.yaml.decode(raw, type=kind, strict=False, dec_hook=array_of)
        except msgspec.ValidationError as error:
            raise ContentError(_at_place(error)) from None
        except msgspec.DecodeError as error:
            places = re.findall(r"line \d+, column \d+", str(error))
            raise ContentError(f"not YAML{f' from {places[-1]} on' if places else ''}") from None


def converted(value: Any, kind: type[T]) -> T:
    """Return what was decoded as ``kind``; ContentError where it is something else."""
    try:
        return msgspec.convert(value, kind, strict=False, dec_hook=array_of)
    except msgspec.ValidationError as error:
        raise ContentError(_at_place(error)) from None


def decoded_json(raw: bytes, kind: type[T]) -> T:
    """Return JSON as ``kind``; ContentError where it is damaged or something else."""
    if raw[:2] == b"\x1f\x8b":
        with gzip.GzipFile(fileobj=io.BytesIO(raw)) as packed:
            raw = packed.read(MOST_JSON_BYTES + 1)
        if len(raw) > MOST_JSON_BYTES:
            raise ContentError(f"it unpacks to more than {MOST_JSON_BYTES / 1e6:.0f} MB")
    raw = raw.removeprefix(codecs.BOM_UTF8)
    if b"NaN" in raw or b"Infinity" in raw:  # Python writes them, and no field takes them.
        raw = _NOT_FINITE.sub(b"null", raw)
    try:
        return _decoder(kind).decode(raw)
    except msgspec.ValidationError as error:
        raise ContentError(_at_place(error)) from None
    except msgspec.DecodeError as error:
        raise ContentError(f"not JSON: {_placed(str(error).removeprefix('JSON is malformed: '), raw)}") from None


def _at_place(error: msgspec.ValidationError) -> str:
    """What msgspec found at which place, as "Expected `int` (at [3].cam_K)"."""
    return re.sub(r" - at `(?:key in )?\$(.*)`$", r" (at $\1)", str(error))


def _placed(message: str, raw: bytes) -> str:
    """A message of msgspec with a line and a column in place of a byte offset."""
    byte = re.fullmatch(r"(.*) \(byte (\d+)\)", message)
    if byte is None:
        return message
    before = raw[: int(byte[2])]
    newline = b"\n"
    return f"{byte[1]} in line {before.count(newline) + 1}, column {len(before) - before.rfind(newline)}"


_NOT_FINITE = re.compile(rb"(?<=[\[,:\s])(NaN|-?Infinity)(?=[\],}\s])")


@cache
def _decoder(kind: type[T]) -> msgspec.json.Decoder[T]:
    # Not strict: 5.0 is an id as well, as numpy and pandas write them.
    return msgspec.json.Decoder(kind, strict=False, dec_hook=array_of)


def array_of(kind: Any, value: Any) -> Float:
    """Return a decoded list as an array of ``kind``, such as :data:`Numbers3`; ContentError where it is none."""
    shape = tuple(get_args(length)[0] for length in get_args(get_args(kind)[0]))
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ContentError(f"Expected {math.prod(shape)} numbers") from None
    if numbers.size != math.prod(shape):
        raise ContentError(f"Expected {math.prod(shape)} numbers, got {numbers.size}")
    if not (np.abs(numbers) < 1e100).all():
        raise ContentError("Expected finite numbers")
    return numbers.reshape(shape)


class Numbered(Mapping[int, T], Generic[T]):
    """A JSON object whose keys are numbers, such as ids of images; an entry is decoded when it is asked for.

    Args:
        path: the file.
        kind: what an entry is.
        of: what the keys number, for messages: "image", "object".

    Raises:
        InputError: as :func:`read_json`, or no key is a number.
    """

    def __init__(self, path: Path, kind: type[T], of: str) -> None:
        self._path, self._kind, self._of = path, kind, of
        self._raw: dict[int, msgspec.Raw] = {}
        self.faults: list[str] = []
        """Notes on keys that are no number; their entries are left out."""
        for key, raw in read_json(path, dict[str, msgspec.Raw]).items():
            number = id_of(key)
            if number is None:
                expected = "expected its number, as in {'0': …, '1': …}"
                self.faults.append(f"{path}: {quoted(key, 40)} is no {of}, {expected}")
            else:
                self._raw[number] = raw
        if self.faults and not self._raw:
            raise InputError(self.faults[0])

    def where(self, number: int) -> str:
        """Name an entry in a message."""
        return f"{self._path}, {self._of} {number}"

    def __getitem__(self, number: int) -> T:
        """The entry of a number.

        Raises:
            InputError: it is not what it should be; the place is named.
        """
        raw = self._raw[number]
        try:
            return decoded_json(bytes(raw), self._kind)
        except (ContentError, RecursionError) as error:
            raise InputError(f"{self.where(number)}: {first_line(error)}") from None

    def __contains__(self, number: object) -> bool:
        return number in self._raw

    def __iter__(self) -> Iterator[int]:
        return iter(self._raw)

    def __len__(self) -> int:
        return len(self._raw)


def id_of(text: str) -> int | None:
    """The number that a text spells, leading zeros allowed; None where it spells none, or has over 18 digits."""
    return int(text) if re.fullmatch(r"0*\d{1,18}", text, re.ASCII) and len(text) < 100 else None
