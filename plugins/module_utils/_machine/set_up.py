# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The variables of a set-up file of ROS: which of them root, others and nobody may have. Ownership decides (trust.py)."""

import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.trust import (
    A_GROUP,
    EVERYBODY,
    Doubt,
    Look,
    account,
)

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
