# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The answer to: who can change this path, and may root, a person or a service act on it? Ownership decides.

And the names of variables that a set-up file of ROS may give to root, to others, and to nobody.
"""

import grp
import os
import pwd
import re
import stat
import time
import typing

_LINKS = 40  # as many as the kernel follows (path_resolution(7))
_ACL = "system.posix_acl_access"
_ACCOUNT = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,31}")
EVERYBODY = -1  # stands for a user id: whoever has an account
A_GROUP = -2  # the members of a group, or of an access control list
# A workspace of a hundred packages has some hundred folders. Others choose the paths, and every link may have 2,000 parts.
MOST = 10000  # parts of paths
LIMIT = 5.0  # seconds
_UNKNOWN = ", so it is not known who can change them"


class Doubt(typing.NamedTuple):
    """A part of a path that somebody else than root can change: who (a user id, or one of the above), and a few words."""

    who: int
    words: str


def doubts(path: str, root: int = 0) -> typing.List[Doubt]:
    """Find the parts of an absolute path, up to `/`, that others than root can change; links are followed.

    A part that is not there yet is in the hands of those who can change the folder above it.
    """
    return Look(root).doubts(path)


class Look:
    """A look at many paths of one subject. Each part is looked at once, and there are limits, since others choose the paths."""

    def __init__(self, root: int = 0, most: int = MOST, limit: float = LIMIT) -> None:
        """`most` parts, in `limit` seconds."""
        self._root, self._most, self._limit = root, most, limit
        self._end = time.monotonic() + limit
        self._seen: typing.Dict[typing.Tuple[str, bool], typing.Tuple[bool, typing.Optional[Doubt]]] = {}

    def doubts(self, path: str) -> typing.List[Doubt]:
        """Find the doubts about one path, as the function `doubts` does; beyond a limit, that is the doubt."""
        found: typing.Dict[Doubt, None] = {}
        try:
            self._follow(path, found)
        except _TooMuchError as problem:
            found[Doubt(EVERYBODY, str(problem))] = None
        return list(found)

    def _follow(self, path: str, found: typing.Dict[Doubt, None]) -> None:
        here, links = "/", 0
        waiting = [part for part in reversed(path.split("/")) if part]
        self._look(here, not waiting, found)
        while waiting:
            if time.monotonic() > self._end:
                raise _TooMuchError(f"a look at its paths takes more than {self._limit:g} s{_UNKNOWN}")
            part = waiting.pop()
            if part in (".", ".."):
                here = os.path.dirname(here) if part == ".." else here
                continue
            above, here = here, os.path.join(here, part)
            if not self._look(here, not waiting, found):
                self._look(above, True, found)
                break
            if os.path.islink(here):
                links += 1
                try:
                    target = os.readlink(here)
                except OSError:  # it is another thing by now; who may do that is in the list already
                    break
                if links > _LINKS:
                    break  # it leads nowhere, also for the kernel
                here = "/" if target.startswith("/") else above
                waiting += [part for part in reversed(target.split("/")) if part]

    def _look(self, path: str, last: bool, found: typing.Dict[Doubt, None]) -> bool:
        """Note who can change this one part; False where it is not there."""
        if (path, last) not in self._seen:
            if len(self._seen) >= self._most:
                raise _TooMuchError(f"its paths have more than {self._most} parts{_UNKNOWN}")
            self._seen[path, last] = _look(path, last, self._root)
        there, doubt = self._seen[path, last]
        if doubt:
            found[doubt] = None
        return there


class _TooMuchError(Exception):
    """A limit of a look is reached; its text says which."""


def _look(path: str, last: bool, root: int) -> typing.Tuple[bool, typing.Optional[Doubt]]:
    """Return whether this one part of a path is there, and who can change it."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False, None
    except OSError as problem:
        return False, Doubt(EVERYBODY, f"{path} cannot be looked at: {problem.strerror}")
    doubt = None
    if status.st_uid not in (0, root):
        doubt = Doubt(status.st_uid, f"{path} belongs to {account(status.st_uid) or status.st_uid}")
    if stat.S_ISLNK(status.st_mode):
        return True, doubt  # who may replace it is decided by its folder
    # In a folder as /tmp nobody replaces what belongs to others, but everybody adds.
    sticky = stat.S_ISDIR(status.st_mode) and status.st_mode & stat.S_ISVTX and not last
    if status.st_mode & stat.S_IWOTH and not sticky:
        return True, Doubt(EVERYBODY, f"{path} can be written by everybody")
    if doubt is None and status.st_mode & stat.S_IWGRP and not sticky and _shared(path, status, root):
        return True, Doubt(A_GROUP, f"{path} can be written by a group")
    return True, doubt


