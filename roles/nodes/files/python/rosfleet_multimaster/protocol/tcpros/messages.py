# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The bytes of a connection, cut into messages: each has its length in front, and keeps it."""

import struct
from typing import Optional

_SIZE = struct.Struct("<I")


class MessageReader:
    """Cuts a stream. A message that is too long is skipped without being held, and counted."""

    def __init__(self, most: int) -> None:
        """`most`: bytes of a message without its length. It may be changed between two messages."""
        self.most = most
        self.skipped = 0  # messages
        self._left = 0  # bytes of one that is being skipped
        self._held = bytearray()
        self._at = 0  # the bytes before it have been taken

    @property
    def size(self) -> int:
        """Bytes that are no whole message yet."""
        return len(self._held) - self._at

    def rest(self) -> bytes:
        """Return the bytes that have not been taken."""
        return bytes(self._held[self._at :])

    def feed(self, data: bytes) -> None:
        """Take the bytes that came."""
        skip = min(self._left, len(data))
        self._left -= skip
        self._held += data[skip:] if skip else data

    def take(self) -> Optional[bytes]:
        """Return the next message; None if it is not whole."""
        while self.size >= _SIZE.size:
            (size,) = _SIZE.unpack_from(self._held, self._at)
            end = self._at + _SIZE.size + size
            if size > self.most:
                self._skip(end)
                continue
            if end > len(self._held):
                break
            message = bytes(memoryview(self._held)[self._at : end])
            self._at = end
            return message
        self._compact()
        return None

    def give_up(self) -> None:
        """Skip the message that is being read."""
        if self.size >= _SIZE.size:
            (size,) = _SIZE.unpack_from(self._held, self._at)
            self._skip(self._at + _SIZE.size + size)
            self._compact()

    def _compact(self) -> None:
        del self._held[: self._at]
        self._at = 0

    def _skip(self, end: int) -> None:
        self.skipped += 1
        self._left = max(0, end - len(self._held))
        self._at = min(end, len(self._held))
