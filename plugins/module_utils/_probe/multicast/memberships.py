# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The multicast memberships of this computer, from the tables of the kernel (proc(5), /proc/net/igmp and igmp6)."""

import re
import socket
import sys
import typing

Membership = typing.Dict[str, typing.Any]  # as the module returns it
KEYS = ("interface", "family", "group", "users", "querier")


def igmp_memberships(text: str, byteorder: typing.Any = sys.byteorder) -> typing.List[Membership]:
    """Read the memberships in the content of /proc/net/igmp.

    The kernel prints a group as the 32-bit number that its bytes make in memory, so the byte order of the machine counts.
    "querier" is the version of IGMP that was last heard (or the interface's own). It is no proof that a querier lives.
    """
    found: typing.List[Membership] = []
    interface = querier = ""
    for line in text.splitlines():
        device = re.match(r"\d+\s+(\S+?)\s*:\s*\d+\s+(\S+)", line)
        group = re.match(r"\s+([0-9A-Fa-f]{8})\s+(\d+)\s", line)
        if device:
            interface, querier = device.groups()
        elif group and interface:
            address = socket.inet_ntoa(int(group.group(1), 16).to_bytes(4, byteorder))
            found.append(dict(zip(KEYS, (interface, "ipv4", address, int(group.group(2)), querier))))
    return found


def igmp6_memberships(text: str) -> typing.List[Membership]:
    """Read the memberships in the content of /proc/net/igmp6; that table names no querier."""
    rows = re.findall(r"^\d+\s+(\S+)\s+([0-9a-f]{32})\s+(\d+)\s", text, re.MULTILINE)
    return [
        dict(zip(KEYS, (name, "ipv6", socket.inet_ntop(socket.AF_INET6, bytes.fromhex(group)), int(users), None)))
        for name, group, users in rows
    ]


def drop_own(memberships: typing.List[Membership], interface: str, group: str) -> typing.List[Membership]:
    """Return the memberships without one user of (interface, group): the measurement itself is that user."""
    others = []
    for item in memberships:
        own = (item["interface"], item["group"]) == (interface, group)
        users = item["users"] - 1 if own else item["users"]
        if users > 0:
            others.append(dict(item, users=users))
    return others
