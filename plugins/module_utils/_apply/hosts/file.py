# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The hosts file: read, and replaced by rename or, on a mount point, in place; libc, which uses it."""

import errno
import os
import socket
import time
import typing

from ..._base.problem import Problem
from ..transaction import atomic
from ..transaction.record import Record
from .bindings import Binding

# Renaming is refused on a mount point, and a single file that is mounted writable is in a folder that is not.
_NO_RENAME = (errno.EBUSY, errno.EROFS)


class HostsFile:
    """The file behind a path. It is replaced by rename; if it is a mount point, it is written in place.

    A run that is killed while it writes in place leaves a torn file: a mixture of the old and the new content. Both
    are in the record from before the first byte until the file is read back. So the next run recognizes a torn file
    and starts from the old content.
    """

    def __init__(self, path: str, records: str) -> None:
        """Read the file. Raises OSError, and Problem for a record that cannot be read or is malformed."""
        self.path = os.path.realpath(path)
        self.record = Record("hosts_entries", records, {"*": {"before": str, "after": str}})
        self.raw_content = atomic.read_bytes(self.path)
        self.content = self._repair()  # without a torn writing
        self.was_torn = self.raw_content != self.content  # a run was killed while it wrote in place

    def _repair(self) -> typing.Optional[bytes]:
        stored = self.record.load()
        if self.path not in stored or self.raw_content is None:
            return self.raw_content
        before, after = self.record.parse(lambda data: _texts(data[self.path]), stored)
        return before if self.raw_content != after and is_torn(self.raw_content, before, after) else self.raw_content

    def clean(self) -> None:
        """Remove the remains of a killed run from the folder and the record. Raises OSError, Problem."""
        atomic.remove_leftovers(self.path)
        atomic.remove_leftovers(self.record.path)
        self.record.save(self._record_with(None))

    def restore(self, content: typing.Optional[bytes]) -> None:
        """Take back the replacing by this content, if a later step has failed. Raises OSError, Problem."""
        now = atomic.read_bytes(self.path)
        if now == content != self.raw_content:
            before, self.raw_content, self.content = self.raw_content, now, now
            self.replace(before)

    def replace(self, content: typing.Optional[bytes]) -> str:
        """Give the file this content (None: remove it); returns how, as V(written) says. Raises OSError, Problem."""
        if atomic.read_bytes(self.path) != self.raw_content:
            raise Problem(
                f"{self.path} was changed by something else while this module was looking at it; expected it to stay "
                "still: run again. This module changed nothing."
            )
        if content is None:
            os.unlink(self.path)
            atomic.sync_folder(os.path.dirname(self.path))
            return "removed"
        try:
            atomic.write_by_rename(self.path, content, *atomic.permissions(self.path))
            return "rename"
        except OSError as problem:
            if self.raw_content is None or problem.errno not in _NO_RENAME:
                raise
        self._replace_in_place(content)
        return "in_place"

    def _replace_in_place(self, content: bytes) -> None:
        before = self.content or b""
        texts = {"before": before.decode("latin-1"), "after": content.decode("latin-1")}
        with open(self.path, "r+b", buffering=0) as stream:
            try:
                self.record.save(self._record_with(texts))
                _overwrite(stream, content)
            except OSError as problem:
                try:
                    _overwrite(stream, before)
                except OSError as stuck:
                    raise Problem(
                        f"{self.path} could neither be written in place nor given its old content again ({stuck.strerror}); "
                        "expected a file system with room: make room and run again, which repairs the file. "
                        f"The old content is kept in {self.record.path}."
                    ) from problem
                self.record.save(self._record_with(None))
                raise
        if atomic.read_bytes(self.path) != content:
            raise Problem(
                f"{self.path} does not read back as it was written in place; expected the new content: look for the program that "
                f"else writes it, and run again. The old content is kept in {self.record.path}."
            )
        self.record.save(self._record_with(None))

    def _record_with(self, under_way: typing.Optional[typing.Dict[str, str]]) -> typing.Dict[str, typing.Any]:
        """The record with the texts of the writing in place that is under way, None for none."""
        data = {path: texts for path, texts in self.record.load().items() if path != self.path}
        return dict(data, **{self.path: under_way}) if under_way else data


def _texts(under_way: typing.Dict[str, str]) -> typing.Tuple[bytes, bytes]:
    """The old and the new content that the record of a writing in place holds."""
    return under_way["before"].encode("latin-1"), under_way["after"].encode("latin-1")


def is_torn(content: bytes, before: bytes, after: bytes) -> bool:
    """True if each byte of the content is the old one, the new one or never written (0).

    Other content was written later by another program, and stays.
    """
    length = max(len(before), len(after))
    either = zip(content, before.ljust(length, b"\0"), after.ljust(length, b"\0"))
    return len(content) <= length and all(byte in (old, new, 0) for byte, old, new in either)


def _overwrite(stream: typing.IO[bytes], content: bytes) -> None:
    """Write a content over the old one; truncate last, so that a reader in between finds most of the file."""
    stream.seek(0)
    rest = memoryview(content)
    while rest:
        rest = rest[stream.write(rest) :]
    stream.truncate()
    os.fsync(stream.fileno())


def resolve(
    bindings: typing.List[Binding], seconds: float = 2.0
) -> typing.Iterator[typing.Dict[str, typing.List[str]]]:
    """Ask libc for the names of each binding: name -> the addresses of the binding's family, best first.

    No question is begun after so many seconds: libc reads the whole file for each, and a dead name server takes long. A
    name that was not asked for is not in the answer.
    """
    end = time.monotonic() + seconds
    for binding in bindings:
        family = socket.AF_INET if binding.address.version == 4 else socket.AF_INET6
        yield {name: _ask(name, family) for name in binding.names if time.monotonic() < end}


def _ask(name: str, family: int) -> typing.List[str]:
    try:
        return [str(answer[4][0]) for answer in socket.getaddrinfo(name, None, family, socket.SOCK_DGRAM)]
    except (OSError, UnicodeError):
        return []
