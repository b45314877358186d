# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Why the kernel drops packets, where tracefs tells it: the event skb:kfree_skb (Documentation/trace/events.rst), since Linux 5.17.

The event says neither which packet nor in which network namespace. So a reason is a hint, as a counter is, and it is that of the whole
kernel: containers with tracefs share it.
"""

import contextlib
import os
import re
import typing

TRACEFS = "/sys/kernel/tracing"
# A buffer and switches of its own, beside those of other tools: a name for each network namespace.
INSTANCE = "instances/rosfleet_follow_%d"
NAMESPACE = "/proc/self/ns/net"
EVENT = "events/skb/kfree_skb"
WANTED = "protocol == 0x0800 || protocol == 0x0806"  # IPv4 and ARP
BUFFER = "64"  # kB for each processor, about a thousand drops; the first ones are kept
MOST = 4_000_000  # bytes of its text that are read
# The last words of a line. A reason that says nothing is left out.
REASON = re.compile(r" reason: (?!NOT_SPECIFIED)([A-Z][A-Z0-9_]{1,60})$", re.M)


class DropReasons:
    """Counts the drops of a time by their reasons. Where tracefs is not there, or not for us, there are none."""

    def __init__(self, tracefs: str = TRACEFS) -> None:
        namespace = os.stat(NAMESPACE).st_ino if os.path.exists(NAMESPACE) else 0
        self._folder = os.path.join(tracefs, INSTANCE % namespace)

    def __enter__(self) -> "DropReasons":
        self._remove()  # a listener that was killed may have left it
        with contextlib.suppress(OSError):
            os.mkdir(self._folder, 0o700)
            for name, value in (
                ("buffer_size_kb", BUFFER),
                ("options/overwrite", "0"),
                (f"{EVENT}/filter", WANTED),
                (f"{EVENT}/enable", "1"),
            ):
                self._write(name, value)
        return self

    def __exit__(self, *_error: object) -> None:
        self._remove()

    def read(self) -> typing.Dict[str, int]:
        """Return how many packets were dropped since the start: {"drop reason NAME": number}."""
        try:
            with open(os.path.join(self._folder, "trace"), "rb") as file:
                lines = file.read(MOST).decode("ascii", "replace")
        except OSError:
            return {}
        reasons = REASON.findall(lines)
        return {f"drop reason {reason}": reasons.count(reason) for reason in set(reasons)}

    def _write(self, name: str, value: str) -> None:
        with open(os.path.join(self._folder, name), "w", encoding="ascii") as file:
            file.write(value)

    def _remove(self) -> None:
        """Take the switches back. tracefs removes the files of an instance with its folder."""
        with contextlib.suppress(OSError):
            self._write(f"{EVENT}/enable", "0")
        with contextlib.suppress(OSError):
            os.rmdir(self._folder)
