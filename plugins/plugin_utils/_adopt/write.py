# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A proposal as the files of an inventory, with a comment at everything that was guessed.

Texts of machines are in comments, on one line each, or was read as a name, an address or a number: nothing of it is a
template for Ansible.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Any

import yaml

from .._base.plain_text import LINE, plain
from .._inventory.rows import PREFIX
from .proposal import Choices, Proposal, ProposedComputer

WIDTH = 120
# Variables that say how a machine is reached; those in SECRET are never written.
CONNECTION = re.compile(
    r"ansible_(host|port|user|connection|timeout|pipelining|control_path\w*|shell_\w+|python_interpreter|(ssh|become|paramiko|sudo|su)_\w+)"
)
SECRET = re.compile(r"ansible_(\w+_)?(pass|password|passphrase|pwd|token|secret)\w*|ansible_\w*_private_key")

# ProxyUseFdpass is an option of ssh, which hands over a file descriptor. It may follow its `-o` without a space.
_SECRET_INSIDE = re.compile(
    r"(?!o?ProxyUseFdpass\b)\b\w*?(pass(word|wd|phrase)?\b|sshpass|token|secret)", re.IGNORECASE
)

Connections = Mapping[str, Mapping[str, Any]]  # machine -> its variables of the list, as they are written there
Ways = Mapping[str, Sequence[str]]  # machine -> the lines that say how it is reached

# Words that YAML does not read as a text.
_PLAIN = re.compile(r"[A-Za-z/][A-Za-z0-9_./@-]*|\d+\.\d+\.\d+\.\d+(/\d+)?")
_WORDS = "true false yes no on off null y n".split()


def files(proposal: Proposal, connections: Connections) -> dict[str, str]:
    """Return path -> text, in a stable order."""
    ways = {host.machine: _connection(host, connections.get(host.machine, {})) for host in proposal.hosts}
    first, *others = ways.values()
    shared = [line for line in first if all(line in lines for lines in others)]
    own = {machine: [line for line in lines if line not in shared] for machine, lines in ways.items()}
    fleet = [*_variables(proposal.choices), *shared]
    written = {
        "hosts.yml": _hosts(proposal, own),
        "group_vars/robots.yml": _group("The values that all robots share.", proposal.notes, fleet),
    }
    for robot in proposal.robots:
        title = f"The values of the robot {robot.name}."
        written[f"group_vars/{robot.name}.yml"] = _group(title, robot.notes, _variables(robot.choices))
    if proposal.router and shared:
        written["group_vars/routers.yml"] = _group("The router of the common network.", (), shared)
    return written


def _group(title: str, notes: Iterable[str], lines: Iterable[str]) -> str:
    return "\n".join([*_comment([title, *_sentences(notes)]), "---", *lines]) + "\n"


def _hosts(proposal: Proposal, ways: Ways) -> str:
    lines = _comment(
        [
            "Written by rosfleet.multimaster.adopt, which looked at the machines. A comment marks each guess: read it, and correct it.",
            'A group below "robots" is a robot; a host of that group is a computer of it.',
            *(f"Left out: {name}, since {why}." for name, why in sorted(proposal.left_out.items())),
        ]
    )
    lines += ["---", "robots:", "  children:"]
    for robot in proposal.robots:
        lines += [f"    {_scalar(robot.name)}:", "      hosts:"]
        for computer in robot.computers:
            lines += _indent(8, _host(computer, ways))
    if proposal.router:
        lines += ["", "# The device that manages the common network, if it is a computer under Linux."]
        lines += ["routers:", "  hosts:", *_indent(4, _host(proposal.router, ways))]
    return "\n".join(lines) + "\n"


def _host(computer: ProposedComputer, ways: Ways) -> list[str]:
    inside = [*_comment(_sentences(computer.notes)), *_variables(computer.choices), *ways[computer.machine]]
    return [f"{_scalar(computer.name)}:", *_indent(2, inside)]


def _connection(computer: ProposedComputer, given: Mapping[str, Any]) -> list[str]:
    """Return how the machine is reached, as the list of machines says it; its address if the list has no other name."""
    lines = []
    if "ansible_host" not in given and computer.machine != computer.name:
        lines.append(f"ansible_host: {_scalar(computer.machine)}")
    for name in sorted(given):
        if SECRET.fullmatch(name) or _SECRET_INSIDE.search(str(given[name])):
            lines.append(f"# {name}: a secret, which is not written here: keep it in a vault")
        elif CONNECTION.fullmatch(name):
            lines.append(f"{name}: {_scalar(given[name])}")
    return lines


def _variables(choices: Choices) -> list[str]:
    lines = []
    for name, choice in choices.items():
        lines += _comment(_sentences([choice.why] if choice.why else []))
        lines.append(f"{PREFIX}{name}: {_scalar(choice.value)}")
    return lines


def _scalar(value: Any) -> str:
    """Return a value in YAML; a text that YAML may read as another thing is quoted."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_scalar, value))}]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    if isinstance(value, str):  # Ansible has classes of its own for texts, which PyYAML does not write
        return yaml.safe_dump("".join([value]), default_style='"', width=inf).strip()
    return json.dumps(value)


def _comment(lines: Sequence[str]) -> list[str]:
    return [
        part
        for line in lines
        for part in textwrap.wrap(
            plain(line, LINE), WIDTH, initial_indent="# ", subsequent_indent="#   ", break_on_hyphens=False
        )
    ]


def _sentences(texts: Iterable[str]) -> list[str]:
    return [f"{text[:1].upper()}{text[1:]}." for text in texts]


def _indent(depth: int, lines: Iterable[str]) -> list[str]:
    return [" " * depth + line if line else line for line in lines]
