# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The reasons of the kernel for dropping packets, if tracefs shows them: the event skb:kfree_skb (Documentation/trace/events.rst), since Linux 5.17.

The event says neither which packet nor in which network namespace. So a reason is a hint, as a counter is, and it is that of the whole
kernel: containers with tracefs share it.

A listener holds a lock, flock(2), on its folder in tracefs. The kernel frees it when the listener is killed. So the next one knows
the folders that no listener needs any more, also of containers whose processes it does not see, and removes it.
"""

import contextlib
import fcntl
import os
import re
import typing

TRACEFS = "/sys/kernel/tracing"
INSTANCES = "instances"
# A buffer and switches of its own, apart from those of other tools: a name for each network namespace.
NAME = "rosfleet_packet_trace_%d"
OURS = re.compile(r"rosfleet_packet_trace_[0-9]+\Z")
NAMESPACE = "/proc/self/ns/net"
EVENT = "events/skb/kfree_skb"
WANTED = "protocol == 0x0800 || protocol == 0x0806"  # IPv4 and ARP
BUFFER = "64"  # kB for each processor, about a thousand drops; the first ones are kept
MOST = 4_000_000  # bytes of its text that are read
ATTEMPTS = 3  # to make the folder, which another run may take for one that was left until it is locked
# The last words of a line. A reason that says nothing is left out.
REASON = re.compile(r" reason: (?!NOT_SPECIFIED)([A-Z][A-Z0-9_]{1,60})$", re.M)


class DropReasons:
    """Counts the drops of a time by their reasons. Without tracefs, or without the right to read it, it counts no drops."""

    def __init__(self, tracefs: str = TRACEFS) -> None:
        namespace = os.stat(NAMESPACE).st_ino if os.path.exists(NAMESPACE) else 0
        self._instances = os.path.join(tracefs, INSTANCES)
        self._folder = os.path.join(self._instances, NAME % namespace)
        self._lock: typing.Optional[int] = None  # the descriptor of the folder, while it is ours

    def __enter__(self) -> "DropReasons":
        for _attempt in range(ATTEMPTS):
            _remove_orphans(self._instances)
            try:
                self._begin()
                break
            except FileNotFoundError:
                self._end()
            except OSError:
                self._end()
                break
        return self

    def __exit__(self, *_error: object) -> None:
        self._end()

    def read(self) -> typing.Dict[str, int]:
        """Return how many packets were dropped since the start: {"drop reason NAME": number}."""
        if self._lock is None:
            return {}
        try:
            with open(os.path.join(self._folder, "trace"), "rb") as file:
                lines = file.read(MOST).decode("ascii", "replace")
        except OSError:
            return {}
        reasons = REASON.findall(lines)
        return {f"drop reason {reason}": reasons.count(reason) for reason in set(reasons)}

    def _begin(self) -> None:
        """Make the folder, lock it, and switch the event on. Raises OSError, also if a listener has this folder."""
        os.mkdir(self._folder, 0o700)
        descriptor = _open(self._folder)
        try:
            # Another run may have taken it for one that was left.
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not _is_at(descriptor, self._folder):
                raise FileNotFoundError(self._folder)
        except OSError:  # it is another's by now, so it stays
            os.close(descriptor)
            raise
        self._lock = descriptor
        for name, value in (
            ("buffer_size_kb", BUFFER),
            ("options/overwrite", "0"),
            (f"{EVENT}/filter", WANTED),
            (f"{EVENT}/enable", "1"),
        ):
            _write(self._folder, name, value)

    def _end(self) -> None:
        """Remove the folder and free it, if it is ours."""
        if self._lock is not None:
            _remove(self._folder, self._lock)
            os.close(self._lock)
            self._lock = None


def _remove_orphans(instances: str) -> None:
    """Remove the remains of killed listeners."""
    with contextlib.suppress(OSError):
        for name in filter(OURS.match, os.listdir(instances)):
            _remove_orphan(os.path.join(instances, name))


def _remove_orphan(folder: str) -> None:
    """Remove a folder of ours, unless its listener lives, and so has it locked."""
    with contextlib.suppress(OSError):
        descriptor = _open(folder)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _remove(folder, descriptor)
        finally:
            os.close(descriptor)


def _open(folder: str) -> int:
    return os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)


def _is_at(descriptor: int, folder: str) -> bool:
    """True if this folder is still at its path: its listener may have removed it, and another one made it again."""
    return os.path.samestat(os.fstat(descriptor), os.lstat(folder))


def _write(folder: str, name: str, value: str) -> None:
    with open(os.path.join(folder, name), "w", encoding="ascii") as file:
        file.write(value)


def _remove(folder: str, descriptor: int) -> None:
    """Take the switches of a locked folder back. tracefs removes the files of an instance with its folder."""
    with contextlib.suppress(OSError):
        if _is_at(descriptor, folder):
            with contextlib.suppress(OSError):
                _write(folder, f"{EVENT}/enable", "0")
            os.rmdir(folder)
