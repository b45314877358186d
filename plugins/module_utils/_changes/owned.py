# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
# Private to this collection: may change at any time.

"""What is ours on a machine: records of it, files written by rename, and their differences.

A file is replaced by writing a neighbour and renaming it, so whoever reads it, and whatever ends the
writer, finds the old content or the new one (rename(2)).
"""

import errno
import glob
import json
import os

RECORDS = "/var/lib/rosfleet-multimaster"
_NEIGHBOUR = ".rosfleet-new"


class Problem(Exception):
    """One sentence for the user: what was found, what was expected, what to do."""


def sentence(problem):
    # type: (Exception) -> str
    """What an exception of a half-done change says to the user: a Problem its own words, an OSError which file."""
    if isinstance(problem, OSError):
        return "%s cannot be written (%s), expected a writable file system with room." % (
            problem.filename or "A file",
            problem.strerror,
        )
    return str(problem)


def read_bytes(path):
    # type: (str) -> typing.Optional[bytes]
    """The content of a file, or None where there is none."""
    try:
        with open(path, "rb") as stream:
            return stream.read()
    except (FileNotFoundError, NotADirectoryError):
        return None


def write_by_rename(path, content, mode=0o644, owner=None):
    # type: (str, bytes, int, typing.Optional[typing.Tuple[int, int]]) -> None
    """Replace a file in one step, with these permission bits and, where given, this (uid, gid).

    Raises OSError with the file unchanged; EBUSY means that the path is a mount point.
    """
    remove_leftovers(path)
    neighbour = "%s%s-%d" % (path, _NEIGHBOUR, os.getpid())
    descriptor = os.open(neighbour, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            if owner is not None:
                os.fchown(stream.fileno(), owner[0], owner[1])
            os.fchmod(stream.fileno(), mode)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.rename(neighbour, path)
    except BaseException:
        remove(neighbour)
        raise
    sync_folder(os.path.dirname(path))


def remove_leftovers(path):
    # type: (str) -> None
    """Remove the neighbours that an ended writer of this path left behind."""
    for leftover in leftovers(path):
        remove(leftover)


def leftovers(path):
    # type: (str) -> typing.List[str]
    """The neighbours that an ended writer of this path left behind."""
    return glob.glob(glob.escape(path + _NEIGHBOUR) + "-*")


def remove(path):
    # type: (str) -> None
    """Remove a file; that it is already gone is no error."""
    try:
        os.unlink(path)
    except FileNotFoundError:
        return


def make_folders(path):
    # type: (str) -> typing.List[str]
    """Make a folder (mode 0755) and its missing parents; returns those that were made, outermost first."""
    missing = []
    while path and not os.path.isdir(path):
        missing.append(path)
        path = os.path.dirname(path)
    for folder in reversed(missing):
        os.mkdir(folder, 0o755)
        os.chmod(folder, 0o755)
    return missing[::-1]


def remove_folder_if_empty(path):
    # type: (str) -> bool
    """Remove a folder that holds nothing; returns whether it is gone."""
    try:
        os.rmdir(path)
    except FileNotFoundError:
        return True
    except OSError as problem:
        if problem.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.EBUSY):
            return False
        raise
    return True


def sync_folder(path):
    # type: (str) -> None
    """Make renames and removals in a folder last over a loss of power (fsync(2) of the folder)."""
    descriptor = os.open(path or ".", os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Record:
    """What one module remembers on this machine: a JSON object in a file of its own, absent while empty."""

    def __init__(self, name, folder=RECORDS):
        # type: (str, str) -> None
        self.path = os.path.join(folder, name + ".json")

    def load(self):
        # type: () -> typing.Dict[str, typing.Any]
        """The remembered object, or an empty one. Raises Problem where the file is not ours to read."""
        try:
            content = read_bytes(self.path)
        except OSError as problem:
            raise Problem(
                "The record %s cannot be read (%s); expected a file that this module wrote: run as root (become: true)."
                % (self.path, problem.strerror)
            ) from problem
        if content is None:
            return {}
        try:
            data = json.loads(content.decode("utf-8"))
        except ValueError as problem:
            raise Problem(
                "The record %s is not readable as JSON (%s); expected what this module wrote there: "
                "restore it from a backup, or remove it and what it owned by hand." % (self.path, problem)
            ) from problem
        if not isinstance(data, dict):
            raise Problem("The record %s holds no JSON object; remove it to start without a memory." % self.path)
        return data

    def save(self, data):
        # type: (typing.Dict[str, typing.Any]) -> None
        """Remember an object; an empty one removes the file, and the folder with the last file."""
        folder = os.path.dirname(self.path)
        if data:
            make_folders(folder)
            text = json.dumps(data, indent=2, sort_keys=True) + "\n"
            write_by_rename(self.path, text.encode("utf-8"), mode=0o600)
        else:
            remove_leftovers(self.path)
            remove(self.path)
            remove_folder_if_empty(folder)


def records(folder=RECORDS):
    # type: (str) -> typing.List[str]
    """The names of the records on this machine, sorted."""
    return sorted(os.path.basename(path)[:-5] for path in glob.glob(os.path.join(glob.escape(folder), "*.json")))


def difference(path, before, after):
    # type: (str, typing.Optional[bytes], typing.Optional[bytes]) -> typing.Dict[str, str]
    """One entry of a module's `diff`: a file's text before and after; None is a file that is not there."""

    def text(content):
        # type: (typing.Optional[bytes]) -> str
        return "" if content is None else content.decode("utf-8", "replace")

    return {
        "before_header": path if before is not None else path + " (absent)",
        "after_header": path if after is not None else path + " (absent)",
        "before": text(before),
        "after": text(after),
    }
