# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The bytes of a connection, cut into messages: each has its length in front, and keeps it."""

import struct
from typing import List

_SIZE = struct.Struct("<I")


class MessageReader:
    """Cuts a stream. A message that is too long is skipped without being held, and counted."""

    def __init__(self, most: int) -> None:
        """`most`: bytes of a message without its length. It may be changed between two messages."""
        self.most = most
        self.skipped = 0  # messages
        self._left = 0  # bytes of one that is being skipped
        self._held = bytearray()

    def rest(self) -> bytes:
        """Return the bytes that are no whole message."""
        return bytes(self._held)

    def feed(self, data: bytes) -> List[bytes]:
        """Take the bytes that came; return the messages that are whole now."""
        skip = min(self._left, len(data))
        self._left -= skip
        self._held += data[skip:] if skip else data
        messages, at = [], 0
        while len(self._held) - at >= _SIZE.size:
            (size,) = _SIZE.unpack_from(self._held, at)
            end = at + _SIZE.size + size
            if size > self.most:
                self.skipped += 1
                self._left = max(0, end - len(self._held))
                at = min(end, len(self._held))
                continue
            if end > len(self._held):
                break
            messages.append(bytes(self._held[at:end]))
            at = end
        del self._held[:at]
        return messages
