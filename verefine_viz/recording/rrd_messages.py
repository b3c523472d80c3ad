"""What an .rrd file is made of: a head, then messages, each its kind and length and then a protobuf.

That of a chunk (``ArrowMsg``) names the recording and holds an Arrow IPC stream, packed with LZ4. The messages of a
recording and of a blueprint follow one another in any order. The last one is a footer (an index of the chunks); rerun
reads files without one from beginning to end. What is not about the layout of files is asked of rerun itself.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pyarrow as pa
import rerun as rr

from verefine_viz.recording.entities import APPLICATION

HEAD = b"RRF2"
_HEAD_SIZE = 12
_MESSAGE = struct.Struct("<QQ")
_END, _BEGIN, _CHUNK, _USE = 0, 1, 2, 3
"""Kinds of messages; the end is the footer, and the last one puts a blueprint into use."""
_LZ4, _ARROW_IPC = 2, 1


class Store:
    """Which recording messages belong to."""

    def __init__(self, recording_id: str, is_blueprint: bool = False) -> None:
        """
        Args:
            recording_id: for :meth:`begin` of 32 characters.
            is_blueprint: whether it is not a recording but how recordings look.
        """
        application = b"\x0a" + _sized(APPLICATION.encode())
        store = b"\x08%c\x12" % (1 + is_blueprint) + _sized(recording_id.encode()) + b"\x1a" + _sized(application)
        self._id = b"\x0a" + _sized(store)
        self._recording_id = recording_id

    def begin(self) -> bytes:
        """How its file begins."""
        return _beginning().replace(_NO_ID.encode(), self._recording_id.encode())

    def messages(self, bodies: Iterable[bytes]) -> bytes:
        """Chunks of it, each as :func:`chunk_body` has it."""
        own = self._id
        parts: list[bytes] = []
        for body in bodies:
            parts += (_MESSAGE.pack(_CHUNK, len(own) + len(body)), own, body)
        return b"".join(parts)


def chunk_body(chunk_id: tuple[int, int], is_static: bool, stream: bytes) -> bytes:
    """The message of a chunk without the recording that it belongs to.

    Args:
        chunk_id: both halves.
        is_static: whether it has no time.
        stream: the chunk as an Arrow IPC stream.
    """
    packed = _lz4().compress(stream, asbytes=True)
    return b"".join(
        (
            b"\x10%c\x18%b\x20%c\x2a%b" % (_LZ4, _varint(len(stream)), _ARROW_IPC, _varint(len(packed))),
            packed,
            _CHUNK_ID.pack(0x32, 18, 0x09, chunk_id[0], 0x11, chunk_id[1], 0x38, is_static),
        )
    )


def messages(content: bytes) -> bytes:
    """All messages of an .rrd file but its footer.

    Raises:
        ValueError: it is no such file.
    """
    if not content.startswith(HEAD):
        raise ValueError("not an .rrd file")
    at = _HEAD_SIZE
    while at + _MESSAGE.size <= len(content):
        kind, length = _MESSAGE.unpack_from(content, at)
        if kind == _END:
            break
        at += _MESSAGE.size + length
    return content[_HEAD_SIZE:at]


def is_cut(path: Path) -> bool:
    """Whether the end of an .rrd file that was finished is missing.

    A finished one ends with rerun's footer, or as ``RrdFile.close`` leaves it: with messages of a blueprint, one of
    which puts it into use. One that viewers watched has its blueprint first, and a footer. Rerun takes what is left of
    a file for all of it.
    """
    size, at = path.stat().st_size, _HEAD_SIZE
    is_in_use = is_blueprint = has_chunks = False
    with path.open("rb") as file:
        while at + _MESSAGE.size <= size:
            file.seek(at)
            kind, length = _MESSAGE.unpack(file.read(_MESSAGE.size))
            at += _MESSAGE.size + length
            if kind == _END:
                # What follows the footer says where it begins.
                return at > size
            is_blueprint = _is_blueprint(file.read(min(length, _STORE_SIZE)))
            has_chunks |= kind == _CHUNK and not is_blueprint
            is_in_use |= kind == _USE and has_chunks
    return at != size or not (is_in_use and is_blueprint)


def _is_blueprint(begin: bytes) -> bool:
    """Whether a message, of which this is the beginning, belongs to a blueprint (see ``Store``)."""
    after_size = next((k + 1 for k, byte in enumerate(begin[1:], 1) if byte < 128), len(begin))
    return begin[after_size : after_size + 2] == b"\x08\x02"


_STORE_SIZE = 16
"""More than the first bytes of a message, up to the kind of its store."""
_CHUNK_ID = struct.Struct("<BBBQBQBB")
_NO_ID = "0" * 32


@cache
def _lz4() -> pa.Codec:
    return pa.Codec("lz4_raw")


@cache
def _beginning() -> bytes:
    """Head and first message of a recording called ``_NO_ID``, by rerun."""
    stream = rr.RecordingStream(APPLICATION, recording_id=_NO_ID, send_properties=False)
    content = stream.binary_stream().read() or b""
    stream.disconnect()
    kind, length = _MESSAGE.unpack_from(content, _HEAD_SIZE)
    if kind != _BEGIN:
        raise RuntimeError("rerun begins its files in another way than this version expects")
    return content[: _HEAD_SIZE + _MESSAGE.size + length]


def _sized(content: bytes) -> bytes:
    return _varint(len(content)) + content


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    out.append(number)
    return bytes(out)
