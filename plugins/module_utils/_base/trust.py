# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The users that can change a path. They decide if root, a person or a service may act on it."""

import grp
import os
import pwd
import re
import stat
import time
import typing

from .plain_text import quote

_LINKS = 40  # as many as the kernel follows (path_resolution(7))
_ACL = "system.posix_acl_access"
_ACCOUNT = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,31}")
EVERYBODY = -1  # in place of a user id: all accounts
A_GROUP = -2  # the members of a group, or of an access control list
# A workspace of a hundred packages has some hundred folders. Others choose the paths, and every link may have 2,000 parts.
MOST = 10000  # parts of paths
LIMIT = 5.0  # seconds
_UNKNOWN = ", so it is not known who can change them"


class Doubt(typing.NamedTuple):
    """A part of a path that other users than root can change: the user id, or a constant from above, and a few words."""

    who: int
    words: str


class TrustCheck:
    """A look at many paths. Each part is looked at once. There are limits, because others choose the paths."""

    def __init__(self, most: int = MOST, limit: float = LIMIT) -> None:
        """Look at `most` parts in `limit` seconds."""
        self._most, self._limit = most, limit
        self._end = time.monotonic() + limit
        self._seen: typing.Dict[typing.Tuple[str, bool], typing.Tuple[bool, typing.Optional[Doubt]]] = {}

    def doubts(self, path: str) -> typing.List[Doubt]:
        """Find the parts of an absolute path, up to `/`, that others than root can change; links are followed.

        The folder above decides about a part that does not exist yet. A limit that is reached is a doubt, too.
        """
        doubts: typing.Dict[Doubt, None] = {}
        here, links = "/", 0
        waiting = [part for part in reversed(path.split("/")) if part]
        self._look(here, not waiting, doubts)
        while waiting:
            if time.monotonic() > self._end:
                doubts[Doubt(EVERYBODY, f"a look at its paths takes more than {self._limit:g} s{_UNKNOWN}")] = None
                break
            part = waiting.pop()
            if part in (".", ".."):
                here = os.path.dirname(here) if part == ".." else here
                continue
            above, here = here, os.path.join(here, part)
            there = self._look(here, not waiting, doubts)
            if there is False:
                self._look(above, True, doubts)
            if not there:
                break
            if os.path.islink(here):
                links += 1
                try:
                    target = os.readlink(here)
                except OSError:  # replaced meanwhile, by a user that is in the list already
                    break
                if links > _LINKS:
                    break  # it leads nowhere, also for the kernel
                here = "/" if target.startswith("/") else above
                waiting += [part for part in reversed(target.split("/")) if part]
        return list(doubts)

    def _look(self, path: str, last: bool, doubts: typing.Dict[Doubt, None]) -> typing.Optional[bool]:
        """Note the users that can change this one part. False if it is not there, None after the limit of parts."""
        if (path, last) not in self._seen:
            if len(self._seen) >= self._most:
                doubts[Doubt(EVERYBODY, f"its paths have more than {self._most} parts{_UNKNOWN}")] = None
                return None
            self._seen[path, last] = _look(path, last)
        there, doubt = self._seen[path, last]
        if doubt:
            doubts[doubt] = None
        return there


def _look(path: str, last: bool) -> typing.Tuple[bool, typing.Optional[Doubt]]:
    """Return if this one part of a path is there, and which users can change it."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False, None
    except OSError as problem:
        return False, Doubt(EVERYBODY, f"{quote(path)} cannot be looked at: {problem.strerror}")
    doubt = None
    if status.st_uid != 0:
        doubt = Doubt(status.st_uid, f"{quote(path)} belongs to {account(status.st_uid) or status.st_uid}")
    if stat.S_ISLNK(status.st_mode):
        return True, doubt  # its folder decides which users may replace it
    # In a folder such as /tmp, users replace their own files only, but all users add files.
    sticky = stat.S_ISDIR(status.st_mode) and status.st_mode & stat.S_ISVTX and not last
    if status.st_mode & stat.S_IWOTH and not sticky:
        return True, Doubt(EVERYBODY, f"{quote(path)} can be written by everybody")
    if doubt is None and status.st_mode & stat.S_IWGRP and not sticky and _is_shared(path, status):
        return True, Doubt(A_GROUP, f"{quote(path)} can be written by a group")
    return True, doubt


def _is_shared(path: str, status: os.stat_result) -> bool:
    """Return True if a group, or an access control list, gives others than the owner and root the right to write."""
    try:
        if os.getxattr(path, _ACL, follow_symlinks=False):
            return True
    except OSError:
        pass  # the file has no access control list
    try:
        members = set(grp.getgrgid(status.st_gid).gr_mem)
    except KeyError:
        members = set()
    members |= {entry.pw_name for entry in pwd.getpwall() if entry.pw_gid == status.st_gid}
    return bool(members - {account(0), account(status.st_uid)})


def account(uid: int) -> str:
    """Return the name of a user; empty without a name, or with one that files of settings would misread."""
    try:
        name = pwd.getpwuid(uid).pw_name
    except KeyError:
        return ""
    return name if _ACCOUNT.fullmatch(name) else ""
