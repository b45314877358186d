# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The variables of a set-up file of ROS, sorted by the users that may have them. Ownership decides (trust.py)."""

import re
import typing

from .._base.trust import A_GROUP, EVERYBODY, Doubt, TrustCheck, account

# Lists of folders in which programs look for code. A relative entry would depend on the current folder.
_LISTS = re.compile(
    r"PATH|PYTHONPATH|LD_LIBRARY_PATH|PKG_CONFIG_PATH|ROS_PACKAGE_PATH|ROSLISP_PACKAGE_DIRECTORIES"
    r"|(?:CMAKE|AMENT|COLCON)_PREFIX_PATH|(?:GAZEBO|IGN|GZ|SDF)_(?:[A-Z0-9_]+_)?PATH"
)
# Characters that not all programs read as the kernel does. For the dynamic linker `;` ends an entry, and $ORIGIN is a folder
# (ld.so(8)); OpenSSH before 8.7 ends a quotation at each `"`.
_QUOTING = frozenset('"\\')
_AMBIGUOUS = _QUOTING | frozenset(";$")
# The variables that root may have, if root owns the set-up file: ROS, and the places of its parts.
_OF_ROOT = re.compile(
    r"(?:ROS|ROSCONSOLE|CATKIN|GAZEBO|IGN|GZ|SDF)_[A-Z0-9_]+|ROSLISP_PACKAGE_DIRECTORIES|PKG_CONFIG_PATH"
    r"|CONDA_PREFIX|PATH|PYTHONPATH|LD_LIBRARY_PATH|(?:CMAKE|AMENT|COLCON)_PREFIX_PATH"
)
# The variables that no user gets: they make programs run other code, or belong to the session.
_OF_NOBODY = re.compile(
    r"LD_(?!LIBRARY_PATH$).*|PYTHON(?!PATH$).*|GCONV_PATH|LOCPATH|NLSPATH|MALLOC_.*|GLIBC_.*"
    r"|BASH_.*|BASHOPTS|SHELLOPTS|ENV|IFS|PS[0-4]|PROMPT_COMMAND|CDPATH|GLOBIGNORE|FIGNORE|EXECIGNORE|ZDOTDIR"
    r"|PERL.*|RUBY.*|NODE_.*|JAVA_TOOL_OPTIONS|_JAVA_OPTIONS|GIT_.*|SSH_.*|SUDO_.*|LESSOPEN|LESSCLOSE"
    r"|EDITOR|VISUAL|PAGER|MANPAGER|BROWSER|TMPDIR|HOSTALIASES|LOCALDOMAIN|RES_OPTIONS"
    r"|DBUS_.*|XDG_RUNTIME_DIR|DISPLAY|XAUTHORITY|USER|LOGNAME|SHELL|MAIL"
)


class Variables(typing.NamedTuple):
    """The variables of a set-up file, sorted by their users."""

    usable: typing.Dict[str, str]  # for the services and persons
    of_root: typing.Dict[str, str]  # for root too, if root owns all files
    left_out: typing.List[str]  # NAME, or NAME (entry)


def sort(variables: typing.Dict[str, str]) -> Variables:
    """Sort the variables of a set-up file by their names, and drop ambiguous entries of lists."""
    sorted_ones = Variables({}, {}, [])
    for name, value in sorted(variables.items()):
        if _OF_NOBODY.fullmatch(name):
            sorted_ones.left_out.append(name)
            continue
        if _LISTS.fullmatch(name):
            entries = [entry for entry in value.split(":") if entry]
            certain = [entry for entry in entries if entry.startswith("/") and not _AMBIGUOUS & set(entry)]
            sorted_ones.left_out.extend(f"{name} ({entry})" for entry in entries if entry not in certain)
            value = ":".join(certain)
        if value:
            sorted_ones.usable[name] = value
            if _OF_ROOT.fullmatch(name):
                sorted_ones.of_root[name] = value
    return sorted_ones


_HOST = re.compile(r"\A[A-Za-z][A-Za-z0-9+.-]*://[^/:]+")


def paths(variables: typing.Dict[str, str]) -> typing.List[str]:
    """List the absolute paths in values, single or in a list of folders: not the host of a URI, but `//home`."""
    entries = [entry for value in variables.values() for entry in _HOST.sub("", value).split(":")]
    return sorted({entry for entry in entries if entry.startswith("/")})


class Reach(typing.NamedTuple):
    """The users, besides the services, that the variables of a set-up file reach."""

    for_root: typing.Dict[str, str]
    person: str  # the name of the one user with all variables, "*" for all users but root, or empty
    doubt: str  # the reason why root gets no variables, in a few words
    refusal: str  # the reason why not even the services get them, in a few words


def reach(setup: str, variables: Variables) -> Reach:
    """Decide which users get the variables: by the owners of the set-up file and of the folders in its lists.

    Of other variables, root gets no path that others can change.
    """
    lists = {name: value for name, value in variables.usable.items() if _LISTS.fullmatch(name)}
    look = TrustCheck()
    own = look.doubts(setup) if setup else []
    doubts = own + [doubt for path in paths(lists) for doubt in look.doubts(path)]
    if not doubts:
        certain = {name: value for name, value in variables.of_root.items() if _is_certain(name, value, look)}
        return Reach(certain, "*", "", "")
    open_to_all = [doubt.words for doubt in doubts if doubt.who == EVERYBODY]
    # A person's own file is the person's choice, together with all that it names.
    person = "" if open_to_all else _owner(own or doubts)
    return Reach({}, person, doubts[0].words, open_to_all[0] if open_to_all else "")


def _owner(doubts: typing.Iterable[Doubt]) -> str:
    """Return the one user that can change all parts; empty for several users."""
    owners = {doubt.who for doubt in doubts if doubt.who != A_GROUP}
    return account(owners.pop()) if len(owners) == 1 else ""


def _is_certain(name: str, value: str, look: TrustCheck) -> bool:
    """Return True if only root can change all paths in a value, whatever the current folder is."""
    if _QUOTING & set(value):
        return False
    is_path = "/" in value or name.endswith(("_FILE", "_DIR", "_HOME"))
    relative = not _HOST.match(value) and any(entry and not entry.startswith("/") for entry in value.split(":"))
    return not (is_path and relative) and not any(look.doubts(path) for path in paths({name: value}))
