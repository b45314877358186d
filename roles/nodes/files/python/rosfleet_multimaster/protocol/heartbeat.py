# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The 24-byte record that discovery nodes exchange by UDP.

Little endian with explicit padding: the native structure of upstream on x86-64 and aarch64.
"""

import struct
from enum import Enum
from typing import NamedTuple

SIZE = 24
_RECORD = struct.Struct("<cBBxiiHxxii")
_MARK = b"R"
_VERSION = 2
_VERSION_WITH_REQUESTS = 3
_GONE = -1
_END = 2**31  # seconds: a signed number of four bytes ends in 2038
MAX_RATE = 25.5  # Hz: one byte, in tenths


class InvalidHeartbeat(ValueError):
    """The datagram is no record of this protocol; the text says why, in a few words."""


class Stamp(NamedTuple):
    """A time of the sender's wall clock, as it is in the record."""

    secs: int = 0
    nsecs: int = 0

    @classmethod
    def from_seconds(cls, seconds: float) -> "Stamp":
        """The stamp of a Unix time in seconds; a time that the record cannot hold begins again at 0."""
        whole = int(seconds // 1)
        return cls(whole % _END, int((seconds - whole) * 1e9))

    @property
    def seconds(self) -> float:
        """Unix time in seconds; equal, as a double, to the text "%.9f" of the time it was made from."""
        return self.secs + self.nsecs / 1e9


class Kind(Enum):
    """The meaning of a record."""

    STATE = "state"  # I am here, and my state has this stamp
    REQUEST = "request"  # asks for the state
    LEAVE = "leave"  # I go


class Heartbeat(NamedTuple):
    """One record."""

    kind: Kind
    rpc_port: int
    rate: float = 0.0  # Hz, 0 if the sender promises none
    stamp: Stamp = Stamp()  # anything of the state changed
    local_stamp: Stamp = Stamp()  # something of this master changed


def encode(heartbeat: Heartbeat) -> bytes:
    """The datagram of a record."""
    version, stamp, local_stamp = _VERSION, heartbeat.stamp, heartbeat.local_stamp
    if heartbeat.kind is Kind.REQUEST:
        version, stamp, local_stamp = _VERSION_WITH_REQUESTS, Stamp(), Stamp()
    elif heartbeat.kind is Kind.LEAVE:
        stamp = local_stamp = Stamp(_GONE, _GONE)
    rate = int(min(max(heartbeat.rate, 0.0), MAX_RATE) * 10)
    return _RECORD.pack(_MARK, version, rate, *stamp, heartbeat.rpc_port, *local_stamp)


def decode(datagram: bytes) -> Heartbeat:
    """The record of a datagram. Raises InvalidHeartbeat."""
    if len(datagram) > 1 and datagram[1] not in (_VERSION, _VERSION_WITH_REQUESTS):
        raise InvalidHeartbeat(f"version {datagram[1]} instead of {_VERSION} or {_VERSION_WITH_REQUESTS}")
    if datagram[:1] != _MARK:
        raise InvalidHeartbeat("it does not begin with the letter R")
    if len(datagram) != SIZE:
        raise InvalidHeartbeat(f"{len(datagram)} bytes instead of {SIZE}")
    _mark, version, rate, secs, nsecs, rpc_port, local_secs, local_nsecs = _RECORD.unpack(datagram)
    stamp, local_stamp = Stamp(secs, nsecs), Stamp(local_secs, local_nsecs)
    if not rpc_port:
        raise InvalidHeartbeat("no port")
    kind = Kind.STATE
    if _GONE in (secs, local_secs):
        kind = Kind.LEAVE
    elif min(*stamp, *local_stamp) < 0:  # ROS has no such times, so no message could carry it
        raise InvalidHeartbeat("a time before 1970")
    elif version == _VERSION_WITH_REQUESTS and stamp == Stamp():
        kind = Kind.REQUEST
    return Heartbeat(kind, rpc_port, rate / 10, stamp, local_stamp)
