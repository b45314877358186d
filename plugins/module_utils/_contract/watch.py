# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The answer of multimaster_watch."""

import typing

from .fields import Struct, field


class WatchEvent(Struct):
    """A thing that was lost or has returned."""

    kind: str = field(
        "V(group) for heartbeats on the group and V(master) for those by any way, then V(membership), V(address), V(link), V(route), "
        "V(setting), V(service), V(port), V(hosts) and V(clock). V(readings) for the measurements of all of them but the heartbeats, if a "
        "look fails, or none has ended for 15 seconds.",
        "group",
    )
    name: str = field("The computer, interface, address, destination, setting, unit or file.", "kobuki2computer")
    well: bool = field("Whether it has returned; false for a loss.", False)
    expected: str = field("The first value.", "heard")
    found: str = field("The value since then.", "silent")
    time: float = field(
        "The time on this computer's clock, in seconds since 1970. For silence that of the last heartbeat.",
        1730000261.2,
    )
    after: float = field("How long after the start, in seconds.", 261.2)


class Lost(Struct):
    """A thing that is lost now."""

    kind: str = field("As in RV(events[].kind).", "group")
    name: str = field("As in RV(events[].name).", "kobuki2computer")


class WatchedEvents(Struct, returned="when O(action=collect)"):
    """The answer of multimaster_watch."""

    watched: int = field("How many values are watched.", 23)
    seconds: float = field("How long the watch has lasted, in seconds.", 312.4)
    events: typing.Tuple[WatchEvent, ...] = field("The losses and returns, in the order of time, 500 at most.")
    dropped: int = field("How many events there were beyond those of RV(events).", 0)
    lost: typing.Tuple[Lost, ...] = field("The values that are lost now.")
    msg: str = field(
        "The result, in a sentence.", "23 values are watched since 312 s; 1 of them is lost.", returned="always"
    )
