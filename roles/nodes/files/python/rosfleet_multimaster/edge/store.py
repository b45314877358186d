# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The store of the roscore: a file with a line for each change, which a thread syncs to the disk and writes anew.

A line is written before the caller has its answer, so it survives the end of the process; within 0.1 s it survives a loss
of power. Where it cannot be written, there is a warning, the roscore goes on, and a new file is tried again and again.
"""

import fcntl
import logging
import os
import threading
import xmlrpc.client
from typing import Any, Callable, ContextManager, Iterable, List, NamedTuple, Optional, Sequence

from ..core import remembered
from ..core.registry import Record, Registry
from .clock import sleep

_log = logging.getLogger("rosfleet.store")

SYNC = 0.05  # seconds from a change to its sync
AGAIN = 10.0  # seconds until a file that cannot be written is tried again
_REST = 0.002  # seconds of rest for those who call, while a new file is written


class Found(NamedTuple):
    """The registry that was kept, and whether this computer was started since."""

    registry: Registry
    another_boot: bool
    size: int  # bytes of the file that count; 0 where it is not gone on with,
    lines: int  # and the number of its last line


def boot() -> str:
    """The present boot of this computer."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="ascii") as file:
            return file.read().strip()
    except OSError:
        return ""


def read(folder: str) -> Optional[Found]:
    """Read the store of this folder. A damaged one is put aside, with a warning."""
    path = os.path.join(folder, remembered.FILE)
    try:
        with open(path, "rb") as file:
            data = file.read()
    except FileNotFoundError:
        return None
    except OSError as problem:
        _log.warning("what the roscore knew cannot be read: %s; it starts with nothing", problem)
        return None
    found = remembered.read(data, _special)
    if found is None or found.damaged:
        _put_aside(path)
    elif found.torn:
        _log.info("the last change was not written to its end in %s: nobody had an answer to it", path)
    if found is None:
        return None
    another_boot = found.boot != boot()
    return Found(found.registry, another_boot, 0 if found.damaged or another_boot else found.good, found.lines)


def forget(folder: str) -> bool:
    """Remove the store. Whether there was one. Raises OSError."""
    try:
        os.remove(os.path.join(folder, remembered.FILE))
    except FileNotFoundError:
        return False
    return True


def _special(value: remembered.Special) -> Any:
    return getattr(xmlrpc.client, value.kind)(value.content())


def _put_aside(path: str) -> None:
    _log.warning("%s is damaged: what can be read counts, and the file is kept as %s.damaged", path, path)
    try:
        os.replace(path, path + ".damaged")
    except OSError as problem:
        _log.warning("%s cannot be kept: %s", path, problem)