def _shared(path: str, status: os.stat_result, root: int) -> bool:
    """Return True if the right to write of a group, or of an access control list, is that of others than the owner and root."""
    try:
        if os.getxattr(path, _ACL, follow_symlinks=False):
            return True
    except OSError:
        pass  # it has none
    try:
        members = set(grp.getgrgid(status.st_gid).gr_mem)
    except KeyError:
        members = set()
    members |= {entry.pw_name for entry in pwd.getpwall() if entry.pw_gid == status.st_gid}
    return bool(members - {account(0), account(root), account(status.st_uid)})


def account(uid: int) -> str:
    """Return the name of a user; empty where there is none, or one that files of settings would misread."""
    try:
        name = pwd.getpwuid(uid).pw_name
    except KeyError:
        return ""
    return name if _ACCOUNT.fullmatch(name) else ""


# Variables

# Lists of folders in which programs look for code. A relative entry would mean another folder in each place.
_LISTS = re.compile(
    r"PATH|PYTHONPATH|LD_LIBRARY_PATH|PKG_CONFIG_PATH|ROS_PACKAGE_PATH|ROSLISP_PACKAGE_DIRECTORIES"
    r"|(?:CMAKE|AMENT|COLCON)_PREFIX_PATH|(?:GAZEBO|IGN|GZ|SDF)_(?:[A-Z0-9_]+_)?PATH"
)
# What others read otherwise than the kernel, so that an entry would be one folder here and another one there: for the dynamic
# linker `;` ends an entry, and $ORIGIN is a folder (ld.so(8)); OpenSSH before 8.7 ends a quotation at each `"`.
_QUOTING = frozenset('"\\')
_AMBIGUOUS = _QUOTING | frozenset(";$")
# What root may have of a set-up file that is root's: ROS, and where it finds its parts.
_OF_ROOT = re.compile(
    r"(?:ROS|ROSCONSOLE|CATKIN|GAZEBO|IGN|GZ|SDF)_[A-Z0-9_]+|ROSLISP_PACKAGE_DIRECTORIES|PKG_CONFIG_PATH"
    r"|PATH|PYTHONPATH|LD_LIBRARY_PATH|(?:CMAKE|AMENT|COLCON)_PREFIX_PATH"
)
# What nobody gets: it makes programs run other code than they are, or is the session's own.
_OF_NOBODY = re.compile(
    r"LD_(?!LIBRARY_PATH$).*|PYTHON(?!PATH$).*|GCONV_PATH|LOCPATH|NLSPATH|MALLOC_.*|GLIBC_.*"
    r"|BASH_.*|BASHOPTS|SHELLOPTS|ENV|IFS|PS[0-4]|PROMPT_COMMAND|CDPATH|GLOBIGNORE|FIGNORE|EXECIGNORE|ZDOTDIR"
    r"|PERL.*|RUBY.*|NODE_.*|JAVA_TOOL_OPTIONS|_JAVA_OPTIONS|GIT_.*|SSH_.*|SUDO_.*|LESSOPEN|LESSCLOSE"
    r"|EDITOR|VISUAL|PAGER|MANPAGER|BROWSER|TMPDIR|HOSTALIASES|LOCALDOMAIN|RES_OPTIONS"
    r"|DBUS_.*|XDG_RUNTIME_DIR|DISPLAY|XAUTHORITY|USER|LOGNAME|SHELL|MAIL"
)


