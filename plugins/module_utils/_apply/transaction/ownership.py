# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The mode, the owner and the group of a file, as a user writes them (chmod(1), chown(1)) and as the kernel takes them."""

import grp
import os
import pwd
import re
import typing

from ..._base.problem import Problem

NEW = 0o644  # the start of a symbolic mode: the plan does not depend on the present mode
_OCTAL = re.compile(r"(?:0o)?[0-7]{3,5}")
_CLAUSE = re.compile(r"([ugoa]*)((?:[-+=](?:[ugo]|[rwxXst]*))+)")
_CHANGE = re.compile(r"([-+=])([ugo]|[rwxXst]*)")
_SHIFT = {"u": 6, "g": 3, "o": 0}
_SPECIAL = {"u": 0o4000, "g": 0o2000, "o": 0o1000}


def parse_mode(value: typing.Any) -> typing.Optional[int]:
    """Read a mode as Ansible takes it: octal text, the number that YAML makes of 0644, or symbolic; None for no mode."""
    if isinstance(value, int):
        # A number above 0777 is a mode that was written in decimal, as 644 is.
        return value if not isinstance(value, bool) and 0 <= value <= 0o777 else None
    if not isinstance(value, str):
        return None
    text = value.strip()
    if _OCTAL.fullmatch(text):
        mode = int(text, 8)
        return mode if mode <= 0o7777 else None
    mode = NEW
    for clause in text.split(","):
        match = _CLAUSE.fullmatch(clause.strip())
        if not match:
            return None
        users = "ugo" if "a" in match.group(1) or not match.group(1) else match.group(1)
        for operator, rights in _CHANGE.findall(match.group(2)):
            mode = _change_mode(mode, users, operator, rights)
    return mode


def _change_mode(mode: int, users: str, operator: str, rights: str) -> int:
    """One change of a symbolic mode."""
    bits = every = 0
    for user in set(users):
        every |= 7 << _SHIFT[user] | _SPECIAL[user]
        three = mode >> _SHIFT[rights] & 7 if rights in _SHIFT else _bits(rights, mode)
        bits |= three << _SHIFT[user]
        if ("t" if user == "o" else "s") in rights:
            bits |= _SPECIAL[user]
    if operator == "=":
        return mode & ~every | bits
    return mode | bits if operator == "+" else mode & ~bits


def _bits(rights: str, mode: int) -> int:
    """The three bits of rwxX; X is x if a user may execute the file already."""
    execute = "x" in rights or ("X" in rights and mode & 0o111)
    return (4 if "r" in rights else 0) | (2 if "w" in rights else 0) | (1 if execute else 0)


def find_owner(
    path: str, owner: typing.Optional[str], group: typing.Optional[str]
) -> typing.Optional[typing.Tuple[int, int]]:
    """The (uid, gid) of a file, None if neither is asked for. Raises Problem for a name that is not known here.

    A user without a group gets the group of the module, as every other file does.
    """
    if owner is None and group is None:
        return None
    uid = os.geteuid() if owner is None else _number(path, "owner", owner, lambda name: pwd.getpwnam(name).pw_uid)
    gid = os.getegid() if group is None else _number(path, "group", group, lambda name: grp.getgrnam(name).gr_gid)
    return uid, gid


def _number(path: str, kind: str, name: str, ask: typing.Callable[[str], int]) -> int:
    try:
        return ask(name)
    except (KeyError, ValueError) as problem:
        if name.isdigit() and int(name) < 2**32 - 1:
            return int(name)
        raise Problem(
            f"The {kind} {name!r} of {path} is not known on this computer; expected the name or number of a "
            f"{'user' if kind == 'owner' else 'group'} that is: make it first, or correct the name."
        ) from problem
