# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""A process that outlives its module, and its door: the socket at which a later run of the module asks it.

A request is one JSON line, and so is the reply. The folder of the doors is root's, so other users cannot add one.
"""

import contextlib
import errno
import glob
import hashlib
import json
import os
import re
import signal
import socket
import syslog
import time
import typing

from .plain_text import LINE, plain, quote
from .problem import Problem

FOLDER = "/run/rosfleet-multimaster"
LONGEST_LINE = 1 << 24  # bytes of a request or reply; the files of the nodes are half a megabyte
ENDING = 5.0  # seconds that a process has to end, and to put its door away
PAUSE = 0.02  # seconds between two looks whether it has
REQUEST = 2.0  # seconds that a process waits for a request, and does nothing else
VISITS = 3  # times that a visitor tries: a busy computer may stop it between its arrival and its request
RIVALS = 3  # tasks of one run that begin at the same time on a computer; the last one stays

Line = typing.Dict[str, typing.Any]


def find_wrong_value(
    params: typing.Dict[str, typing.Any], bounds: typing.Iterable[typing.Tuple[str, float, float]], unit: str = ""
) -> typing.Optional[str]:
    """Return a sentence if the label of the run, or a number, cannot be used; None if all can."""
    if not re.match(r"[A-Za-z0-9._-]{1,64}\Z", params["run"]):
        return f"run is {params['run']!r}, expected 1 to 64 letters, digits, dots, hyphens or underscores."
    for option, least, most in bounds:
        if not least <= params[option] <= most:
            return f"{option} is {params[option]}, expected {least} to {most}{unit}."
    return None


@contextlib.contextmanager
def explain_refusal(action: str, remedies: typing.Optional[typing.Mapping[int, str]] = None) -> typing.Iterator[None]:
    """Raise Problem for an OSError in this block: the failed action, the reason, and the remedy; `remedies` by errno."""
    try:
        yield
    except OSError as error:
        is_refused = isinstance(error, PermissionError)
        remedy = "it needs root, so set become: true" if is_refused else (remedies or {}).get(error.errno or 0)
        raise Problem(f"{action}: {error.strerror or error}{f'; {remedy}' if remedy else ''}.") from error


# The process


def leave(serve: typing.Callable[[], None], sockets: typing.Iterable[socket.socket], who: str) -> None:
    """Leave a process behind that runs `serve` and keeps only `sockets` open; the log calls it `who`."""
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    try:
        os.setsid()
        if os.fork():
            os._exit(0)
        _let_go(item.fileno() for item in sockets)
        serve()
    except Exception as error:  # the module has ended, so only the log is left
        syslog.syslog(syslog.LOG_ERR, plain(f"{who} ended: {quote(repr(error), LINE)}", LINE))
    finally:
        os._exit(0)


def _end(*unused: typing.Any) -> None:
    raise SystemExit  # so that `serve` removes the door


def _let_go(descriptors: typing.Iterable[int]) -> None:
    """Close everything but these descriptors: no terminal, no pipe of Ansible's and no folder stays busy."""
    os.chdir("/")
    syslog.closelog()  # else it would write to whatever gets the number of its descriptor
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    numbers = set(descriptors)
    for number in [int(name) for name in os.listdir("/proc/self/fd")]:
        if number not in numbers:
            with contextlib.suppress(OSError):  # the listing's own descriptor
                os.close(number)
    for standard in (os.O_RDONLY, os.O_WRONLY, os.O_WRONLY):
        os.open(os.devnull, standard)


# Its side of the door


def path_of(kind: str, run: str) -> str:
    """Return the path of the door of a run. All users can read it, so the label of the run is hashed."""
    name = hashlib.sha256(b"door " + run.encode()).hexdigest()[:16]
    return os.path.join(FOLDER, f"{kind}-{name}.sock")