class Store:
    """The file. Its lines are added by who holds the lock of the registrations."""

    def __init__(self, folder: str, lock: ContextManager[Any], parts: Callable[[], Iterable[List[Record]]]) -> None:
        """`parts()`: all that the roscore knows, a few records at a time, which takes the lock itself.

        What changes meanwhile may be in it or not: it is added.
        """
        self._folder, self._path = folder, os.path.join(folder, remembered.FILE)
        self._lock, self._parts = lock, parts
        self._file: Optional[int] = None
        self._guard: Optional[int] = None  # the folder, locked: one roscore has it
        self._number = self._size = self._base = 0
        self._meanwhile: Optional[List[Sequence[Record]]] = None  # what changes while a new file is written
        self._old = False  # the file is one of an earlier life
        self._dirty = threading.Event()
        self._warned = ""

    def start(self, found: Optional[Found] = None) -> None:
        """Go on in the file that was found, or write one with all there is. Then sync and renew it in a thread."""
        if found is None or not self._go_on(found):
            self._renew(rest=False)
        threading.Thread(target=self._keep, name="store", daemon=True).start()

    def add(self, records: Sequence[Record]) -> None:
        """Add the changes of one call."""
        if self._meanwhile is not None:
            self._meanwhile.append(records)
        if self._file is None:
            return
        try:
            self._append(self._file, records)
        except (OSError, TypeError, ValueError) as problem:
            self._failed(problem)
        self._dirty.set()

    def sync(self) -> None:
        """Bring what was written to the disk."""
        with self._lock:
            file = self._file
        try:
            if file is not None:
                os.fdatasync(file)
        except OSError as problem:
            with self._lock:
                self._failed(problem)  # what was not written then is nowhere: all is written anew

    def _append(self, file: int, records: Sequence[Record]) -> None:
        line = remembered.line(self._number + 1, records)
        written = os.write(file, line)
        if written < len(line):
            os.ftruncate(file, self._size)
            raise OSError(f"only {written} of {len(line)} bytes could be written")
        self._number, self._size = self._number + 1, self._size + written

    def _go_on(self, found: Found) -> bool:
        """Add to the file that was found. A new one has to be on the disk first, which takes seconds where that is busy."""
        if not found.size:
            return False
        try:
            self._own()
            file = os.open(self._path, os.O_WRONLY | os.O_CLOEXEC)
        except OSError:
            return False
        try:
            os.ftruncate(file, found.size)  # what was not written to its end
            os.lseek(file, 0, os.SEEK_END)
        except OSError:
            os.close(file)
            return False
        self._file, self._size, self._number = file, found.size, found.lines
        self._old = True
        return True

    def _keep(self) -> None:
        if self._old:
            self._renew()
        while True:
            self._dirty.wait(None if self._file is not None else AGAIN)
            sleep(SYNC)
            self._dirty.clear()
            if self._file is None:
                sleep(AGAIN)
                self._renew()
            else:
                self.sync()
                if remembered.grown(self._size, self._base):
                    self._renew()

    def _renew(self, rest: bool = True) -> None:
        """Write a new file beside the old one, which counts until the new one takes its place."""
        new = None
        self._start_over()
        try:
            self._own()
            new = os.open(self._path + ".new", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
            number = self._write(new, rest)
            number = _write_all(new, number, self._start_over())
            os.fdatasync(new)
            with self._lock:
                old = self._take(new, number)
            new = None
            if old is not None:
                os.close(old)
            self._sync_folder()
            if self._warned:
                _log.warning("what the roscore knows is kept again")
                self._warned = ""
        except (OSError, TypeError, ValueError) as problem:
            with self._lock:
                self._meanwhile = None
                self._failed(problem)
            if new is not None:
                os.close(new)
                os.remove(self._path + ".new")

    def _start_over(self) -> List[Sequence[Record]]:
        """Note what changes from now on; what changed since this was called before."""
        with self._lock:
            meanwhile, self._meanwhile = self._meanwhile or [], []
        return meanwhile

    def _write(self, file: int, rest: bool) -> int:
        """Write all there is; the number of the last line."""
        _write_whole(file, remembered.head(boot()))
        number = 0
        for part in self._parts():
            number = _write_all(file, number, [[record] for record in part])
            if rest:
                sleep(_REST)
        return number

    def _take(self, new: int, number: int) -> Optional[int]:
        """The new file takes the place of the old one, which is returned. The lock is held."""
        self._base = os.fstat(new).st_size
        number = _write_all(new, number, self._meanwhile or [])
        os.replace(self._path + ".new", self._path)
        old, self._file = self._file, new
        self._number, self._size, self._meanwhile = number, os.fstat(new).st_size, None
        self._dirty.set()
        return old

    def _own(self) -> None:
        """One roscore has the folder. Raises OSError."""
        if self._guard is None:
            os.makedirs(self._folder, mode=0o700, exist_ok=True)
            guard = os.open(self._folder, os.O_RDONLY | os.O_CLOEXEC)
            try:
                fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(guard)
                raise OSError(f"another roscore keeps its registrations in {self._folder}") from None
            self._guard = guard

    def _sync_folder(self) -> None:
        if self._guard is not None:
            os.fsync(self._guard)

    def _failed(self, problem: Exception) -> None:
        """Give the file up: it stays as it was up to now; a new one is tried later."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
        if self._warned != str(problem):
            self._warned = str(problem)
            _log.warning(
                "what the roscore knows cannot be kept in %s: %s; it goes on, and would come back as it was before",
                self._folder,
                problem,
            )
        self._dirty.set()


def _write_all(file: int, number: int, changes: Sequence[Sequence[Record]]) -> int:
    """Write a line for each change after the line of this number; the number of the last one."""
    if changes:
        _write_whole(file, b"".join(remembered.line(at, records) for at, records in enumerate(changes, number + 1)))
    return number + len(changes)


def _write_whole(file: int, data: bytes) -> None:
    if os.write(file, data) < len(data):
        raise OSError("no space left")
