"""Binary arrays and pictures that messages name and browsers fetch."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import NamedTuple

MOST_BYTES = 192 * 1024**2
"""What is held at once; a browser that asks for what was dropped asks its view again."""


class Blob(NamedTuple):
    """Bytes and what they are."""

    data: bytes
    media_type: str


class Blobs:
    """The latest blobs, by key. Callable from any thread."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._blobs: OrderedDict[str, Blob] = OrderedDict()
        self._n_bytes = self._n_put = 0
        self._lock = threading.Lock()

    def put(self, data: bytes, media_type: str = "application/octet-stream") -> str:
        """Hold bytes and return their key."""
        with self._lock:
            self._n_put += 1
            key = str(self._n_put)
            self._blobs[key] = Blob(data, media_type)
            self._n_bytes += len(data)
            while self._n_bytes > self._most_bytes and len(self._blobs) > 1:
                _, dropped = self._blobs.popitem(last=False)
                self._n_bytes -= len(dropped.data)
        return key

    def get(self, key: str) -> Blob | None:
        """Return the blob of a key; None where it was dropped."""
        with self._lock:
            if key in self._blobs:
                self._blobs.move_to_end(key)
            return self._blobs.get(key)

    def data(self, key: str) -> bytes:
        """Return the bytes of a key that was put a moment ago."""
        blob = self.get(key)
        assert blob is not None
        return blob.data
