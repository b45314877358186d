# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file of an inventory that a problem is corrected in, and problems that several robots have for one reason. Pure.

Sentences name the file that a robot of its own would have, group_vars/ROBOT.yml, or no file. Several robots may have one file, that of a
group above them, and a fault in it is one fault.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from .._base.sentences import shorten_list
from .rows import PREFIX

_NAMED = re.compile(r"group_vars/[A-Za-z0-9_.-]+\.yml|(?<=correct it in )the inventory\b")
_VARIABLE = re.compile(rf"\b({PREFIX}[a-z_]+)\b")
_MOST = 3  # robots that are named with the first one


class HostMembership(NamedTuple):
    """The robot of a host, and the groups of that host."""

    robot: str
    groups: Sequence[str]


Files = Mapping[str, Mapping[str, str]]  # group -> its files: name -> text


def name_files(problems: Sequence[str], members: Mapping[str, HostMembership], files: Files) -> list[str]:
    """Return the problems, each with the one file that sets its variable, and one for all robots with which it is the same.

    `members` are those of the hosts with which the sentences begin.
    """
    alike: dict[str, list[str]] = {}  # a sentence without the names of its robot -> the sentences
    for problem in problems:
        host, _colon, text = problem.partition(": ")
        robot = members[host].robot if host in members else ""
        named = _name_file(problem, members[host], files) if host in members else problem
        for name in filter(None, (host, robot)):
            text = text.replace(name, "*")
        alike.setdefault(text if robot else problem, []).append(named)
    return [_join(group) for group in alike.values()]


def _join(group: Sequence[str]) -> str:
    hosts = dict.fromkeys(problem.partition(": ")[0] for problem in group[1:])
    return f"{group[0]} The same holds for {shorten_list(hosts, _MOST)}." if hosts else group[0]


def _name_file(problem: str, member: HostMembership, files: Files) -> str:
    named, variable = _NAMED.search(problem), _VARIABLE.search(problem)
    if named is None or variable is None:
        return problem
    assigns = re.compile(rf"^[\"']?{variable[1]}[\"']?\s*:", re.MULTILINE)
    found = [
        name
        for group in dict.fromkeys((member.robot, *member.groups))
        for name, text in files.get(group, {}).items()
        if assigns.search(text)
    ]
    return problem[: named.start()] + found[0] + problem[named.end() :] if len(found) == 1 else problem
