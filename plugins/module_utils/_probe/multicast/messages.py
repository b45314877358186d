# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The messages that helpers send each other. All have one size, so that an answer is never larger than its question."""

import hashlib
import hmac
import socket
import struct
import typing

HELLO, ASK, ANSWER = 1, 2, 3


_BODY = struct.Struct("!4sBB2x4sIII4sdd")


_MAGIC = b"RFMV"


_SEAL = 16


class Message(typing.NamedTuple):
    """A message of a helper. Times are those of wall clocks, in seconds."""

    kind: int  # HELLO, ASK or ANSWER
    done: bool  # the sender has finished its measurement
    address: str  # the planned address of the sender
    sequence: int = 0
    heard: int = 0  # probes of the receiver that the sender has heard on the group
    heard_unicast: int = 0
    source: str = "0.0.0.0"  # the address from which the sender sees the receiver
    asked: float = 0.0
    arrived: float = 0.0


def encode(message: Message, run: str) -> bytes:
    """Write a message, sealed with the label of the run: helpers of another run, and strangers, are not understood."""
    values: typing.List[typing.Any] = list(message)
    values[2], values[6] = socket.inet_aton(message.address), socket.inet_aton(message.source)
    body = _BODY.pack(_MAGIC, *values)
    return _seal(body, run) + body


def decode(data: bytes, run: str) -> typing.Optional[Message]:
    """Read a message; None if it is no message of this run."""
    body = data[_SEAL:]
    if len(body) != _BODY.size or not hmac.compare_digest(data[:_SEAL], _seal(body, run)):
        return None
    magic, kind, done, address, sequence, heard, unicast, source, asked, arrived = _BODY.unpack(body)
    addresses = socket.inet_ntoa(address), socket.inet_ntoa(source)
    message = Message(kind, bool(done), addresses[0], sequence, heard, unicast, addresses[1], asked, arrived)
    return message if magic == _MAGIC else None


def _seal(body: bytes, run: str) -> bytes:
    return hmac.new(run.encode(), body, hashlib.sha256).digest()[:_SEAL]
