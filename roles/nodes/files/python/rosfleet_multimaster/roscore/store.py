# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The store of the roscore: a file with a line for each change, which a thread syncs to the disk and writes anew.

A line is written before the caller has its answer, so it survives the end of the process. 0.1 s later it survives a loss of
power, too. If it cannot be written, there is a warning, the roscore goes on, and a new file is tried again and again.
"""

import contextlib
import fcntl
import logging
import os
import threading
from typing import Any, Callable, ContextManager, Iterable, List, Optional, Sequence, Set

from ..edge.clock import monotonic, sleep
from ..protocol.plain_text import plain
from .core import store_format
from .core.bounds import weigh
from .core.registry import Record

_log = logging.getLogger("rosfleet.store")

SYNC = 0.05  # seconds from a change to its sync
PATIENCE = 10.0  # seconds that a change waits if much was changed in a short time
AGAIN = 10.0  # seconds until a file that cannot be written is tried again
STARTS = 5  # starts that come to nothing, after which the store is put aside
LARGEST = 1 << 30  # bytes of a store that is read; that of a roscore within its bounds has a fourth of it
LONGEST = 1 << 27  # bytes of one line
_STARTS = ".starts"  # the file next to it with a byte for each such start
_WARNINGS = 1000  # about parameters that cannot be kept
_REST = 0.002  # seconds of rest for callers while a new file is written


def read_boot_id() -> str:
    """The id of the present boot of this computer."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="ascii") as file:
            return file.read().strip()
    except OSError:
        return ""


def read(folder: str) -> Optional[store_format.Content]:
    """Read the store of this folder; its size is 0 if a new file is to be written.

    One that cannot be read is set aside, whole or in part, with a warning.
    """
    path = os.path.join(folder, store_format.FILE)
    try:
        if _count_start(folder) >= STARTS:
            set_aside(folder, f"the last {STARTS} starts with it have come to nothing, so it starts with nothing")
            return None
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            lines = iter(lambda: file.readline(LONGEST), b"")
            content = store_format.read(lines) if size <= LARGEST else None
    except FileNotFoundError:
        return None
    except Exception as problem:  # of any kind: a roscore that knows nothing is better than no roscore
        set_aside(folder, f"it cannot be read ({type(problem).__name__}), so the roscore starts with nothing")
        return None
    if content is None:
        set_aside(folder, "nothing in it can be read, so the roscore starts with nothing")
        return None
    broken = content.damaged or content.omissions
    if broken:
        set_aside(folder, "its readable lines count", counts=True)
    elif content.torn:
        _log.info("the last change was not written to its end in %s: nobody had an answer to it", path)
    return content._replace(size=0) if broken or content.boot != read_boot_id() else content


def _count_start(folder: str) -> int:
    """The number of starts with this store that did not come to `clear_starts`. This start is added to them."""
    path = os.path.join(folder, store_format.FILE)
    os.stat(path)  # else there is nothing to set aside
    count = 0
    with contextlib.suppress(FileNotFoundError):
        count = os.path.getsize(path + _STARTS)
    with contextlib.suppress(OSError), open(
        path + _STARTS, "ab"
    ) as file:  # a full or read-only disk: there is no count
        file.write(b".")
    return count


def clear_starts(folder: str) -> None:
    """Forget the starts that came to nothing: the roscore works."""
    with contextlib.suppress(OSError):
        os.remove(os.path.join(folder, store_format.FILE + _STARTS))


def forget(folder: str) -> bool:
    """Remove the store. Whether there was one. Raises OSError."""
    clear_starts(folder)
    try:
        os.remove(os.path.join(folder, store_format.FILE))
    except FileNotFoundError:
        return False
    return True