def open_door(path: str) -> socket.socket:
    """Open a door for root only. A process that another task of the same run has just left behind ends. Raises OSError."""
    for _rival in range(RIVALS):
        try:
            return _bind(path)
        except (FileNotFoundError, FileExistsError):
            pass  # the last one that has ended has just removed the folder, before our look at it or after it
        except OSError as problem:
            if problem.errno != errno.EADDRINUSE:
                raise
            _end_one(path)
    return _bind(path)


def _bind(path: str) -> socket.socket:
    os.makedirs(os.path.dirname(path), 0o755, exist_ok=True)
    door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        door.bind(path)
        door.listen(8)
    except OSError:
        door.close()
        raise
    finally:
        os.umask(before)
    return door


def admit(door: socket.socket) -> typing.Optional[typing.Tuple[socket.socket, Line]]:
    """Accept the next visitor, and read its request; None if none comes in time, or one in a wrong form. A late visitor tries again."""
    connection = door.accept()[0]
    connection.settimeout(REQUEST)
    with contextlib.suppress(OSError, ValueError):
        request = json.loads(_line(connection))
        if isinstance(request, dict):
            return connection, request
    connection.close()
    return None


def answer(connection: socket.socket, reply: Line) -> None:
    """Reply to a visitor, and let it go."""
    with connection, contextlib.suppress(OSError):  # the visitor is gone
        connection.settimeout(5)
        connection.sendall(json.dumps(reply).encode() + b"\n")


def remove_door(path: str) -> None:
    """Remove a door, and its folder if that is empty."""
    for remove, what in ((os.unlink, path), (os.rmdir, os.path.dirname(path))):
        with contextlib.suppress(OSError):  # gone already, or the folder holds more than our door
            remove(what)


# The visitor's side


class Visit:
    """A request to such a process. Raises OSError if no process listens."""

    def __init__(self, path: str, request: Line) -> None:
        if os.stat(path).st_uid != os.geteuid():
            raise PermissionError(f"{quote(path)} belongs to another user")
        line = json.dumps(request).encode() + b"\n"
        for left in reversed(range(VISITS)):
            self.connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self.connection.settimeout(5)
            try:
                self.connection.connect(path)
                self.connection.sendall(line)
                break
            except OSError as problem:
                self.connection.close()
                # The process has waited for long enough, or has ended.
                if not left or not isinstance(problem, (BrokenPipeError, ConnectionResetError)):
                    raise

    def reply(self, seconds: float) -> typing.Optional[Line]:
        """Read the reply; None if the process ended without one, or not within that time."""
        self.connection.settimeout(seconds)
        try:
            return json.loads(_line(self.connection))
        except (OSError, ValueError):
            return None
        finally:
            self.connection.close()


def ask(path: str, request: Line, seconds: float) -> Line:
    """Ask the process of a door, and read its reply; empty if no process listens, or if the process ends without a reply."""
    try:
        return Visit(path, request).reply(seconds) or {}
    except OSError:
        return {}


def end_others(kind: str) -> None:
    """End each older process of a kind through its door, and remove doors without a process. Raises OSError."""
    for path in glob.glob(os.path.join(FOLDER, f"{kind}-*.sock")):
        _end_one(path)


def _end_one(path: str) -> None:
    """End the process of a door, and wait until the door is gone, so that a new one has its place. Raises OSError."""
    door = _identify(path)
    try:
        Visit(path, {"do": "end"}).reply(ENDING)
    except ConnectionRefusedError:
        remove_door(path)
    except (FileNotFoundError, BrokenPipeError, ConnectionResetError):
        pass  # it is just ending by itself
    deadline = time.monotonic() + ENDING
    while door and door == _identify(path) and time.monotonic() < deadline:
        time.sleep(PAUSE)


def _identify(path: str) -> typing.Optional[typing.Tuple[int, int]]:
    """Return the file number and time of a door: a new door at the same path has others. None without a door."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_ctime_ns


def _line(connection: socket.socket) -> str:
    data = b""
    while not data.endswith(b"\n") and len(data) < LONGEST_LINE:
        more = connection.recv(65536)
        if not more:
            break
        data += more
    return data.decode()