class Variables(typing.NamedTuple):
    """The variables of a set-up file, sorted: by whom they may be read, and what is left out."""

    usable: typing.Dict[str, str]  # the services, and persons
    of_root: typing.Dict[str, str]  # root too, if it is all root's
    left_out: typing.List[str]  # NAME, or NAME (entry), for nobody


def sort(variables: typing.Dict[str, str]) -> Variables:
    """Sort the variables of a set-up file by their names, and drop entries of lists that name no one certain folder."""
    sorted_ones = Variables({}, {}, [])
    for name, value in sorted(variables.items()):
        if _OF_NOBODY.fullmatch(name):
            sorted_ones.left_out.append(name)
            continue
        if _LISTS.fullmatch(name):
            entries = [entry for entry in value.split(":") if entry]
            kept = [entry for entry in entries if entry.startswith("/") and not _AMBIGUOUS & set(entry)]
            sorted_ones.left_out.extend(f"{name} ({entry})" for entry in entries if entry not in kept)
            value = ":".join(kept)
        if value:
            sorted_ones.usable[name] = value
            if _OF_ROOT.fullmatch(name):
                sorted_ones.of_root[name] = value
    return sorted_ones


_HOST = re.compile(r"\A[A-Za-z][A-Za-z0-9+.-]*://[^/:]+")


def paths(variables: typing.Dict[str, str]) -> typing.List[str]:
    """List the absolute paths that values name, alone or in a list of folders; the host of a URI is none, `//home` is one."""
    found = [entry for value in variables.values() for entry in _HOST.sub("", value).split(":")]
    return sorted({entry for entry in found if entry.startswith("/")})


class Reach(typing.NamedTuple):
    """Whom the variables of a set-up file reach besides the services, and why not more."""

    for_root: typing.Dict[str, str]
    person: str  # the name of the user who gets all, "*" for every user but root, empty for nobody
    doubt: str  # why root gets none, in a few words
    refusal: str  # why not even the services may, in a few words


def reach(setup: str, variables: Variables) -> Reach:
    """Decide whom the variables of a set-up file reach: by the hands in which it is, and the lists of folders that it makes.

    Of other variables, root gets no path that others can change.
    """
    lists = {name: value for name, value in variables.usable.items() if _LISTS.fullmatch(name)}
    look = Look()
    own = look.doubts(setup) if setup else []
    found = own + [doubt for path in paths(lists) for doubt in look.doubts(path)]
    if not found:
        return Reach(_certain(variables.of_root, look), "*", "", "")
    open_to_all = [doubt.words for doubt in found if doubt.who == EVERYBODY]
    # A person's own file is the person's choice, together with all that it names.
    person = "" if open_to_all else _owner(own or found)
    return Reach({}, person, found[0].words, open_to_all[0] if open_to_all else "")


def _owner(found: typing.Iterable[Doubt]) -> str:
    """Return the one user in whose hands it all is; empty where it is in those of several."""
    owners = {doubt.who for doubt in found if doubt.who != A_GROUP}
    return account(owners.pop()) if len(owners) == 1 else ""


def _certain(variables: typing.Dict[str, str], look: Look) -> typing.Dict[str, str]:
    return {name: value for name, value in variables.items() if _is_certain(name, value, look)}


def _is_certain(name: str, value: str, look: Look) -> bool:
    """Return True for a value that names nothing but what root alone can change, wherever root stands when it is read."""
    if _QUOTING & set(value):
        return False
    named = "/" in value or name.endswith(("_FILE", "_DIR", "_HOME"))
    relative = not _HOST.match(value) and any(entry and not entry.startswith("/") for entry in value.split(":"))
    return not (named and relative) and not any(look.doubts(path) for path in paths({name: value}))
