# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run at a time: a lock in the folder of the records, held while a run reads, plans, changes and records.

It is flock(2) on a file that only root may open. So the kernel frees it when a run is killed, and no ordinary user can hold
it. The file goes with the run, and the next run removes the file of a killed one.

Check mode takes no lock, since it makes no file. It waits for a run that works, and reads again if one began meanwhile.
"""

import contextlib
import fcntl
import os
import time
import typing

from ..._base.problem import Problem
from . import atomic

NAME = "lock"  # of the file, in the folder of the records
WAIT = 60.0  # seconds for a run before this one
_PAUSE = 0.05
_VANISHING = 1.0  # seconds in which the folder may come and go with foreign runs
_WORDS = 200  # bytes

T = typing.TypeVar("T")


@contextlib.contextmanager
def hold(folders: typing.Iterable[str], name: str) -> typing.Iterator[typing.List[str]]:
    """Hold the locks of these folders of records; `name` is that of the module. Raises Problem if a run does not end.

    Gives a sentence for each folder in which no lock can be had, as on a read-only file system.
    """
    deadline = time.monotonic() + WAIT
    sentences: typing.List[str] = []
    with contextlib.ExitStack() as locks:
        # In one order, so that no two runs wait for each other.
        for folder in sorted(set(filter(os.path.isabs, folders))):
            try:
                locks.callback(_free, folder, *_take(folder, name, deadline))
            except OSError as problem:
                sentences.append(
                    f"{os.path.join(folder, NAME)} cannot be locked ({problem.strerror or problem}), so a run at the same time "
                    "would not be noticed: let no two runs change this computer at once."
                )
        yield sentences


def read_undisturbed(folder: str, read: typing.Callable[[], T]) -> T:
    """Return the result of `read` while no run holds the lock. Raises Problem as `hold`, and the errors of `read`.

    A result that was read while a run changed something is neither returned nor raised.
    """
    deadline = time.monotonic() + WAIT
    while True:
        before = _trace(folder)  # first: a run may begin after the wait
        _wait(os.path.join(folder, NAME), deadline)
        try:
            content = read()
        except Problem:
            if _trace(folder) == before:
                raise
        else:
            if _trace(folder) == before:
                return content
        if time.monotonic() > deadline:
            raise Problem(
                f"Other runs have changed this computer again and again for {WAIT:g} s, so no state of it could be read: "
                "wait for their end and run the play again."
            )


def _take(folder: str, name: str, deadline: float) -> typing.Tuple[int, typing.List[str]]:
    """Wait for the lock of a folder; returns its descriptor, and the folders made for it, outermost first.

    Raises OSError if no lock can be had, Problem if a run does not end. Then nothing of the lock is left.
    """
    path = os.path.join(folder, NAME)
    made: typing.List[str] = []
    vanishing = time.monotonic() + _VANISHING
    with contextlib.ExitStack() as undo:
        undo.callback(_remove_folders, folder, made)
        while True:
            try:
                for place in atomic.find_missing_folders(folder):  # one by one: others may make some of them meanwhile
                    made += atomic.make_folders(place)
                descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            except (FileExistsError, FileNotFoundError):  # runs make this folder at their start, and remove it
                if time.monotonic() > vanishing:
                    raise
                continue
            try:
                if _is_free(descriptor, fcntl.LOCK_EX, path, deadline) and _is_at(descriptor, path):
                    _sign(descriptor, name)
                    undo.pop_all()
                    return descriptor, made
            except BaseException as problem:
                if isinstance(problem, OSError):  # a file system without locks
                    _remove_unsigned(descriptor, path)
                os.close(descriptor)
                raise
            os.close(descriptor)
            vanishing = time.monotonic() + _VANISHING  # it may come and go again after the run that had it


def _free(folder: str, descriptor: int, made: typing.Sequence[str]) -> None:
    """End a run: remove the file and the folders that are empty then, and free the lock. The kernel does the last one in any case."""
    with contextlib.suppress(OSError):
        path = os.path.join(folder, NAME)
        if _is_at(descriptor, path):
            atomic.remove(path)
    _remove_folders(folder, made)
    os.close(descriptor)


def _remove_folders(folder: str, made: typing.Sequence[str]) -> None:
    """Remove the folder of a lock, and those made for it, if they are empty."""
    for place in [folder, *reversed(made)]:
        with contextlib.suppress(OSError):
            atomic.remove_folder_if_empty(place)


def _remove_unsigned(descriptor: int, path: str) -> None:
    """Remove a file that cannot be locked. One with the name of a process stays, since that may hold it."""
    with contextlib.suppress(OSError):
        if not os.fstat(descriptor).st_size and _is_at(descriptor, path):
            atomic.remove(path)


def _wait(path: str, deadline: float) -> None:
    """Wait until no run holds the lock. Raises Problem."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError:  # no run, or this user may not see it
            return
        try:
            if _is_free(descriptor, fcntl.LOCK_SH, path, deadline):
                return
        except OSError:  # a file system without locks
            return
        finally:
            os.close(descriptor)


def _is_free(descriptor: int, kind: int, path: str, deadline: float) -> bool:
    """Try to lock a file. False if a run holds it, after a pause; raises Problem if it has held it for too long."""
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        if time.monotonic() > deadline:
            raise Problem(_busy(descriptor, path)) from None
        time.sleep(_PAUSE)
        return False


def _is_at(descriptor: int, path: str) -> bool:
    """True if the file is still that of the path: the run that held it before has removed its own."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except FileNotFoundError:
        return False


def _sign(descriptor: int, name: str) -> None:
    """Write the name of this process into the lock, for the sentence of a run that waits in vain."""
    with contextlib.suppress(OSError):  # a full disk
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()} {name}".encode("utf-8", "replace")[:_WORDS], 0)


def _busy(descriptor: int, path: str) -> str:
    pid, _blank, name = os.pread(descriptor, _WORDS, 0).decode("utf-8", "replace").partition(" ")
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(os.fstat(descriptor).st_mtime))
    return (
        f"The process {pid or 'that holds ' + path} ({name or 'a module'}) changes this computer since {since} and has not ended "
        f"within {WAIT:g} s, so nothing was done here: wait for its end and run the play again; if it hangs, end it "
        f"(kill {pid or '<process>'})."
    )


def _trace(folder: str) -> typing.List[typing.Tuple[int, int]]:
    """The marks of a lock that is taken and freed: the times of the file and of the nearest folder that exists."""
    while not os.path.isdir(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    stamps = []
    for place in (folder, os.path.join(folder, NAME)):
        with contextlib.suppress(OSError):
            status = os.lstat(place)
            stamps.append((status.st_ino, status.st_mtime_ns))
    return stamps
