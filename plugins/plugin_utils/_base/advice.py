# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The only way to make a command of an advice: our words and values in, a command or nothing out.

People paste it as root. So each value has the form that its place asks for, in ASCII. For a shell it is a single word,
whatever is around it. If one value has another form, there is no command.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence
from ipaddress import IPv4Network

from .plain_text import LONGEST

_BYTE = "(?:25[0-5]|2[0-4][0-9]|1[0-9]{2}|[1-9]?[0-9])"
#: forms of values; no form begins as an option does
FORMS = {
    "device": re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.@-]{0,14}"),
    "number": re.compile(r"[0-9]{1,10}"),
    "address": re.compile(rf"{_BYTE}(?:\.{_BYTE}){{3}}"),
    "name": re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*"),  # of a computer
    "person": re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*"),
    "unit": re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@:-]*\.service"),
    "setting": re.compile(r"[a-z0-9_]+(?:\.[A-Za-z0-9_-]+)+"),
    "file": re.compile(r"/etc/(?!.*\.\.)[A-Za-z0-9_./-]+"),
    "drop-in": re.compile(r"/(?:etc|run)/systemd/system/(?!.*\.\.)[A-Za-z0-9_./@-]+\.conf"),
    # the rule that is deleted, as policy.py has read it
    "route": re.compile(r"(?:blackhole|unreachable|prohibit) (?:default|[0-9./]+)(?: table [A-Za-z0-9_.-]+)?"),
    "rule": re.compile(
        r"priority [0-9]+(?: from (?:all|[0-9./]+))?(?: to [0-9./]+)?(?: ipproto [a-z0-9]+)?(?: [sd]port [0-9-]+)*"
        r" (?:table [A-Za-z0-9_.-]+|blackhole|unreachable|prohibit)"
    ),
    # a chain of a packet filter, with its family and table
    "chain": re.compile(r"(?:inet|ip) [A-Za-z0-9_][A-Za-z0-9_.-]* [A-Za-z0-9_][A-Za-z0-9_.-]*"),
    "graph": re.compile(r"/[A-Za-z0-9_]+(?:/[A-Za-z0-9_]+)*"),  # a topic, service or node of ROS
    "type": re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*"),  # of a message of ROS
    # a name, address, unit or setting in the remedy of a part
    "what": re.compile(r"[A-Za-z0-9][A-Za-z0-9_./@:-]*"),
}
# The dots of a value in an expression of sed, within quotes.
SED_DOTS = {"name": (".", r"\."), "setting": (".", "[./]")}


def command(words: str, *values: tuple[str, object]) -> str:
    """Put values, each with its form, at the {} of our words. Empty if a value has another form."""
    texts = [format_value(form, str(value)) for form, value in values]
    return words.format(*texts) if all(texts) else ""


def systemctl(person: str) -> tuple[str, str]:
    """The words by which root speaks to the manager of units, that of the computer or of a person, and the folder of its files.

    Empty for a name of another form. `systemctl -M PERSON@ --user` does the same since systemd 248; Ubuntu 20.04 has 245.
    """
    if not person:
        return "systemctl", "/etc/systemd/system"
    words = "runuser -u {} -- env XDG_RUNTIME_DIR=/run/user/$(id -u {}) systemctl --user"
    made = command(words, ("person", person), ("person", person))
    return made, "/etc/systemd/user" if made else ""


def of_unit(person: str, words: str, unit: str) -> str:
    """Put a unit, its manager and the folder of that one's files into our words: {systemctl}, {folder}, {unit}; empty if a value has another form."""
    manager, folder = systemctl(person)
    name = format_value("unit", unit)
    return words.format(systemctl=manager, folder=folder, unit=name) if manager and name else ""


def accept_between(networks: Iterable[IPv4Network], chain: str) -> str:
    """Make the command that puts first into a chain of nft the rules that accept all packets between these networks.

    Empty if the chain has another form.
    """
    ordered = sorted(networks)
    rule = command("nft insert rule {} ip saddr $from ip daddr $to accept", ("chain", chain))
    return _repeat("from", ordered, _repeat("to", ordered, rule))


def accept_at(end: str, networks: Iterable[IPv4Network], match: str, chain: str) -> str:
    """Make the command that puts first into a chain of nft the rules that accept packets with this match (of nft, "" for all packets).

    `end` of the packets, saddr or daddr, is in one of the networks. Empty if the chain has another form.
    """
    rule = " ".join(filter(None, (f"nft insert rule {{}} ip {end} $net", match, "accept")))
    return _repeat("net", sorted(networks), command(rule, ("chain", chain)))


def _repeat(name: str, networks: Sequence[IPv4Network], words: str) -> str:
    """Repeat a command for each network, which is the variable of this name in it.

    Each rule has one network: iptables-save leaves a set of them out of its rule, which then accepts the packets of everybody.
    """
    if not words or len(networks) == 1:
        return words.replace(f"${name}", "".join(map(str, networks)))
    return f"for {name} in {' '.join(map(str, networks))}; do {words}; done"


def format_value(form: str, text: str) -> str:
    """The text as a command has it, empty if the text has another form. A route, a rule and a chain are several words."""
    if len(text) > LONGEST or not FORMS[form].fullmatch(text):
        return ""
    if any(shlex.quote(word) != word for word in text.split(" ")):
        return ""
    return text.replace(*SED_DOTS[form]) if form in SED_DOTS else text