def set_aside(folder: str, why: str, counts: bool = False) -> None:
    """Keep a store that cannot be used by another name. One that `counts` stays until a new one has replaced it."""
    path = os.path.join(folder, store_format.FILE)
    _log.warning("%s is damaged: %s; the file is kept as %s.damaged", path, why, path)
    try:
        if counts:
            with contextlib.suppress(FileNotFoundError):
                os.remove(path + ".damaged")
            os.link(path, path + ".damaged")
            return
        os.replace(path, path + ".damaged")
        os.remove(path + _STARTS)
    except FileNotFoundError:
        pass
    except OSError as problem:
        _log.warning("%s cannot be kept: %s", path, problem)


class Store:
    """The file. A thread that holds the lock of the registrations adds its lines."""

    def __init__(self, folder: str, lock: ContextManager[Any], parts: Callable[[], Iterable[List[Record]]]) -> None:
        """`parts()`: all that the roscore knows, a few records at a time. It takes the lock itself.

        Changes that come meanwhile may be in it or not: they are added.
        """
        self._folder, self._path = folder, os.path.join(folder, store_format.FILE)
        self._lock, self._parts = lock, parts
        self._file: Optional[int] = None
        self._guard: Optional[int] = None  # the folder, locked: one roscore has it
        self._number = self._size = self._base = 0
        self._waiting = 0  # the weight of the changes in `_meanwhile`
        self._meanwhile: Optional[List[Sequence[Record]]] = None  # changes while a new file is written
        self._dirty = threading.Event()
        self._warned = ""
        self._left_out: Set[str] = set()  # parameters with values that are not kept, of which a warning was given

    def start(self, snapshot: Optional[store_format.Content] = None) -> None:
        """Go on in the file of a snapshot, or write a new one. Then sync and renew it in a thread."""
        old = snapshot is not None and self._resume(snapshot)
        if not old:
            self._renew(rest=False)
        threading.Thread(target=self._run, args=(old,), name="store", daemon=True).start()

    def add(self, records: Sequence[Record]) -> None:
        """Add the changes of one call."""
        if self._meanwhile is not None:
            self._meanwhile.append(records)
            self._waiting += sum(weigh(record.value) for record in records if record.kind == "set")
        if self._file is None:
            return
        try:
            self._append(self._file, records)
        except Exception as problem:
            self._abandon(problem)
        self._dirty.set()

    def wait(self) -> bool:
        """Wait if much was changed in a short time; False if that does not help. Call it without the lock."""
        until = monotonic() + PATIENCE
        while store_format.must_wait(self._size if self._file is not None else 0, self._base, self._waiting):
            self._dirty.set()
            if monotonic() > until:
                return False
            sleep(SYNC)
        return True

    def sync(self) -> None:
        """Sync the written lines to the disk."""
        with self._lock:
            file = self._file
        try:
            if file is not None:
                os.fdatasync(file)
        except OSError as problem:
            with self._lock:
                self._abandon(problem)  # lines may be lost: all is written anew

    def _append(self, file: int, records: Sequence[Record]) -> None:
        line = self._line(self._number + 1, records)
        written = os.write(file, line)
        if written < len(line):
            os.ftruncate(file, self._size)
            raise OSError(f"only {written} of {len(line)} bytes could be written")
        self._number, self._size = self._number + 1, self._size + written

    def _line(self, number: int, records: Sequence[Record]) -> bytes:
        """A line. Values that cannot be kept are left out, with one warning for each parameter."""
        try:
            return store_format.format_records(number, records)
        except (TypeError, ValueError, OverflowError, RecursionError):
            kept, without = store_format.strip_values(records)
            for name in without:
                if name not in self._left_out and len(self._left_out) < _WARNINGS:
                    self._left_out.add(name)
                    _log.warning("%s has a value that cannot be kept: after a restart it is without it", plain(name))
            return store_format.format_records(number, kept)

    def _resume(self, snapshot: store_format.Content) -> bool:
        """Go on in the file of a snapshot. The sync of a new one takes seconds if the disk is busy."""
        if not snapshot.size:
            return False
        try:
            self._lock_folder()
            os.truncate(self._path, snapshot.size)  # without half a line
            file = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
        except OSError:
            return False
        self._file, self._size, self._number = file, snapshot.size, snapshot.lines
        return True

    def _run(self, old: bool) -> None:
        if old:
            self._renew()
        while True:
            try:
                self._sync_once()
            except Exception as problem:  # without this thread nothing would be kept any more
                with self._lock:
                    self._abandon(problem)

    def _sync_once(self) -> None:
        self._dirty.wait(None if self._file is not None else AGAIN)
        sleep(SYNC)
        self._dirty.clear()
        if self._file is None:
            sleep(AGAIN)
            self._renew()
        else:
            self.sync()
            if store_format.is_renewal_due(self._size, self._base):
                self._renew()

    def _renew(self, rest: bool = True) -> None:
        """Write a new file next to the old one, and replace the old one by it."""
        new = None
        self._start_over()
        try:
            self._lock_folder()
            new = os.open(self._path + ".new", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
            number = self._write(new, rest)
            number = self._write_all(new, number, self._start_over())
            os.fdatasync(new)
            with self._lock:
                old = self._take(new, number)
            new = None
            if old is not None:
                os.close(old)
            if self._guard is not None:
                os.fsync(self._guard)
            if self._warned:
                _log.warning("the state of the roscore is kept again")
                self._warned = ""
        except Exception as problem:
            with self._lock:
                self._meanwhile, self._waiting = None, 0
                self._abandon(problem)
            if new is not None:
                os.close(new)
                with contextlib.suppress(OSError):
                    os.remove(self._path + ".new")

    def _start_over(self) -> List[Sequence[Record]]:
        """Note changes from now on; the changes since the call before."""
        with self._lock:
            meanwhile, self._meanwhile, self._waiting = self._meanwhile or [], [], 0
        return meanwhile

    def _write(self, file: int, rest: bool) -> int:
        """Write all there is; the number of the last line."""
        _write_whole(file, store_format.format_head(read_boot_id()))
        number = 0
        for part in self._parts():
            number = self._write_all(file, number, [[record] for record in part])
            if rest:
                sleep(_REST)
        return number

    def _write_all(self, file: int, number: int, changes: Sequence[Sequence[Record]]) -> int:
        """Write a line for each change after the line of this number; the number of the last one."""
        for at, records in enumerate(changes, number + 1):  # one by one: each may be large
            _write_whole(file, self._line(at, records))
        return number + len(changes)

    def _take(self, new: int, number: int) -> Optional[int]:
        """Replace the old file by the new one; the old one. The lock is held."""
        self._base = os.fstat(new).st_size
        number = self._write_all(new, number, self._meanwhile or [])
        os.replace(self._path + ".new", self._path)
        old, self._file = self._file, new
        self._number, self._size, self._meanwhile = number, os.fstat(new).st_size, None
        self._waiting = 0
        self._dirty.set()
        return old

    def _lock_folder(self) -> None:
        """Lock the folder for this roscore. Raises OSError."""
        if self._guard is None:
            os.makedirs(self._folder, mode=0o700, exist_ok=True)
            guard = os.open(self._folder, os.O_RDONLY | os.O_CLOEXEC)
            try:
                fcntl.flock(guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(guard)
                raise OSError(f"another roscore keeps its registrations in {self._folder}") from None
            self._guard = guard

    def _abandon(self, problem: Exception) -> None:
        """Give the file up. It stays as it is, and a new one is tried later."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
        if self._warned != str(problem):
            self._warned = str(problem)
            _log.warning(
                "the state of the roscore cannot be kept in %s: %s; it goes on, and would come back as it was before",
                self._folder,
                problem,
            )
        self._dirty.set()


def _write_whole(file: int, data: bytes) -> None:
    if os.write(file, data) < len(data):
        raise OSError("no space left")
