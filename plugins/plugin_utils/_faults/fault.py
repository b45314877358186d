# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of a row in the table of faults, of an advice, and the additions of an optional feature to that table. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

from .._base import advice
from .._base.plain_text import quote

READ, ALWAYS = "if it was looked at", "always"
CONTROLLER, INVENTORY = "the controller", "the inventory"  # places of an advice that is no computer
HANDS = ""  # no command does it
UNKNOWN_INVENTORY = "INVENTORY"  # in a command if the run does not know it
#: places on the pages; one with a space is no host, so nothing is limited to it
COMPUTER, NETWORK = "COMPUTER", "the network of ROBOT"
COMPUTERS, ROBOTS = (COMPUTER, "OTHER_COMPUTER"), ("ROBOT", "OTHER_ROBOT")
#: word in an advice -> its text if its value was not read, as on the pages
UNREAD: Mapping[str, str] = {
    "address": "<address of {place}>",
    "device": "<interface>",
    "neighbour": "another computer of its network",
    "there": "a computer there",
    "other": "<address of another computer there>",
    "beyond": "<an address there>",
    "group": "<multicast group>",
    "parameter": "<parameter>",
    "target": "<address of that computer>",
    "topic": "<topic>",
    "type": "<type>",
    "nodes": "<node>",
}
PAGES = "https://github.com/rosfleet/multimaster/blob/main/docs/findings"


class Advice(NamedTuple):
    """A step for a person, to do or to look at: a command for a place, a change of the inventory, or words.

    Texts of a row have {place}, {what}, {inventory}, {limit} and the words of UNREAD.
    """

    where: str  # a computer, CONTROLLER, INVENTORY or HANDS
    text: str
    effect: str = ""  # the effect; it is no part of the command

    def fill(self, what: str, **words: str) -> Advice:
        """Fill in names; words instead of a command if `what` may be anything."""
        is_command = self.where not in (HANDS, INVENTORY)
        if what and is_command and "{what}" in self.text and not advice.format_value("what", what):
            place = words.get("place", "")
            return Advice(HANDS, f"look at it on {place}: {quote(what)} fits into no command")
        return Advice(*(text.format(what=what, **words) for text in self))

    @property
    def order(self) -> str:
        """The advice without its effect."""
        begin = {HANDS: "", INVENTORY: "in the inventory: "}.get(self.where, f"on {self.where}: ")
        return f"{begin}{self.text}"

    @property
    def sentence(self) -> str:
        """The advice as one text."""
        return f"{self.order} ({self.effect})" if self.effect else self.order


Advices = tuple[Advice, ...]


def on(command: str, effect: str = "") -> Advice:
    """Advise a command on the computer of the fault."""
    return Advice("{place}", command, effect)


def controller(command: str, effect: str = "") -> Advice:
    """Advise a command on the controller."""
    return Advice(CONTROLLER, command, effect)


def keep_settings(title: str, values: Mapping[str, int]) -> Advice:
    """Advise values of the kernel, now and at each boot: of the files of /etc/sysctl.d the last one counts."""
    file = f"/etc/sysctl.d/99-user-{title}.conf"
    lines = " ".join(f"{name}={value}" for name, value in values.items())
    return on(f"printf '%s\\n' {lines} >{file}; sysctl -p {file}", "now and at each boot")


def change(text: str, effect: str = "") -> Advice:
    """Advise a change of the inventory."""
    return Advice(INVENTORY, text, effect)


def hand(text: str) -> Advice:
    """Advise an action that no command does."""
    return Advice(HANDS, text)


def site(effect: str = "", *options: str) -> Advice:
    """Advise a run of site.yml on the computer of the fault."""
    more = "".join(f" {option}" for option in options)
    return controller(f"ansible-playbook -i {{inventory}} rosfleet.multimaster.site{{limit}}{more}", effect)


def site_of_all(effect: str = "") -> Advice:
    """Advise a run of site.yml on all computers."""
    return controller("ansible-playbook -i {inventory} rosfleet.multimaster.site", effect)


def verify_again(effect: str, *options: str) -> Advice:
    """Advise a verification of all computers."""
    return controller(" ".join(("ansible-playbook -i {inventory} rosfleet.multimaster.verify", *options)), effect)


def reinstall(packages: str, effect: str) -> Advice:
    """Advise to install again those of some Debian packages that are installed, so ROS of ros.org and Debian's ROS never mix."""
    listed = f"dpkg-query -W -f '${{{{db:Status-Status}}}} ${{{{Package}}}}\\n' '{packages}'"
    return on(f"apt-get install --reinstall $({listed} | awk '$1 == \"installed\" {{{{print $2}}}}')", effect)


class Fault(NamedTuple):
    """A way in which a component of a kind may be broken: its id, a sentence, the remedy, and the commands to look with if that does not help.

    `do` is for a fault that was seen. An inferred one has only `look`, so nothing in `look` changes anything.
    `cost` says how rare it is, and `why` says why: of two components that explain the same, the cheaper one is named.
    A `hard` fault lets nothing pass, so a success that needs the component clears it. Of other faults a success says little.
    A fault that is `read` is not concluded, since a value on the machine shows it: READ is for places with an observation.
    """

    id: str
    sentence: str
    do: Advices = ()
    look: Advices = ()
    cost: float = 3.0
    why: str = ""
    hard: bool = True
    read: str = ""
    what: str = ""  # the text for a component whose own `what` is empty
    at: tuple[str, ...] = (COMPUTER,)  # its place or places on the pages

    @property
    def example(self) -> str:
        """The placeholder for `what` in a command."""
        return f"<{self.what}>" if " " in self.what else self.what

    @property
    def page(self) -> str:
        """The address of its page."""
        return f"{PAGES}/{self.id[3]}xx.md#{self.id.lower()}"

    def fill(
        self,
        advices: Advices,
        places: tuple[str, ...],
        what: str,
        inventory: str = "",
        known: Mapping[str, str] = MappingProxyType({}),
    ) -> Advices:
        """Fill the names of a component into an advice. A network is no host, so nothing is limited to it.

        `known` are values of the plan or of a computer, by the words of UNREAD.
        """
        limit = "" if any(" " in place for place in places) else f" --limit {','.join(places)}"
        place = " and ".join(places)
        words = {name: known.get(name) or text.format(place=place) for name, text in UNREAD.items()}
        words |= {"place": place, "inventory": inventory or UNKNOWN_INVENTORY, "limit": limit}
        return tuple(
            (one if what else one._replace(text=one.text.replace("{what}", self.example))).fill(what, **words)
            for one in advices
        )


def write_advices(advices: Advices) -> str:
    """Write advices as one text."""
    return "; ".join(one.sentence for one in advices)


def list_advices(advices: Advices) -> list[dict[str, str]]:
    """List advices as plain data."""
    return [one._asdict() for one in advices]


def read_advices(entries: list[dict[str, Any]]) -> Advices:
    """Read advices from plain data."""
    return tuple(Advice(*(str(entry.get(name, "")) for name in Advice._fields)) for entry in entries)


Key = tuple[str, str]  # kind, mode


@dataclass(frozen=True)
class ComponentHooks:
    """The rows of a feature: (kind, mode) -> its fault, and other faults that it may be the cause of, at the same place."""

    faults: Mapping[Key, Fault]
    #: fault, also one of the core -> faults of the feature that it may follow from
    causes: Mapping[Key, tuple[Key, ...]] = field(default_factory=dict)
    #: kind -> the meaning for a fleet if such a component of it is broken
    kinds: Mapping[str, str] = field(default_factory=dict)
