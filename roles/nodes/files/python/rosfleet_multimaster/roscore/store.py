# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The store of the roscore: a file with a line for each change, which a thread syncs to the disk and writes anew.

A line is written before the caller has its answer, so it survives the end of the process; within 0.1 s it survives a loss
of power. Where it cannot be written, there is a warning, the roscore goes on, and a new file is tried again and again.
"""

import contextlib
import fcntl
import logging
import os
import threading
import xmlrpc.client
from typing import (
    Any,
    BinaryIO,
    Callable,
    ContextManager,
    Iterable,
    Iterator,
    List,
    NamedTuple,
    Optional,
    Sequence,
    Set,
)

from ..edge.clock import monotonic, sleep
from ..protocol.plain_text import plain
from .core import store_format
from .core.bounds import weigh
from .core.registry import Record, Registry

_log = logging.getLogger("rosfleet.store")

SYNC = 0.05  # seconds from a change to its sync
PATIENCE = 10.0  # seconds that a change waits where much was changed in a short time
AGAIN = 10.0  # seconds until a file that cannot be written is tried again
STARTS = 5  # starts that come to nothing, after which the store is put aside
LARGEST = 1 << 30  # bytes of a store that is read; that of a roscore within its bounds has a fourth of it
LONGEST = 1 << 27  # bytes of one line
_STARTS = ".starts"  # the file beside it with a byte for each such start
_SAID = 1000  # parameters of which it is said that they cannot be kept
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
    """Read the store of this folder. One that cannot be read is put aside, whole or in part, with a warning: never fatal."""
    path = os.path.join(folder, store_format.FILE)
    try:
        if _starts_in_vain(folder) >= STARTS:
            _put_aside(path, f"the last {STARTS} starts with it have come to nothing, so it starts with nothing")
            return None
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            found = store_format.read(_lines(file), _special) if size <= LARGEST else None
    except FileNotFoundError:
        return None
    except Exception as problem:  # whatever it is: a roscore that knows nothing is better than none
        _put_aside(path, f"it cannot be read ({type(problem).__name__}), so the roscore starts with nothing")
        return None
    if found is None:
        _put_aside(path, "nothing in it can be read, so the roscore starts with nothing")
        return None
    broken = found.damaged or found.omissions
    if broken:
        _put_aside(path, "what can be read of it counts")
    elif found.torn:
        _log.info("the last change was not written to its end in %s: nobody had an answer to it", path)
    another_boot = found.boot != boot()
    return Found(found.registry, another_boot, 0 if broken or another_boot else found.size, found.lines)


def _lines(file: BinaryIO) -> Iterator[bytes]:
    """The lines of the file, none of them without a bound."""
    return iter(lambda: file.readline(LONGEST), b"")


def _starts_in_vain(folder: str) -> int:
    """How many starts with this store have not come as far as `settled`; this one is counted with them from now on."""
    path = os.path.join(folder, store_format.FILE)
    os.stat(path)  # else there is nothing to put aside
    try:
        count = os.path.getsize(path + _STARTS)
    except FileNotFoundError:
        count = 0
    try:
        with open(path + _STARTS, "ab") as file:
            file.write(b".")
    except OSError:  # a full or read-only disk: then there is no count
        pass
    return count


def settled(folder: str) -> None:
    """The roscore works: this start counts no more among those that came to nothing."""
    with contextlib.suppress(OSError):
        os.remove(os.path.join(folder, store_format.FILE + _STARTS))


def give_up(folder: str, why: str) -> None:
    """Put the store aside: what was read cannot be used."""
    _put_aside(os.path.join(folder, store_format.FILE), why)


def forget(folder: str) -> bool:
    """Remove the store. Whether there was one. Raises OSError."""
    settled(folder)
    try:
        os.remove(os.path.join(folder, store_format.FILE))
    except FileNotFoundError:
        return False
    return True


def _special(value: store_format.Special) -> Any:
    return getattr(xmlrpc.client, value.kind)(value.content())


def _put_aside(path: str, why: str) -> None:
    _log.warning("%s is damaged: %s; the file is kept as %s.damaged", path, why, path)
    try:
        os.replace(path, path + ".damaged")
        os.remove(path + _STARTS)
    except FileNotFoundError:
        pass
    except OSError as problem:
        _log.warning("%s cannot be kept: %s", path, problem)


class Store:
    """The file. Its lines are added by who holds the lock of the registrations."""

    def __init__(self, folder: str, lock: ContextManager[Any], parts: Callable[[], Iterable[List[Record]]]) -> None:
        """`parts()`: all that the roscore knows, a few records at a time, which takes the lock itself.

        What changes meanwhile may be in it or not: it is added.
        """
        self._folder, self._path = folder, os.path.join(folder, store_format.FILE)
        self._lock, self._parts = lock, parts
        self._file: Optional[int] = None
        self._guard: Optional[int] = None  # the folder, locked: one roscore has it
        self._number = self._size = self._base = 0
        self._waiting = 0  # what the changes count that came while a new file is written
        self._meanwhile: Optional[List[Sequence[Record]]] = None  # what changes while a new file is written
        self._old = False  # the file is one of an earlier life
        self._dirty = threading.Event()
        self._warned = ""
        self._left_out: Set[str] = set()  # parameters with values that are not kept, and of which that was said

    def start(self, found: Optional[Found] = None) -> None:
        """Go on in the file that was found, or write one with all there is. Then sync and renew it in a thread."""
        if found is None or not self._go_on(found):
            self._renew(rest=False)
        threading.Thread(target=self._keep, name="store", daemon=True).start()

    def add(self, records: Sequence[Record]) -> None:
        """Add the changes of one call."""
        if self._meanwhile is not None:
            self._meanwhile.append(records)
            self._waiting += sum(weigh(record[2]) for record in records if record[0] == "set")
        if self._file is None:
            return
        try:
            self._append(self._file, records)
        except Exception as problem:
            self._failed(problem)
        self._dirty.set()

    def wait(self) -> bool:
        """Wait where much was changed in a short time; False where that does not help. Before a change, without the lock."""
        until = monotonic() + PATIENCE
        while store_format.must_wait(self._size if self._file is not None else 0, self._base, self._waiting):
            self._dirty.set()
            if monotonic() > until:
                return False
            sleep(SYNC)
        return True

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
        line = self._line(self._number + 1, records)
        written = os.write(file, line)
        if written < len(line):
            os.ftruncate(file, self._size)
            raise OSError(f"only {written} of {len(line)} bytes could be written")
        self._number, self._size = self._number + 1, self._size + written

    def _line(self, number: int, records: Sequence[Record]) -> bytes:
        """A line. Values that cannot be kept are left out of it, which is said once for each parameter."""
        try:
            return store_format.format_line(number, records)
        except (TypeError, ValueError, OverflowError, RecursionError):
            kept, without = store_format.strip_values(records)
            for name in without:
                if name not in self._left_out and len(self._left_out) < _SAID:
                    self._left_out.add(name)
                    _log.warning("%s has a value that cannot be kept: after a restart it is without it", plain(name))
            return store_format.format_line(number, kept)

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
            try:
                self._keep_once()
            except Exception as problem:  # this thread never ends: nothing would be kept any more
                with self._lock:
                    self._failed(problem)

    def _keep_once(self) -> None:
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
        """Write a new file beside the old one, which counts until the new one takes its place."""
        new = None
        self._start_over()
        try:
            self._own()
            new = os.open(self._path + ".new", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
            number = self._write(new, rest)
            number = self._write_all(new, number, self._start_over())
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
        except Exception as problem:
            with self._lock:
                self._meanwhile, self._waiting = None, 0
                self._failed(problem)
            if new is not None:
                os.close(new)
                with contextlib.suppress(OSError):
                    os.remove(self._path + ".new")

    def _start_over(self) -> List[Sequence[Record]]:
        """Note what changes from now on; what changed since this was called before."""
        with self._lock:
            meanwhile, self._meanwhile, self._waiting = self._meanwhile or [], [], 0
        return meanwhile

    def _write(self, file: int, rest: bool) -> int:
        """Write all there is; the number of the last line."""
        _write_whole(file, store_format.format_head(boot()))
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
        """The new file takes the place of the old one, which is returned. The lock is held."""
        self._base = os.fstat(new).st_size
        number = self._write_all(new, number, self._meanwhile or [])
        os.replace(self._path + ".new", self._path)
        old, self._file = self._file, new
        self._number, self._size, self._meanwhile = number, os.fstat(new).st_size, None
        self._waiting = 0
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


def _write_whole(file: int, data: bytes) -> None:
    if os.write(file, data) < len(data):
        raise OSError("no space left")
