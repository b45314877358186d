# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Names of computers and robots: those of the machines, as far as an inventory may have them."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence

from .._base.plain_text import quote
from .._inventory import kinds
from .facts import FoundMachine

# Endings that people add to the name of a robot for the name of its computer.
_ENDINGS = re.compile(r"(?<=[a-z0-9])[-_.]?(computer|laptop|notebook|desktop|nuc|pc)$", re.IGNORECASE)
_LAST_PART = re.compile(r"(?<=.)[-_.]([^-_.]*)$")
RESERVED = ("all", "ungrouped", "robots", "routers", "localhost")


def name_computers(machines: Mapping[str, FoundMachine]) -> dict[str, tuple[str, str]]:
    """Return machine -> (name in the inventory, why it was guessed).

    The name in the list stays. If it is an address, or no host name, the host name is taken, if no other machine has it.
    Of a name with underscores, which programs read in different ways, hyphens are made.
    """
    taken = Counter(name.lower() for name in machines if _fits(name))
    called = Counter(machine.hostname.lower() for machine in machines.values())
    found = {}
    for name, machine in machines.items():
        host = machine.hostname
        found[name] = _choose_name(name, host, taken, called)
        if found[name][0] not in (name, host):
            taken[found[name][0].lower()] += 1
    return found


def _choose_name(name: str, host: str, taken: Counter[str], called: Counter[str]) -> tuple[str, str]:
    """Return a name for the inventory, and why it was guessed. `taken` are names in small letters, `called` the host names."""
    if _fits(name):
        return name, ""
    if _fits(host) and called[host.lower()] == 1 and not taken[host.lower()]:
        return host, ""
    for text in (name, host):
        made = text.replace("_", "-")
        if made != text and _fits(made) and not called[made.lower()] and not taken[made.lower()]:
            return made, f"its name is {quote(text)}, and names in an inventory have no underscores"
    return _make_name(name, host, taken, called)


def _make_name(name: str, host: str, taken: Counter[str], called: Counter[str]) -> tuple[str, str]:
    """Return a name that no machine has, and why."""
    made = "host-" + (re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:50] or "unnamed")
    while taken[made] or called[made]:
        made += "-2"
    why = "which another machine has, too" if _fits(host) else "which an inventory cannot have"
    return made, f"its host name is {quote(host) or 'not known'}{', ' + why if host else ''}"


def _fits(name: str) -> bool:
    return kinds.is_host_name(name) and name.lower() not in RESERVED


def name_robots(of: Sequence[Sequence[str]], hosts: Sequence[str]) -> list[str]:
    """Return a name for each robot: the common beginning of its computers' names. Groups and hosts need different names."""
    names: list[str] = []
    taken = {host.lower() for host in hosts} | set(RESERVED)
    short = [_short(computers) for computers in of]
    for name, computers in zip(short, of, strict=True):
        if short.count(name) > 1 or name in taken:
            name = _group_name(min(computers))
        while name in taken:
            name = f"robot_{name}"
        taken.add(name)
        names.append(name)
    return names


def _short(computers: Sequence[str]) -> str:
    """Return the beginning that the names of computers have in common, up to a separator."""
    names = [name.lower() for name in computers]
    if len(names) == 1:
        (name,) = names
        without = _ENDINGS.sub("", name)
        if without != name:
            return _group_name(without)
        last = _LAST_PART.search(name)
        return _group_name(name[: last.start()] if last and not last[1].isdigit() else name)
    begin = os.path.commonprefix(names)
    if begin not in names and not begin.endswith(("-", "_", ".")):
        begin = _LAST_PART.sub("", begin)
    return _group_name(begin or min(names))


def _group_name(text: str) -> str:
    """Return a text as a name that Ansible takes for a group."""
    name = re.sub(r"[^a-z0-9_]+", "_", text.lower()).strip("_")
    return name if name[:1].isalpha() else f"robot_{name}".rstrip("_")
